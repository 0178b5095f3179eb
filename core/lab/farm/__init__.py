"""Farm jobs: descriptions for schedulers, and the join of the workers' results."""
