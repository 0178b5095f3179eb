"""Compares Show Window's pixels on the screen with the file of the source image.

Plays glass, picture, Solve, Export and Show Window in the real Blender, reads the screen, and reads
the exported PNG by Pillow. Prints how many pixels differ, in the image and around it, where they
have to be black. Ends with 1 if a pixel differs.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from environments import ToolError
from manual.program import add_options, play

if TYPE_CHECKING:
    from PIL import Image

PLAY = "shown"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    add_options(parser)
    arguments = parser.parse_args()
    try:
        folder = play([PLAY], arguments.blender, arguments.extension)
    except ToolError as error:
        sys.exit(str(error))
    sys.exit(0 if is_shown(folder) else 1)


def is_shown(folder: Path) -> bool:
    """Whether the image on the screen equals the file; prints the differences."""
    # not at the top, because dev.py shows the options in a Python without Pillow
    from PIL import Image

    told = json.loads((folder / "shown.json").read_text(encoding="utf-8"))
    width, height = told["window"]
    window = Image.frombytes("RGB", (width, height), (folder / "shown.rgb").read_bytes())
    window.save(folder / "shown.png")
    left, below, across, up = told["region"]
    screen = window.crop((left, height - below - up, left + across, height - below))
    with Image.open(folder / "source.png") as file:
        wanted = file.convert("RGB")
    columns, rows = wanted.size
    if columns > across or rows > up:
        print(f"The window has {across} x {up} pixels, too few for {columns} x {rows}.")
        return False

    # in the middle, on black
    place = (across - columns) // 2, up - (up - rows) // 2 - rows
    expected = Image.new("RGB", screen.size)
    expected.paste(wanted, place)
    box = (*place, place[0] + columns, place[1] + rows)
    n_all = differing(screen, expected)
    n_image = differing(screen.crop(box), wanted)
    n_colours = len(wanted.getcolors(columns * rows))
    print(
        f"Show Window, {across} x {up} pixels of the screen, against the file, {columns} x {rows}"
        f" pixels in {n_colours} colours: {n_image} of {columns * rows} pixels differ; of"
        f" {across * up - columns * rows} around it {n_all - n_image} are not black."
    )
    print(f"The screenshot is {folder / 'shown.png'}.")
    return n_all == 0


def differing(one: Image.Image, other: Image.Image) -> int:
    """How many pixels of two images of one size are not the same."""
    from PIL import ImageChops

    red, green, blue = ImageChops.difference(one, other).split()
    largest = ImageChops.lighter(ImageChops.lighter(red, green), blue)
    return one.width * one.height - largest.histogram()[0]


if __name__ == "__main__":
    main()
