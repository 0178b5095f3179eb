"""Maps for a head that moves: warp maps over a grid of its places."""
