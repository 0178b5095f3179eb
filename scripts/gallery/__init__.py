"""The gallery of docs/pictures/gallery: real rigs in a lit room."""
