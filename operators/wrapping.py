"""Wraps sentences to the width of a sidebar or dialogue."""

import re
import unicodedata
from functools import lru_cache

import blf
import bpy

from .reporting import in_words

FONT = 0  # Blender's font for labels
POINTS = 11.0  # size at a scale of 1, if the theme gives none
MARGIN = 88  # px next to the text: borders, tabs, icon, and a margin
LEAST = 60.0  # px: text is cut off in a narrower region
WIDE = {"W", "F"}  # Unicode line breaking class of scripts without spaces
ENDING, BEGINNING = {"Pe", "Pf", "Po"}, {"Ps", "Pi"}  # closing and opening marks
# units that stay with their number
UNIT = re.compile(r"(?<=\d )(%|[kcm]?m|px|s)(?!\w)")
# kana and the long vowel mark, which begin no line of Japanese
LONGEST = 2000  # characters of a sentence; a file may hold a text of any length
SMALL = set("ぁぃぅぇぉっゃゅょァィゥェォッャュョー")


def sentence(
    layout: bpy.types.UILayout, context: bpy.types.Context, text: str, icon: str = "NONE"
) -> None:
    """Draw a sentence over as many lines as it needs, with the icon at the first."""
    scale = context.preferences.system.ui_scale
    column = layout.column(align=True)
    column.scale_y = 0.8
    width = max(LEAST, context.region.width / scale - MARGIN)
    for n, line in enumerate(wrapped(in_words(text)[:LONGEST], width, points_of(context))):
        column.label(text=line, icon=icon if n == 0 else ("NONE" if icon == "NONE" else "BLANK1"))


def points_of(context: bpy.types.Context) -> float:
    """Font size of labels at a scale of 1."""
    styles = context.preferences.ui_styles
    return float(styles[0].widget.points) if len(styles) else POINTS


@lru_cache(maxsize=512)  # panels are redrawn at each mouse move
def wrapped(text: str, width: float, points: float = POINTS) -> tuple[str, ...]:
    """Lines no wider than `width`, px, in Blender's font.

    A line ends at a space, or next to a character of a script without spaces, such as Japanese; but
    not before a closing mark, after an opening one, or between a number and its unit. A word wider
    than a line, such as a path, is cut.
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
    """Number of characters of a piece that fit in a line, at least one."""
    low, high = 1, len(piece)
    while high - low > 1:
        middle = (low + high) // 2
        if blf.dimensions(FONT, piece[:middle])[0] > width:
            high = middle
        else:
            low = middle
    return low


def pieces(text: str) -> list[str]:
    """Pieces of a text between which a line may end; joined, they are the text."""
    found: list[str] = []
    start = 0
    for k in range(1, len(text)):
        if _is_break(text[k - 1], text[k]) and not UNIT.match(text, k):
            found.append(text[start:k])
            start = k

    return [*found, text[start:]] if text else []


def _is_break(before: str, after: str) -> bool:
    """Whether a line may end between two successive characters."""
    if before == " ":
        return True

    is_wide = any(unicodedata.east_asian_width(letter) in WIDE for letter in (before, after))
    is_held = (
        after in SMALL
        or unicodedata.category(after) in ENDING
        or unicodedata.category(before) in BEGINNING
    )
    return is_wide and not is_held and after != " "
