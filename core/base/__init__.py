"""What every room stands on: arrays, vectors, messages, errors, steps of long work."""
