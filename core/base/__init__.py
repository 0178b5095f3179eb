"""Foundations of every room: arrays, vectors, messages, errors, steps of long work."""
