"""Kiriko without Blender: a rig goes in, a source image comes out. Only core/blender imports
bpy.
"""
