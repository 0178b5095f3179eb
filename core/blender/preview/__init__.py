"""Renders by Cycles, as an independent judge and as viewers' images."""
