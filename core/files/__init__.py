"""Files: images, their encodings, and sets of files written completely or not at all."""
