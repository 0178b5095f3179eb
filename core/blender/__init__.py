"""All that knows Blender: the scene is read here, and results are written."""
