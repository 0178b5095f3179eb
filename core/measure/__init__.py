"""Error against time, and what a result is compared with."""
