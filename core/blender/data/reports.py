"""Blender's reports on operators of its own that failed."""


def said_by(reason: RuntimeError) -> str:
    """The words of such an error, in one line."""
    return " ".join(str(reason).split()).removeprefix("Error: ")
