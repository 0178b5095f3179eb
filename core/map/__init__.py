"""View maps: the display pixel seen at each place of the viewer's image."""
