"""Rays: the laws, the hits, and where light ends."""
