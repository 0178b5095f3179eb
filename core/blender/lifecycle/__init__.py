"""Makes, copies and removes rigs and their parts."""
