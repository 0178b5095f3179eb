"""Lists of frames: `1-250:2`, or `1,5,10-20`, as render farms write them."""

import re
from collections.abc import Iterable

from .errors import RigError

PART = re.compile(r"(-?\d+)(?:-(-?\d+)(?::(\d+))?)?")
MOST = 1_048_574  # the last frame that Blender has


def frames_of(text: str) -> tuple[int, ...]:
    """The frames of a list, in its order, each once.

    Raises
    ------
    RigError
        It is no list, a part of it has no frame, or one is beyond Blender's last.
    """
    frames: dict[int, None] = {}
    for part in text.split(","):
        frames |= dict.fromkeys(_of_part(part.strip(), text))
    return tuple(frames)


def in_ranges(frames: Iterable[int]) -> str:
    """The list of some frames in the one form that every scheduler reads: sorted, each once, no two
    ranges overlapping, in digits of ASCII.
    """
    left = sorted(set(frames))
    parts = []
    while left:
        step = left[1] - left[0] if len(left) > 1 else 1
        n = next((k for k in range(1, len(left)) if left[k] - left[k - 1] != step), len(left))
        n = n if n > 2 or step == 1 else 1  # two frames are no range of every second one
        end = f":{step}" if step > 1 and n > 1 else ""
        parts.append(f"{left[0]}-{left[n - 1]}{end}" if n > 1 else f"{left[0]}")
        left = left[n:]
    return ",".join(parts)


def _of_part(part: str, text: str) -> Iterable[int]:
    found = PART.fullmatch(part)
    if found is None:
        raise RigError(
            "'{text}' is no list of frames: write numbers and ranges with commas between, such as"
            " 1,5,10-20 or 1-250:2, which is every second one.",
            text=text,
        )

    first, last, step = (None if number is None else int(number) for number in found.groups())
    last = first if last is None else last
    if step == 0 or last < first:
        raise RigError(
            "The frames '{part}' are no range: begin with the smaller number, with a step of 1 or"
            " more.",
            part=part,
        )
    if max(abs(first), abs(last)) > MOST:
        raise RigError(
            "The frames '{part}' are beyond {most}, the last that Blender has.",
            part=part,
            most=MOST,
        )
    return range(first, last + 1, step or 1)
