"""Places, sizes and errors of the parts of a rig."""
