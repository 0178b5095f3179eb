"""The compiled kernel's library: C sources, loading, and the structures shared with Python.

Callers are in the rooms they serve: `light/kernel_tracer.py`, `light/kernel_trees.py`,
`glass/native_fit.py`, `map/native_divide.py` and `image/native_paint.py`. numpy is the reference.
It replaces a missing kernel, one switched off by KIRIKO_KERNEL=off in the environment, and covers
everything the kernel does not support.
"""
