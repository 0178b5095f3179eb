"""Errors a user can act on: one sentence with the fault, its place and the remedy."""

import re

from .messages import Message


def one_line(text: str) -> str:
    """A text without line breaks and other control characters, which names of objects may have."""
    return re.sub(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]+", " ", text)


# what taking apart a text that anybody may have written can raise
MALFORMED = (
    *(ValueError, LookupError, TypeError, AttributeError),
    *(OverflowError, RecursionError),  # infinity as a whole number; brackets in brackets
)


class KirikoError(Exception):
    """Base of all errors whose text is meant for the user:
    one line, whatever is in the names of objects.

    template : the sentence, a constant, with the names of values in braces
    values : what fills it; without any the template is the text as it stands
    """

    def __init__(self, template: str = "", /, **values: object) -> None:
        self.message = Message(template, **values)
        super().__init__(self.message)

    def __str__(self) -> str:
        return one_line(self.message)


class RigError(KirikoError):
    """The rig cannot be solved as it stands: a part is missing, broken or in the wrong place."""


class MeshError(KirikoError):
    """A mesh cannot be traced: empty, not finite, or without the UV map its role needs."""


class ImageError(KirikoError):
    """An image cannot be read or written."""
