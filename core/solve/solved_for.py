"""Identity of the scene a result was solved for, to check later whether the scene has changed."""

import json
from dataclasses import dataclass

import numpy as np

from ..base.arrays import Floats
from ..base.errors import MALFORMED
from ..base.fingerprint import fingerprint

# float32 error of a place that was left and restored, relative to the bench's size
ROUNDING_OF_PLACES = 4 * 2.0**-23


@dataclass(frozen=True, eq=False)
class SolvedFor:
    """Identity of a rig and its settings.

    content : fingerprint of everything but places
    places : (n, 3, 4) rows of each part and viewer: axes, and origin in m in the last column
    """

    content: str
    places: Floats

    def is_same(self, other: "SolvedFor") -> bool:
        """Whether it is the same rig in the same places, up to rounding.

        A part moved away and back by hand counts as unmoved.
        """
        if self.content != other.content or self.places.shape != other.places.shape:
            return False

        mine, its = self.places, other.places
        axes = np.abs(mine[..., :3]).max(axis=(1, 2), initial=0.0, keepdims=True)
        size = np.abs(mine[..., 3] - mine[:1, :, 3]).max(initial=0.0)
        off = np.abs(mine - its)

        return bool(
            (off[..., :3] <= ROUNDING_OF_PLACES * axes).all()
            and (off[..., 3] <= ROUNDING_OF_PLACES * size).all()
        )

    def as_text(self) -> str:
        """The record as JSON, to store in a file."""
        record = {"version": 1, "content": self.content, "places": self.places.round(12).tolist()}
        return json.dumps(record)


# for a result whose image and numbers come from different scenes
OF_NO_SCENE = SolvedFor("", np.zeros((0, 3, 4)))


def solved_for(things: list[tuple[object, Floats]], rest: object) -> SolvedFor:
    """Identity of things with a place, whatever their order and names, and of the rest.

    things : content, as `fingerprint` takes it, and place (3, 4)
    """
    found = sorted(
        ((fingerprint(thing), place) for thing, place in things), key=lambda pair: pair[0]
    )
    places = np.array([place for _, place in found], float).reshape(-1, 3, 4)
    return SolvedFor(fingerprint(tuple(key for key, _ in found), rest), places)


def from_text(text: str) -> SolvedFor | None:
    """The record of `as_text`; None for any other text."""
    try:
        record = json.loads(text)
        return SolvedFor(record["content"], np.array(record["places"], float).reshape(-1, 3, 4))
    except MALFORMED:
        return None
