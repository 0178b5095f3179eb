"""Materials and node groups that obey Kiriko's optics in Cycles."""
