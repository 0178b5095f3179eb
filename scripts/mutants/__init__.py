"""Small mutants of core that a test should notice."""
