"""Counts the clicks from selected glass to a visible picture and to an exported file, and checks
the positions of the main buttons.

Plays each task in the real Blender with mouse and keyboard events. The picture is visible when the
viewport shows the viewer's view and the source image is final; it is exported when the file exists.
Events that search for a button are not counted. Ends with 1 if a task takes more clicks than
allowed, if its clicks and its steps differ, if a step is impossible, or if a main button moves in
any state of the checklist, of Live or of Solve.
"""

from __future__ import annotations

import argparse
import sys

from environments import ToolError
from manual.plays import WAYS, Way
from manual.program import account, add_options, play


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    add_options(parser)
    parser.add_argument("--only", default="", metavar="WORD", help="ways with this word")
    arguments = parser.parse_args()
    ways = {name: way for name, way in WAYS.items() if arguments.only in name}
    if not ways:
        parser.error(f"no way has the word {arguments.only}: there are {', '.join(WAYS)}")
    try:
        folder = play(list(ways), arguments.blender, arguments.extension)
        accounts = {name: account(folder, name) for name in ways}
    except ToolError as error:
        sys.exit(str(error))

    is_more = False
    print(f"{'way':<30} {'clicks':>6} {'at most':>8} {'keys':>5} {'scrolls':>8} {'waits s':>9}  of")
    for name, way in ways.items():
        told = accounts[name]
        clicks = told["n_clicks"]
        is_more |= is_over(name, way, told) | has_moved(name, told["places"])
        print(
            f"{name:<30} {clicks:>6} {way.at_most:>8} {len(told['keys']):>5}"
            f" {told['scrolls']:>8} {told['seconds']:>9.1f}  {', '.join(told['clicks'])}"
        )
    sys.exit(is_more)


def is_over(name: str, way: Way, told: dict) -> bool:
    """Whether a task takes too many clicks, or a number that differs from its steps; prints
    which.
    """
    clicks, named = told["n_clicks"], len(told["clicks"])
    if clicks != named:
        print(f"{name}: {clicks} clicks were sent, but its steps are {named}.", file=sys.stderr)
    if clicks > way.at_most:
        print(f"{name}: {clicks} clicks, and at most {way.at_most}.", file=sys.stderr)
    return clicks != named or clicks > way.at_most


def has_moved(name: str, places: dict[str, dict[str, int]]) -> bool:
    """Does a measured button have different places in different states? Prints them."""
    moved = False
    for button in next(iter(places.values()), {}):
        found = {state: edges[button] for state, edges in places.items()}
        if len(set(found.values())) > 1:
            moved = True
            print(f"{name}: {button} moves: {found}.", file=sys.stderr)
    if places and not moved:
        print(f"{name}: no main button moves in {len(places)} states: {', '.join(places)}.")
    return moved


if __name__ == "__main__":
    main()
