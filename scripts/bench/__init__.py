"""Measures: seconds, errors and rays, one bench a file, each a verb of dev.py."""
