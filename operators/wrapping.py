"""Sentences broken into lines as wide as the region that they are drawn in: the sidebar's panels
and dialogues.
"""

import re
import unicodedata
from functools import lru_cache

import blf
import bpy

from .telling import in_words

FONT = 0  # Blender's own, which its labels are drawn in
POINTS = 11.0  # its size at a scale of 1, where the theme does not tell
MARGIN = 88  # px beside the text: borders, tabs, icon, and the space before the text is cut
LEAST = 60.0  # px: in a region that is narrower the text is cut off
WIDE = {"W", "F"}  # Unicode's word for letters of scripts that are written without spaces
ENDING, BEGINNING = {"Pe", "Pf", "Po"}, {"Ps", "Pi"}  # marks that end and begin words
# what a number is not parted from
UNIT = re.compile(r"(?<=\d )(%|[kcm]?m|px|s)(?!\w)")
# kana and the mark of a long vowel, with which no line of Japanese begins
LONGEST = 2000  # characters of a sentence: a file may hold a text of any length
SMALL = set("ぁぃぅぇぉっゃゅょァィゥェォッャュョー")


def sentence(
    layout: bpy.types.UILayout, context: bpy.types.Context, text: str, icon: str = "NONE"
) -> None:
    """Draw a sentence over as many lines as it takes; the icon stands at the first."""
    scale = context.preferences.system.ui_scale
    column = layout.column(align=True)
    column.scale_y = 0.8
    width = max(LEAST, context.region.width / scale - MARGIN)
    for n, line in enumerate(wrapped(in_words(text)[:LONGEST], width, points_of(context))):
        column.label(text=line, icon=icon if n == 0 else ("NONE" if icon == "NONE" else "BLANK1"))


def points_of(context: bpy.types.Context) -> float:
    """The size of the letters of labels at a scale of 1."""
    styles = context.preferences.ui_styles
    return float(styles[0].widget.points) if len(styles) else POINTS


@lru_cache(maxsize=512)  # panels are drawn again at each move of the mouse
def wrapped(text: str, width: float, points: float = POINTS) -> tuple[str, ...]:
    """Lines no wider than `width`, px, in Blender's own font.

    A line ends at a space, or anywhere beside a letter of a script without spaces, such as
    Japanese, but not before a mark that closes, nor after one that opens, nor between a number and
    its unit. A word that is wider than a line, such as a path, is cut.
    """
    blf.size(FONT, points)
    lines: list[str] = []
    line = ""
    for piece in pieces(" ".join(text.split())):
        if line and blf.dimensions(FONT, (line + piece).rstrip())[0] > width:
            lines.append(line.rstrip())
            line = ""
        while not line and len(piece) > 1 and blf.dimensions(FONT, piece.rstrip())[0] > width:
            n = _fitting(piece, width)
            lines.append(piece[:n])
            piece = piece[n:]

        line += piece

    return (*lines, line.rstrip()) if line.strip() else tuple(lines)


def _fitting(piece: str, width: float) -> int:
    """How many letters of a piece fit in a line, one at least."""
    low, high = 1, len(piece)
    while high - low > 1:
        middle = (low + high) // 2
        if blf.dimensions(FONT, piece[:middle])[0] > width:
            high = middle
        else:
            low = middle
    return low


def pieces(text: str) -> list[str]:
    """A text in pieces between which a line may end; together they are the text."""
    found: list[str] = []
    start = 0
    for k in range(1, len(text)):
        if _is_break(text[k - 1], text[k]) and not UNIT.match(text, k):
            found.append(text[start:k])
            start = k

    return [*found, text[start:]] if text else []


def _is_break(before: str, after: str) -> bool:
    """May a line end between two letters that follow each other?"""
    if before == " ":
        return True

    is_wide = any(unicodedata.east_asian_width(letter) in WIDE for letter in (before, after))
    is_held = (
        after in SMALL
        or unicodedata.category(after) in ENDING
        or unicodedata.category(before) in BEGINNING
    )
    return is_wide and not is_held and after != " "
