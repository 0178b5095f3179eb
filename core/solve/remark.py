"""A remark on a solution."""

from collections.abc import Callable
from dataclasses import dataclass

from ..base.messages import Message
from ..base.numbers import millimetres


@dataclass(frozen=True)
class Remark:
    """A note to the user.

    text : with lengths as `Length`
    is_warning : does it tell of light that is lost or goes another way?
    """

    text: Message
    is_warning: bool = False

    def told(self, length_text: Callable[[float], str] = millimetres) -> Message:
        """The sentence, with lengths in words as a function of metres has them."""
        return self.text.in_units(length_text)


def note(template: str, /, **values: object) -> Remark:
    """A remark that informs."""
    return Remark(Message(template, **values))


def warning(template: str, /, **values: object) -> Remark:
    """A remark on light that is lost or goes another way."""
    return Remark(Message(template, **values), is_warning=True)
