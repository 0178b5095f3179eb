"""Rays by the compiled kernel, as `trace.py` follows them, to the same slacks."""
