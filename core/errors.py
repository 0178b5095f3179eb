"""Errors a user can act on: one sentence that says what is wrong, where, and what to do."""


class KirikoError(Exception):
    """Base of all errors whose text is meant for the user: one line, whatever is in the names of objects."""

    def __str__(self) -> str:
        return " ".join(super().__str__().split())


class RigError(KirikoError):
    """The rig cannot be solved as it stands: a part is missing, broken or in the wrong place."""


class MeshError(KirikoError):
    """A mesh cannot be traced: empty, not finite, or without the UV map its role needs."""


class ImageError(KirikoError):
    """An image cannot be read or written."""
