"""The compiled kernel's library: C sources, loading, and the structures shared with Python.

Callers are in the rooms they serve: `light/kernel_tracer.py`, `light/kernel_trees.py`,
`glass/native_fit.py`, `map/native_divide.py` and `image/native_paint.py`. numpy is the reference.
It is used if there is no kernel, if KIRIKO_KERNEL=off is set in the environment, and for everything
the kernel does not support.
"""
