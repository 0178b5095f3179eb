"""The part of Kiriko that knows no Blender: rig in,
source image out. Only core/blender imports bpy.
"""
