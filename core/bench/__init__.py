"""Where the parts of a rig stand, how large they are, and what may be off."""
