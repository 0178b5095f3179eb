"""Colours: the picture, the source image, and what is seen of it."""
