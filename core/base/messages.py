"""Translatable messages: English sentences with their template and values.

A message is a plain English string. The interface rebuilds it with a translated template and with
lengths in the scene's unit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from .numbers import millimetres

CONTEXT = "Kiriko"  # of translations, to separate Kiriko's words from Blender's


@dataclass(frozen=True)
class Length:
    """A length, m, in a message; shown in millimetres unless a scene sets the unit."""

    metres: float

    def __str__(self) -> str:
        return millimetres(self.metres)


class Message(str):
    """A constant template filled with values.

    Without values the template is used verbatim, braces included. A value may be another message,
    which is translated along with the whole.
    """

    template: str
    values: dict[str, object]

    def __new__(cls, template: str, /, **values: object) -> Message:
        if isinstance(template, Message) and not values:
            return template  # already a message with its own values

        message = super().__new__(cls, template.format(**values) if values else template)
        message.template = template
        message.values = values
        return message

    def in_units(self, length_text: Callable[[float], str]) -> Message:
        """The same message with its lengths, m, fixed as text by `length_text`."""

        def settled(value: object) -> object:
            value = getattr(value, "message", value)  # an error's own message
            if isinstance(value, Length):
                return length_text(value.metres)
            return value.in_units(length_text) if isinstance(value, Message) else value

        return Message(
            self.template, **{name: settled(value) for name, value in self.values.items()}
        )

    def sentence(
        self,
        translate: Callable[[str], str] = str,
        length_text: Callable[[float], str] = millimetres,
    ) -> str:
        """The translated sentence, with lengths, m, formatted by `length_text`."""
        template = translate(self.template)
        if not self.values:
            return template

        def words(value: object) -> object:
            value = getattr(value, "message", value)  # an error's own message
            if isinstance(value, Length):
                value = length_text(value.metres)
            return value.sentence(translate, length_text) if isinstance(value, Message) else value

        return template.format(**{name: words(value) for name, value in self.values.items()})


def as_message(template: str) -> Message:
    """A constant or message as a translatable value of another message; not for names of an
    artist's objects.
    """
    return Message(template)


def as_sentence(phrase: str) -> Message:
    """A phrase with a full stop, unless it already has one."""
    return as_message(phrase) if phrase.endswith(".") else Message("{reason}.", reason=phrase)


def quoted(names: Iterable[str]) -> Message:
    """Names in quotation marks, separated by commas."""
    return joined([Message("'{name}'", name=name) for name in names], ", ")


def joined(parts: Iterable[str], between: str = " ") -> Message:
    """Several messages as one, each translated separately, joined by `between`."""
    values: dict[str, object] = {f"part{n}": part for n, part in enumerate(parts)}
    template = "{between}".join(f"{{{name}}}" for name in values)
    return Message(template, between=as_message(between), **values)
