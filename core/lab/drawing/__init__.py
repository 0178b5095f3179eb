"""Scale drawings of the bench, for building it."""
