"""Blender's side of a projector: a camera, which no preview shows."""

from .part_roles import InBlender

IN_BLENDER = InBlender(read=None, shade=None)  # `scene.read_projector` reads it
