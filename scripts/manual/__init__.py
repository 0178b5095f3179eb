"""The manual: its site, and a simulated hand that plays its steps in the real Blender and takes
pictures.
"""
