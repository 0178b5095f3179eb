"""From a rig to its source image, and the remarks on it."""
