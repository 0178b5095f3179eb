"""Reading the Blender scene and writing results into it."""
