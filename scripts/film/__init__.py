"""The README's film, recorded in the real Blender."""
