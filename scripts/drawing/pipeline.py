"""The pipeline as one drawing, with a cut pixel in it: `dev.py pipeline`.

The boxes name the nouns and their files, the arrows the verbs and theirs. All below them is of a
real solve: the cube of the reference rig, leaned to the side, in few pixels.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from kiriko.core.lab.measure.diagram import FONT

from .panels import panels
from .solved import Solved, solved
from .svg import FILE, GREY, NOUN, VERB, Font, line, text

PATH = Path(__file__).resolve().parents[2] / "docs" / "pictures" / "pipeline.svg"

# px
WIDTH = 1160
HEIGHT = 610
FIRST_LEFT = 25
BOX_WIDTH = 118
BOX_HEIGHT = 44
BOX_STEP = 198
BOX_TOP = 42
SECOND_TOP = 132  # of the boxes in the second row

TIP = 'stroke-width="1.5" marker-end="url(#tip)"'

# noun, its file; the verb that makes the next one, its file
NOUNS = (
    ("Blender scene", "", "read", "blender/scene.py"),
    ("Rig", "rig/rig.py", "plan", "light/compile_plan.py"),
    ("Plan", "light/plan.py", "sample", "map/sampling.py"),
    ("View map", "map/view_map.py", "rasterise", "map/rasterise.py"),
    ("Shares", "map/shares.py", "paint", "image/source_image.py"),
    ("Source image", "", "", ""),
)
# noun, its file, and the number of the box above it
SECOND_NOUNS = (
    ("Picture's place", "rig/parts.py", 3),
    ("Picture's pixels", "image/pyramid.py", 4),
    ("Seen image", "image/seen_image.py", 5),
)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--path", type=Path, default=PATH, help="of the SVG file")
    parser.parse_args().path.write_text(drawn(solved()), encoding="utf-8")


def drawn(found: Solved) -> str:
    """The whole drawing, as SVG."""
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{HEIGHT}"'
        f' viewBox="0 0 {WIDTH} {HEIGHT}" font-family="{FONT}" font-size="12">'
    )
    tip = (
        '<marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8"'
        f' orient="auto"><path d="M0,0 L8,4 L0,8 z" fill="{GREY}"/></marker>'
    )
    white = f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>'
    return "\n".join([head, tip, white, *pipeline(), *panels(found), "</svg>", ""])


def pipeline() -> Iterator[str]:
    """The boxes and the arrows between them."""
    middle = BOX_TOP + BOX_HEIGHT / 2
    for n, (noun, file, verb, by) in enumerate(NOUNS):
        left = FIRST_LEFT + n * BOX_STEP
        yield from box(left, BOX_TOP, noun, file)
        if verb:
            start, end = left + BOX_WIDTH + 3, left + BOX_STEP - 3
            yield line(np.array([[start, middle], [end, middle]]), GREY, TIP)
            yield text((start + end) / 2, middle - 7, verb, VERB)
            yield text((start + end) / 2, BOX_TOP - 12, by, FILE)

    for noun, file, n in SECOND_NOUNS:
        yield from box(FIRST_LEFT + n * BOX_STEP, SECOND_TOP, noun, file)
    yield from second_arrows()


def second_arrows() -> Iterator[str]:
    """Arrows from and to the boxes of the second row, with their words."""
    first = FIRST_LEFT + BOX_WIDTH / 2
    rig, place, pixels, source = (first + n * BOX_STEP for n in (1, 3, 4, 5))
    bottom = BOX_TOP + BOX_HEIGHT + 3
    row = SECOND_TOP + BOX_HEIGHT / 2
    above = SECOND_TOP - 3
    verbs = BOX_TOP + BOX_HEIGHT / 2 + 6

    # the rig knows the picture's place; it cuts the cells, and the pixels are painted
    yield line(np.array([[rig, bottom], [rig, row]]), GREY, 'stroke-width="1.5"')
    yield line(np.array([[rig, row], [place - BOX_WIDTH / 2 - 3, row]]), GREY, TIP)
    half = BOX_STEP / 2
    yield line(np.array([[place + 30, above], [place + half - 4, verbs]]), GREY, TIP)
    yield text(place + 66, above - 22, "outline", Font(weight="bold"))
    yield text(place + 56, above - 9, "image/outline.py", Font(size=10, fill=GREY))
    yield line(np.array([[pixels + 30, above], [pixels + half - 4, verbs]]), GREY, TIP)
    yield text(pixels + 66, above - 16, "colours", Font(weight="bold"))
    yield line(np.array([[source, bottom], [source, above]]), GREY, TIP)
    yield text(source - 8, above - 17, "simulate", Font("end", weight="bold"))
    beneath = SECOND_TOP + BOX_HEIGHT + 14
    words = "compared with the ideal image"
    yield text(source + BOX_WIDTH / 2, beneath, words, Font("end", size=10, fill=GREY))


def box(left: float, top: float, noun: str, file: str) -> Iterator[str]:
    """A noun, and the file that has it."""
    yield (
        f'<rect x="{left}" y="{top}" width="{BOX_WIDTH}" height="{BOX_HEIGHT}" rx="5"'
        f' fill="#f4f8fa" stroke="{GREY}"/>'
    )
    x = left + BOX_WIDTH / 2
    yield text(x, top + (20 if file else 27), noun, NOUN)
    yield text(x, top + 35, file, FILE)


if __name__ == "__main__":
    main()
