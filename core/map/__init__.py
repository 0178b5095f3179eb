"""The view map: which display pixel each part of the viewer's image shows."""
