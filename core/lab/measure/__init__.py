"""Error against time, and the references for it."""
