"""The manual: its site, and a hand that plays its steps in the real Blender and takes pictures."""
