"""Renders by Cycles: previews for comparison, and viewers' images."""
