"""Records that a scene keeps as text in its string properties.

Each is JSON with a version, and so is the record of what a result was solved for, which
`core/solve/solved_for.py` reads and writes. A text without a version is of Kiriko 0.1. An empty
text is an empty record; a text that is no JSON raises ValueError.
"""

import json
from dataclasses import dataclass, field
from typing import Any

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


def _items(text: str, name: str) -> list[Any]:
    """The list that a record is made of; it was all of the text in 0.1."""
    kept = json.loads(text or "[]")
    return kept[name] if isinstance(kept, dict) else kept
