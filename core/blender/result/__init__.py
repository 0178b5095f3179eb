"""Writes results into the scene, and tells whether they are up to date."""
