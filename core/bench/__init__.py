"""The real bench: where its parts stand, and its errors."""
