"""Image files that are opened together: the frames of an image sequence."""

import re
from collections.abc import Collection
from pathlib import Path

from ..errors import ImageError
from .moving import Timing

# the last digits of a name are the number of its frame, as in `moving.file_of`
NAME = re.compile(r"(.*?)(\d+)(\D*)")


def sequence_of(files: Collection[Path]) -> tuple[Path, Timing]:
    """The first of the files of a sequence, and the timing that shows it at the scene's frame 1,
    and each other one a frame later.

    Raises
    ------
    ImageError
        They are no sequence: their names differ by more than consecutive numbers.
    """
    by_number = {}
    for file in files:
        found = NAME.fullmatch(file.stem)
        if found is not None:
            by_number[int(found[2])] = file, found

    n, first = len(files), min(by_number, default=0)
    if len(by_number) == n:
        file, (before, digits, after) = by_number[first][0], by_number[first][1].groups()
        run = range(first, first + n)
        names = {f"{before}{k:0{len(digits)}}{after}{file.suffix}" for k in run}
        if names == {file.name for file in files}:
            return file, Timing(n, frame_offset=first - 1)

    raise ImageError(
        "The {n} files that are chosen are no sequence: choose one image, or files whose names"
        " differ by consecutive numbers alone.",
        n=n,
    )
