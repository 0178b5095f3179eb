"""Maps that other programs read."""
