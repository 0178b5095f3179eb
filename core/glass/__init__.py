"""Surfaces: the ones that meshes stand for, and which solids it encloses."""
