"""The compiled kernel's library: its sources in C, how it is loaded, and the structures it reads.

The glue stands in the rooms whose nouns it knows: `light/native/`, `glass/native_fit.py`,
`map/native_divide.py` and `image/native_paint.py`. numpy's way stays the reference, and takes the
place of the kernel where there is none, where the environment has KIRIKO_KERNEL=off, and for what
the kernel does not know.
"""
