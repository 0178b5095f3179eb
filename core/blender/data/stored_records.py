"""Records stored as text in string properties of a file.

Each is JSON with a version and a checksum. A damaged or edited text, or one of another version,
counts as an empty record: it is reported once, and buttons still work.
"""

import hashlib
import json
import re
import string
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from numbers import Integral, Real
from typing import Any

from ...base.errors import MALFORMED, one_line
from ...base.messages import Message, as_message

RECORD_VERSION = 1
SHOWN = 60  # quoted characters of an unreadable record
LONGEST = 2000  # characters of a sentence composed from a file's text
SPEC = re.compile(r"(\.\d)?[efg]?")  # no width: a file could ask for a billion spaces

_reported: set[str] = set()
_unreported: list[Message] = []


def text_of(fields: dict[str, Any]) -> str:
    """A record as stored text."""
    fields = {"version": RECORD_VERSION, **fields}
    return json.dumps({**fields, "checksum": _checksum(fields)})


def fields_of(text: object) -> dict[str, Any]:
    """The fields of a record's text; none if it is empty or unreadable."""
    if not text:
        return {}
    try:
        fields = json.loads(text)
        if fields.pop("checksum") == _checksum(fields) and fields.pop("version") == RECORD_VERSION:
            return fields
    except MALFORMED:
        pass

    if (shown := str(text)[:SHOWN]) not in _reported:
        _reported.add(shown)
        _unreported.append(
            Message(
                "Kiriko ignores a damaged record, or one of another version, in this file: {start}",
                start=shown,
            )
        )
    return {}


def take_reports() -> list[Message]:
    """Reports on unreadable records since the last call."""
    reports = _unreported.copy()
    _unreported.clear()
    return reports


def _checksum(fields: dict[str, Any]) -> str:
    return hashlib.sha1(json.dumps(fields).encode(), usedforsecurity=False).hexdigest()


@dataclass(frozen=True)
class Offset:
    """Deviations of the rig by parameter name, a set for each calibration."""

    sets: list[dict[str, float]] = field(default_factory=list)

    @classmethod
    def read(cls, text: str) -> "Offset":
        """Parse a stored text."""
        sets = fields_of(text).get("sets", [])
        is_list = isinstance(sets, list) and all(isinstance(one, dict) for one in sets)
        return cls(sets if is_list else [])

    def text(self) -> str:
        """The record as stored text."""
        return text_of({"sets": self.sets})


@dataclass(frozen=True)
class Ladder:
    """Tolerances (display px) and their seconds, measured by the last report."""

    rungs: list[tuple[float, float]] = field(default_factory=list)

    @classmethod
    def read(cls, text: str) -> "Ladder":
        """Parse a stored text."""
        return cls(fields_of(text).get("rungs", []))

    def text(self) -> str:
        """The record as stored text."""
        return text_of({"rungs": self.rungs})


@dataclass(frozen=True)
class Changed:
    """Changes of one thing, by `changes.py`: path, value before and after.

    rig : key of the rig made meanwhile
    """

    rig: str = ""
    changes: list[list[Any]] = field(default_factory=list)

    @classmethod
    def read(cls, text: str) -> "Changed":
        """Parse a stored text."""
        fields = fields_of(text)
        changes = fields.get("changes", [])
        is_list = isinstance(changes, list) and all(isinstance(one, list) for one in changes)
        return cls(str(fields.get("rig", "")), changes if is_list else [])

    def text(self) -> str:
        """The record as stored text."""
        return text_of({"rig": self.rig, "changes": self.changes})


@dataclass(frozen=True)
class StoredNumbers:
    """Numbers by name, of the last result or the last calibration."""

    by_name: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def read(cls, text: str) -> "StoredNumbers":
        """Parse a stored text."""
        return cls(fields_of(text))

    def text(self) -> str:
        """The record as stored text."""
        return text_of(self.by_name)


@dataclass(frozen=True)
class Sentences:
    """Messages by their stored English sentences, so each reader sees them in his own language.
    Lengths are already formatted.
    """

    by_text: dict[str, Message] = field(default_factory=dict)

    @classmethod
    def of(cls, *things: Any) -> "Sentences":
        """The messages in nested dictionaries and sequences."""
        found = {one_line(message): message for message in _messages_in(things)}
        return cls({text: message for text, message in found.items() if message.values})

    @classmethod
    def read(cls, text: str) -> "Sentences":
        """Parse a stored text."""
        found = {}
        for sentence, data in fields_of(text).get("by_text", {}).items():
            with suppress(*MALFORMED):
                found[sentence] = _message(data)
        return cls(found)

    def text(self) -> str:
        """The record as stored text."""
        by_text = {sentence: _data(message) for sentence, message in self.by_text.items()}
        return text_of({"by_text": by_text})

    def message(self, text: str) -> Message:
        """The message of a sentence; without values if the sentence had none or is unknown."""
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
    """A message as plain data; any other value as a number or a text."""
    value = getattr(value, "message", value)  # for an error
    if isinstance(value, Message):
        values = {name: _data(part) for name, part in value.values.items()}
        return {"template": value.template, "values": values}
    if isinstance(value, Integral):
        return int(value)
    return float(value) if isinstance(value, Real) else str(value)


def _message(data: dict[str, Any]) -> Message:
    """The message of such data. The data is untrusted: plain fields only, and of bounded length.

    Raises
    ------
    ValueError
        The template has fields other than plain names of values, or the text is too long.
    """
    values = {
        name: _message(value) if isinstance(value, dict) else value
        for name, value in data["values"].items()
    }
    template = str(data["template"])[:LONGEST]
    for _, name, spec, conversion in string.Formatter().parse(template):
        if name is not None and (conversion or name not in values or not SPEC.fullmatch(spec)):
            raise ValueError(template)
    message = Message(template, **values)
    if len(message) > LONGEST:
        raise ValueError(template)
    return message
