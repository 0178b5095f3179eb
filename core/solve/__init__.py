"""From a rig to its source image, and what is told of it."""
