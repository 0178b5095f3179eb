"""Lists of frames as render farms write them: `1-250:2`, or `1,5,10-20`."""

import re
from collections.abc import Iterable

from ..base.errors import RigError

PART = re.compile(r"(-?\d+)(?:-(-?\d+)(?::(\d+))?)?")
MOST = 1_048_574  # Blender's last frame


def frames_of(text: str) -> tuple[int, ...]:
    """The frames of a list, in order, without duplicates.

    Raises
    ------
    RigError
        It is not a list, part of it has no frame, or a frame is beyond Blender's last.
    """
    frames: dict[int, None] = {}
    for part in text.split(","):
        frames |= dict.fromkeys(_of_part(part.strip(), text))
    return tuple(frames)


def in_ranges(frames: Iterable[int]) -> str:
    """A list of frames in a form every scheduler reads: sorted, unique, without overlapping ranges,
    in ASCII digits.
    """
    frames = sorted(set(frames))
    parts, first = [], 0
    while first < len(frames):
        step = frames[first + 1] - frames[first] if first + 1 < len(frames) else 1
        last = first
        while last + 1 < len(frames) and frames[last + 1] - frames[last] == step:
            last += 1
        if last == first + 1 and step > 1:  # two frames do not need a stepped range
            last = first
        end = f":{step}" if step > 1 and last > first else ""
        parts.append(f"{frames[first]}-{frames[last]}{end}" if last > first else f"{frames[first]}")
        first = last + 1
    return ",".join(parts)


def _of_part(part: str, text: str) -> Iterable[int]:
    found = PART.fullmatch(part)
    if found is None:
        raise _not_frames(text)

    first, last, step = (None if number is None else int(number) for number in found.groups())
    last = first if last is None else last
    if step == 0 or last < first or max(abs(first), abs(last)) > MOST:
        raise _not_frames(part)
    return range(first, last + 1, step or 1)


def _not_frames(text: str) -> RigError:
    return RigError(
        "'{text}' is not a list of frames: write numbers up to {most} and rising ranges, such as"
        " 1,5,10-20 or 1-250:2 (every second frame).",
        text=text,
        most=MOST,
    )
