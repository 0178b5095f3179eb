"""Compares what Show Window has on the screen with the file of the source image, pixel for pixel.

Plays glass, picture, Solve, Export and Show Window in the real Blender, asks the screen what is on
it, and reads the exported PNG by Pillow. Prints how many pixels differ: those of the image, and
those around it, which are to be black. Ends with 1 where one does.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from environments import ToolError
from manual.program import HELP_BLENDER, HELP_EXTENSION, play

PLAY = "shown"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--blender", metavar="PROGRAM", help=HELP_BLENDER)
    parser.add_argument("--extension", type=Path, metavar="ZIP", help=HELP_EXTENSION)
    arguments = parser.parse_args()
    try:
        folder = play([PLAY], arguments.blender, arguments.extension)
    except ToolError as error:
        sys.exit(str(error))
    sys.exit(0 if is_shown(folder) else 1)


def is_shown(folder: Path) -> bool:
    """Is the image on the screen that of the file? Prints what is."""
    # not above, for dev.py shows the options in a Python that has neither
    import numpy as np
    from PIL import Image

    told = json.loads((folder / "shown.json").read_text(encoding="utf-8"))
    width, height = told["window"]
    window = np.frombuffer((folder / "shown.rgb").read_bytes(), np.uint8).reshape(height, width, 3)
    left, below, across, up = told["region"]
    screen = window[height - below - up : height - below, left : left + across]
    file = np.asarray(Image.open(folder / "source.png").convert("RGB"))
    rows, columns = file.shape[:2]
    if columns > across or rows > up:
        print(f"The window has {across} x {up} pixels, too few for {columns} x {rows}.")
        return False

    x, y = (across - columns) // 2, up - (up - rows) // 2 - rows  # in the middle, y downwards
    image = screen[y : y + rows, x : x + columns]
    around = screen.any(axis=2)
    around[y : y + rows, x : x + columns] = False
    differing = (image != file).any(axis=2)
    Image.fromarray(window).save(folder / "shown.png")
    print(
        f"Show Window, {across} x {up} pixels of the screen, beside {columns} x {rows} of the file"
        f" with {len(np.unique(file.reshape(-1, 3), axis=0))} colours: {differing.sum()} of"
        f" {differing.size} pixels differ; of {around.size - file[..., 0].size} around it"
        f" {around.sum()} are not black."
    )
    print(f"The screenshot is {folder / 'shown.png'}.")
    return not (differing.any() or around.any())


if __name__ == "__main__":
    main()
