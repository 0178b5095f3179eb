"""The compiled kernel's library: its sources in C, how it is loaded, and the structures it reads.

The glue stands in the rooms whose nouns it knows: `light/kernel_tracer.py`,
`light/kernel_trees.py`, `glass/native_fit.py`, `map/native_divide.py` and
`image/native_paint.py`. numpy is the reference. It takes the kernel's place if there is no kernel,
if the environment has KIRIKO_KERNEL=off, and for all that the kernel does not know.
"""
