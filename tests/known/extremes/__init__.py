"""Stiff and extreme cases with their expectations."""
