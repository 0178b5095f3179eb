"""The lattice of dots or lines by which a photograph tells a bench's errors."""
