"""Calibration of a real bench from photographs of a lattice, and the visible range of its
picture.
"""
