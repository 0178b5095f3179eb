"""What 3D views show: framing, looking through the viewer, images on flat parts."""
