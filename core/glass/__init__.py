"""Surfaces: what a mesh stands for, and which solids it encloses."""
