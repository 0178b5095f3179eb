"""Records that a scene keeps as text in its string properties.

Each is JSON with a version, and so is the record of what a result was solved for, which
`core/solve/solved_for.py` reads and writes. A text without a version is of Kiriko 0.1. An empty
text is an empty record; a text that is no JSON raises ValueError.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from numbers import Integral, Real
from typing import Any

from ..errors import one_line
from ..messages import Message, as_message

RECORD_VERSION = 1


@dataclass(frozen=True)
class Offset:
    """Amounts by which the rig is off, by the parameters' names, a set for each calibration."""

    sets: list[dict[str, float]] = field(default_factory=list)

    @classmethod
    def read(cls, text: str) -> "Offset":
        """The record of a text."""
        return cls(_items(text, "sets"))

    def text(self) -> str:
        """As a scene keeps it."""
        return json.dumps({"version": RECORD_VERSION, "sets": self.sets})


@dataclass(frozen=True)
class Ladder:
    """Tolerances (display px) and the seconds they took, as the last report measured."""

    rungs: list[tuple[float, float]] = field(default_factory=list)

    @classmethod
    def read(cls, text: str) -> "Ladder":
        """The record of a text."""
        return cls(_items(text, "rungs"))

    def text(self) -> str:
        """As a scene keeps it."""
        return json.dumps({"version": RECORD_VERSION, "rungs": self.rungs})


@dataclass(frozen=True)
class Changed:
    """Changes of one thing that was there before, by `changes.py`: path, value before and after.

    rig : key of the rig that was made meanwhile
    """

    rig: str = ""
    changes: list[list[Any]] = field(default_factory=list)

    @classmethod
    def read(cls, text: str) -> "Changed":
        """The record of a text."""
        kept = json.loads(text or "{}")
        return cls(kept.get("rig", ""), kept.get("changes", []))

    def text(self) -> str:
        """As a scene keeps it."""
        return json.dumps({"version": RECORD_VERSION, "rig": self.rig, "changes": self.changes})


@dataclass(frozen=True)
class Numbers:
    """Numbers by name: of the last result, as `result.py` writes them, or of the last calibration.

    Those of earlier versions lack some names.
    """

    by_name: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def read(cls, text: str) -> "Numbers":
        """The record of a text."""
        by_name = json.loads(text or "{}")
        by_name.pop("version", None)
        return cls(by_name)

    def text(self) -> str:
        """As a scene keeps it."""
        return json.dumps({"version": RECORD_VERSION, **self.by_name})


@dataclass(frozen=True)
class Sentences:
    """Messages by the English sentences that a scene keeps, so that they are told in the language
    of whoever reads them. Lengths are in words already.
    """

    by_text: dict[str, Message] = field(default_factory=dict)

    @classmethod
    def of(cls, *things: Any) -> "Sentences":
        """The messages in nested dictionaries and sequences."""
        found = {one_line(message): message for message in _messages_in(things)}
        return cls({text: message for text, message in found.items() if message.values})

    @classmethod
    def read(cls, text: str) -> "Sentences":
        """The record of a text."""
        kept = json.loads(text or "{}").get("by_text", {})
        return cls({sentence: _message(data) for sentence, data in kept.items()})

    def text(self) -> str:
        """As a scene keeps it."""
        by_text = {sentence: _data(message) for sentence, message in self.by_text.items()}
        return json.dumps({"version": RECORD_VERSION, "by_text": by_text})

    def message(self, text: str) -> Message:
        """The message that a sentence was; of one that had no values, or is unknown, a message
        without any.
        """
        return self.by_text.get(text, as_message(text))


def _messages_in(thing: Any) -> Iterator[Message]:
    if isinstance(thing, Message):
        yield thing
    elif isinstance(thing, dict):
        for key, value in thing.items():
            yield from _messages_in((key, value))
    elif isinstance(thing, list | tuple):
        for part in thing:
            yield from _messages_in(part)


def _data(value: Any) -> Any:
    """A message as plain data, and a value of one as a number or a text."""
    value = getattr(value, "message", value)  # of an error
    if isinstance(value, Message):
        values = {name: _data(part) for name, part in value.values.items()}
        return {"template": value.template, "values": values}
    if isinstance(value, Integral):
        return int(value)
    return float(value) if isinstance(value, Real) else str(value)


def _message(data: dict[str, Any]) -> Message:
    values = {
        name: _message(value) if isinstance(value, dict) else value
        for name, value in data["values"].items()
    }
    template = data["template"]
    return Message(template, **values)


def _items(text: str, name: str) -> list[Any]:
    """The list that a record is made of; it was all of the text in 0.1."""
    kept = json.loads(text or "[]")
    return kept[name] if isinstance(kept, dict) else kept
