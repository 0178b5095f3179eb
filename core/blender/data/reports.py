"""Blender's reports on failed operators."""


def said_by(reason: RuntimeError) -> str:
    """The text of such an error, in one line."""
    return " ".join(str(reason).split()).removeprefix("Error: ")
