"""What helps where some of a picture is lost, and by how much: for a list of things to do.

Each remedy is found as by its own button, with fewer rays, and only those that bring something
back are told. An operator's name stands with each, so that a list can have a button for it.
"""

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from ..errors import RigError
from ..light.landings import REASON_WORDS, Reason
from ..messages import Length, Message, joined
from ..rig import Rig
from ..steps import within
from ..words import percent
from .best_place import Limits, best_place
from .picture_room import fit_picture, plane_of
from .room import PlanOf, Wanted, fit_display, fit_plate, traced

N_GRID = 32  # points along each edge of a triangle of the picture
WORTH_IT = 1e-3  # share of the picture that a remedy has to bring back
REACH = 0.5  # of the picture's longer side: so far it may move


@dataclass(frozen=True)
class Help:
    """A remedy.

    operator : the button that does it; text : a clause, as "make the plate 20 mm larger"
    after : share of the picture that then arrives
    """

    operator: str
    text: Message
    after: float


@dataclass(frozen=True)
class Helps:
    """The share of the picture that arrives, shares that do not by
    reason, and what helps, the most helpful first.
    """

    share: float
    lost: dict[str, float]
    helps: tuple[Help, ...]

    @property
    def text(self) -> Message:
        """One sentence: "3 % of the picture missed the plate: make the plate 20 mm larger"."""
        lost = joined(
            [
                Message("{share} {reason}", share=percent(share), reason=reason)
                for reason, share in sorted(self.lost.items(), key=lambda item: -item[1])
            ],
            ", ",
        )
        if not self.helps:
            return Message("Of the picture {lost}.", lost=lost)
        ways = joined([help.text for help in self.helps], " / ")
        return Message("Of the picture {lost}: {ways}.", lost=lost, ways=ways)


def what_helps(rig: Rig, plan_of: PlanOf) -> Generator[float, None, Helps]:
    """Find what brings lost light of the picture back; yields progress 0..1."""
    before = yield from within(traced(rig, plan_of, N_GRID), 0.0, 0.1)
    lost = {reason: share for reason, share in before.lost.items() if share > WORTH_IT}
    if not lost:
        return Helps(before.share, lost, ())

    remedies = [_by_picture, _by_place]
    if REASON_WORDS[Reason.MISSED_DISPLAY] in lost:
        remedies.insert(0, _by_display)
    if REASON_WORDS[Reason.MISSED_PLATE] in lost and rig.plates:
        remedies.insert(0, _by_plate)

    found = []
    for n, remedy in enumerate(remedies):
        start = 0.1 + 0.9 * n / len(remedies)
        try:
            steps = remedy(rig, plan_of)
            found.append((yield from within(steps, start, start + 0.9 / len(remedies))))
        except RigError:
            pass  # it is no remedy for this rig
    helps = [help for help in found if help.after > before.share + WORTH_IT]
    return Helps(before.share, lost, tuple(sorted(helps, key=lambda help: -help.after)))


def _by_plate(rig: Rig, plan_of: PlanOf) -> Generator[float, None, Help]:
    fitted = yield from fit_plate(rig, plan_of, Wanted(n_grid=N_GRID))
    text = Message("make the plate {more} larger", more=Length(fitted.more))
    return Help("kiriko.fit_plate", text, fitted.after)


def _by_display(rig: Rig, plan_of: PlanOf) -> Generator[float, None, Help]:
    fitted = yield from fit_display(rig, plan_of, Wanted(n_grid=N_GRID))
    text = Message("make the display {more} larger", more=Length(fitted.more))
    return Help("kiriko.fit_display", text, fitted.after)


def _by_picture(rig: Rig, plan_of: PlanOf) -> Generator[float, None, Help]:
    fitted = yield from fit_picture(rig, plan_of, Wanted(share=1 - WORTH_IT, n_grid=N_GRID))
    text = Message("make the picture {width} wide", width=Length(fitted.width))
    return Help("kiriko.fit_picture_size", text, fitted.after)


def _by_place(rig: Rig, plan_of: PlanOf) -> Generator[float, None, Help]:
    side = float(np.linalg.norm(plane_of(rig).sides, axis=1).max())
    found = yield from best_place(rig, plan_of, Limits(shift=REACH * side))
    # its shares are of more rays than the others'
    after = found.after if found.after > found.before + WORTH_IT else 0.0
    return Help("kiriko.best_place", Message("move it"), after)
