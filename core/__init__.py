"""The part of Kiriko that knows no Blender: rig in, source image out. Only blender_*.py import bpy."""
