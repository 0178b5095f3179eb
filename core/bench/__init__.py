"""The real bench: where its parts stand, and what is off."""
