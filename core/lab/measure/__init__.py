"""Error against run time, and the references for it."""
