"""Where Add Rig stands the picture in glass as artists bring it, and how much of it arrives.

`python3 scripts/dev.py placement [--glass NAME ...] [--side MM]`. `middle` is the share of a
picture half as large as the glass that arrives from the middle of its box, as it stood before;
`found` that from the place that is found, on a display as large as it may be. `side` is the
picture's, in mm; `at` its middle, in mm to the right and up from the middle of the glass, and
towards the viewer. `display` is the width of a square display for all of that light, in widths of
the picture; `s` are the seconds of the search, once the glass is ready.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from time import perf_counter

import numpy as np

from kiriko.core.base.steps import finish
from kiriko.core.bench.initial_placement import Request, settle
from kiriko.core.bench.placement import Proposal, Wishes, propose, viewer_of
from kiriko.core.bench.spread import Spread, spread_of
from kiriko.core.rig.rig import ConstantIndex, Glass, Rig
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session

from .brought_glass import INDICES, add_glass_option, made

PIXELS = 512, 512


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add_glass_option(parser)
    parser.add_argument(
        "--side", type=float, default=0.0, metavar="MM", help="of a picture that has a size already"
    )
    arguments = parser.parse_args()
    wishes = Wishes(picture=1e-3 * arguments.side)
    print(f"{'':18}{'middle':>8}{'found':>8}   side  at{'':16}display     s")
    for name in arguments.glass:
        mesh = made(name)
        mesh = replace(mesh, vertices=mesh.vertices - mesh.bounds.mean(axis=0))
        report(name, Glass(name, mesh, ConstantIndex(INDICES.get(name, 1.49))), wishes)


def report(name: str, glass: Glass, wishes: Wishes) -> None:
    """Print the line of a glass in the middle of the world."""
    bench = Rig(viewers=(), glasses=(glass,), plates=(), displays=())
    bounds = glass.mesh.bounds
    proposal = propose(bounds, wishes)
    request = Request(bench, bounds, wishes, viewer_of(proposal, PIXELS), PIXELS)
    session = Session()

    def plan_of(rig: Rig):
        return session.plan(rig, Settings())

    before = finish(spread_of(plan_of(request.rig(proposal)), proposal.placement.display))
    started = perf_counter()
    found, after = finish(settle(request, proposal, plan_of))
    seconds = perf_counter() - started
    print(line(name, before, found, after, seconds), flush=True)


def line(name: str, before: Spread, found: Proposal, after: Spread, seconds: float) -> str:
    """The line of a glass."""
    shares = [100 * (1 - sum(spread.lost.values())) for spread in (before, after)]
    right, away, up = 1e3 * found.placement.picture[:3, 3] + 0.0
    wide = after.width(1.0) / found.picture
    place = " ".join(f"{x:6.1f}" for x in np.round([right, up, -away], 1) + 0.0)
    return (
        f"{name:18}{shares[0]:6.1f} %{shares[1]:6.1f} %  {1e3 * found.picture:5.1f} {place}"
        f"{wide:7.2f} x{seconds:6.1f}"
    )


if __name__ == "__main__":
    main()
