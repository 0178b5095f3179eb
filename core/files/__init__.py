"""Files: images, their encodings, and sets of files that are written as a whole."""
