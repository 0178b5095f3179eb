"""Messages: a sentence that keeps its template and its values, so that it can be translated.

A message is the English sentence itself, wherever a text is wanted. At the border, where it is
shown, `told` puts it together anew: from a template in another language, in whose order of words
the values stand, and with lengths in the unit of the scene.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from .numbers import millimetres

CONTEXT = "Kiriko"  # of translations: words with the meaning that they have here


@dataclass(frozen=True)
class Length:
    """A length, m, in a message: in millimetres where no scene says which unit its people read."""

    metres: float

    def __str__(self) -> str:
        return millimetres(self.metres)


class Message(str):
    """A constant template and the values that fill it.

    Without values the template is the text as it stands, braces and all. A value may be a
    message itself, which is then translated with the whole.
    """

    template: str
    values: dict[str, object]

    def __new__(cls, template: str, /, **values: object) -> Message:
        if isinstance(template, Message) and not values:
            return template  # it has its own already

        message = super().__new__(cls, template.format(**values) if values else template)
        message.template = template
        message.values = values
        return message

    def in_units(self, length_text: Callable[[float], str]) -> Message:
        """The same with its lengths, m, in words as a function puts them, for good."""

        def settled(value: object) -> object:
            value = getattr(value, "message", value)  # of an error
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
        """The sentence by a translated template, with lengths, m, as a function puts them."""
        template = translate(self.template)
        if not self.values:
            return template

        def words(value: object) -> object:
            value = getattr(value, "message", value)  # of an error
            if isinstance(value, Length):
                value = length_text(value.metres)
            return value.sentence(translate, length_text) if isinstance(value, Message) else value

        return template.format(**{name: words(value) for name, value in self.values.items()})


def as_message(template: str) -> Message:
    """A text that was a constant or a message where it was made, as a value of a message: it is
    translated as a whole. Names of an artist's things are none.
    """
    return Message(template)


def as_sentence(phrase: str) -> Message:
    """A phrase with its full stop; one that is a sentence stays."""
    return as_message(phrase) if phrase.endswith(".") else Message("{reason}.", reason=phrase)


def quoted(names: Iterable[str]) -> Message:
    """Names in quotation marks, as a list."""
    return joined([Message("'{name}'", name=name) for name in names], ", ")


def joined(parts: Iterable[str], between: str = " ") -> Message:
    """Several messages as one, each of which is translated by itself, and the text between them."""
    values: dict[str, object] = {f"part{n}": part for n, part in enumerate(parts)}
    template = "{between}".join(f"{{{name}}}" for name in values)
    return Message(template, between=as_message(between), **values)
