"""Errors a user can act on: one sentence with the fault, its place and the remedy."""

import re
from typing import Any, get_args

from .messages import Message, as_message, quoted


def one_line(text: str) -> str:
    """A text without line breaks and control characters, which object names may contain."""
    return re.sub(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]+", " ", text)


# raised by parsing untrusted text
MALFORMED = (
    *(ValueError, LookupError, TypeError, AttributeError),
    *(OverflowError, RecursionError),  # infinity to integer; deeply nested brackets
)


class KirikoError(Exception):
    """Base of all errors shown to the user, always on one line.

    template : constant sentence with the names of values in braces
    values : fill the template; without any, the template is used verbatim
    """

    def __init__(self, template: str = "", /, **values: object) -> None:
        self.message = Message(template, **values)
        super().__init__(self.message)

    def __str__(self) -> str:
        return one_line(self.message)


class RigError(KirikoError):
    """The rig cannot be solved: a part is missing, broken or in the wrong place."""


class MeshError(KirikoError):
    """A mesh cannot be traced: empty, not finite, or without the UV map its role needs."""


class ImageError(KirikoError):
    """An image cannot be read or written."""


def out_of_range(
    owner: str, label: str, value: float | str, least: float, most: float | None = None
) -> RigError:
    """Error for a number that has to lie in least..most or, without `most`, above `least`.

    owner : start of the sentence
    label : the number's name in the interface
    """
    text = value if isinstance(value, str) else f"{value:g}"
    values = {"owner": owner, "name": as_message(label), "value": text, "least": least}
    if most is None:
        return RigError("{owner} has {name} {value}: set it above {least:g}.", **values)
    return RigError(
        "{owner} has {name} {value}: set it from {least:g} to {most:g}.", **values, most=most
    )


def check_choice(owner: str, name: str, value: str, kind: Any) -> None:
    """Raise RigError for a value of a field that is none of the choices of a Literal."""
    if value not in get_args(kind):
        raise RigError(
            "{owner} has {name} '{value}': set it to one of {choices}.",
            owner=owner,
            name=name,
            value=value,
            choices=quoted(get_args(kind)),
        )


def not_finite(owner: str) -> RigError:
    """Error for a number that is not finite."""
    return RigError(
        "{owner} has a number that is not finite: check its drivers and keyframes.", owner=owner
    )
