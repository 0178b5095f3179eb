"""Surfaces of meshes: the smooth shape they represent, and the solids they enclose."""
