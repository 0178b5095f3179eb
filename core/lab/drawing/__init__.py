"""The bench as drawings to scale, for whoever builds it."""
