"""The lattice of dots or lines by which a photograph tells what is off."""
