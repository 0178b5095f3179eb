"""Counts the clicks from selected glass to a picture that is seen, and to a file for the display.

Plays the whole way in the real Blender, by events of mouse and keys, and looks at the result: the
picture is seen when the viewport shows the viewer's sight and the source image is final; it is
exported when the file is there. Counted are the events that were sent, without those by which a
hand that cannot read looks for a place. Ends with 1 where a way takes more clicks than it may,
where its steps are not as many as its clicks, or where one is not possible.
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
        is_more |= is_over(name, way, told)
        print(
            f"{name:<30} {clicks:>6} {way.at_most:>8} {len(told['keys']):>5}"
            f" {told['scrolls']:>8} {told['seconds']:>9.1f}  {', '.join(told['clicks'])}"
        )
    sys.exit(is_more)


def is_over(name: str, way: Way, told: dict) -> bool:
    """Does a way take more clicks than it may, or others than its steps tell of? Says which."""
    clicks, named = told["n_clicks"], len(told["clicks"])
    if clicks != named:
        print(f"{name}: {clicks} clicks were sent, but its steps are {named}.", file=sys.stderr)
    if clicks > way.at_most:
        print(f"{name}: {clicks} clicks, and at most {way.at_most}.", file=sys.stderr)
    return clicks != named or clicks > way.at_most


if __name__ == "__main__":
    main()
