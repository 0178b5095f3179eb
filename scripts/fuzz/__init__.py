"""Random rigs and random glass."""
