"""Blender's datablocks: objects, images, movies, cameras, units, and the rigs of a scene."""
