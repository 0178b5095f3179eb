"""Rays: interactions, hits, and landings."""
