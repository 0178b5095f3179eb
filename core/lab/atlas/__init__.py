"""Warp maps for a moving head, over a grid of head positions."""
