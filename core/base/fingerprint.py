"""Fingerprints of data: equal content gives an equal hash, so results can be reused."""

import hashlib
from dataclasses import Field, fields, is_dataclass

import numpy as np

PLAIN_TYPES = str, bytes, int, float, complex, bool, type(None), np.generic


def counted(thing: object) -> list[Field]:
    """Fields of a dataclass included in its fingerprint: all except its name."""
    return [f for f in fields(thing) if f.name != "name"]


def fingerprint(*things: object) -> str:
    """Hash of the content of dataclasses, arrays, tuples and plain values.

    Names are ignored: an object may be renamed by undo or a file load.

    Raises
    ------
    TypeError : a value without content, such as a function: its address may be reused later
    """
    digest = hashlib.sha1(usedforsecurity=False)  # hardware-accelerated on many processors

    def add(thing: object) -> None:
        if is_dataclass(thing):
            digest.update(type(thing).__name__.encode())
            for f in counted(thing):
                add(getattr(thing, f.name))
        elif isinstance(thing, np.ndarray):
            digest.update(f"{thing.dtype}{thing.shape}".encode())
            digest.update(np.ascontiguousarray(thing).data)
        elif isinstance(thing, tuple):
            digest.update(f"({len(thing)}".encode())
            for item in thing:
                add(item)
        elif isinstance(thing, PLAIN_TYPES):
            digest.update(repr(thing).encode())
        else:
            raise TypeError(
                f"A {type(thing).__name__} has no content to compare: make it a dataclass."
            )
        digest.update(b";")

    for thing in things:
        add(thing)

    return digest.hexdigest()
