"""Equal content, equal fingerprint: then nothing need be made anew."""

import hashlib
from dataclasses import Field, fields, is_dataclass

import numpy as np

PLAIN_TYPES = str, bytes, int, float, complex, bool, type(None), np.generic


def counted(thing: object) -> list[Field]:
    """Fields of a dataclass that count: all but its name."""
    return [f for f in fields(thing) if f.name != "name"]


def fingerprint(*things: object) -> str:
    """Hash of the content of dataclasses, arrays, tuples and
    plain values: equal content, equal fingerprint.

    Names do not count: an object may be called otherwise after undo or a file load.

    Raises
    ------
    TypeError : a thing without content, such as a function, whose
        address may be another's once it is gone
    """
    digest = hashlib.sha1(usedforsecurity=False)  # many processors have instructions for it

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
