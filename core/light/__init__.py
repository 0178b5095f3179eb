"""Rays: the laws, what is met where, and where light ends."""
