"""Contents of 3D views: framing, the view through the viewer, images on flat parts."""
