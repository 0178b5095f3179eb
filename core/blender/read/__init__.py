"""Reads the evaluated scene into a Rig: parts, shapes, roles and the picture."""
