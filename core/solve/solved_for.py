"""The scene that a result was solved for, in few numbers: they
tell later whether the scene is still that one.
"""

import json
from dataclasses import dataclass

import numpy as np

from ..base.arrays import Floats
from ..base.errors import MALFORMED
from ..base.fingerprint import fingerprint

# of the bench's size: the error, in float32, of a place that was left and returned to
ROUNDING_OF_PLACES = 4 * 2.0**-23


@dataclass(frozen=True, eq=False)
class SolvedFor:
    """A rig with its settings, told apart from others by content.

    content : fingerprint of all but places
    places : (n, 3, 4) rows, where parts and viewers stand: their
        axes, and their origins in m in the last column
    """

    content: str
    places: Floats

    def is_same(self, other: "SolvedFor") -> bool:
        """Is it the same rig, in the same places but for rounding?
        Moved away and back by hand counts as the same.
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
        """As JSON, to be kept in a file."""
        kept = {"version": 1, "content": self.content, "places": self.places.round(12).tolist()}
        return json.dumps(kept)


# of a result whose image is of another scene than its numbers
OF_NO_SCENE = SolvedFor("", np.zeros((0, 3, 4)))


def solved_for(things: list[tuple[object, Floats]], rest: object) -> SolvedFor:
    """Of things that each stand somewhere, whatever their order
    and names, and of all that stands nowhere.

    things : content, as `fingerprint` takes it, and place (3, 4)
    """
    found = sorted(
        ((fingerprint(thing), place) for thing, place in things), key=lambda pair: pair[0]
    )
    places = np.array([place for _, place in found], float).reshape(-1, 3, 4)
    return SolvedFor(fingerprint(tuple(key for key, _ in found), rest), places)


def from_text(text: str) -> SolvedFor | None:
    """The record of `as_text`; None where there is nothing, as in
    results of earlier versions, or another text.
    """
    try:
        kept = json.loads(text)
        return SolvedFor(kept["content"], np.array(kept["places"], float).reshape(-1, 3, 4))
    except MALFORMED:
        return None
