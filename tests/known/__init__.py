"""Known answers and known rigs, for the tests and for scripts/."""
