"""Colours: the picture, the source image, and the seen image."""
