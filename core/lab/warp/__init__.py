"""Warp maps for other programs."""
