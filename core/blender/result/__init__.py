"""Writes results into the scene, and detects whether they are up to date."""
