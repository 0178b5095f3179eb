"""Draws the pipeline of docs/design.md, with a cut pixel of a real solve in it."""
