"""Image files that are opened together: the frames of an image sequence."""

from collections.abc import Collection
from pathlib import Path

from ...base.errors import ImageError
from .moving import NAME, Timing, numbered


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
        digits = NAME.fullmatch(file.stem)[2]
        if digits:
            by_number[int(digits)] = file

    n, first = len(files), min(by_number, default=0)
    if len(by_number) == n:
        file = by_number[first]
        if {numbered(file, k) for k in range(first, first + n)} == set(files):
            return file, Timing(n, frame_offset=first - 1)

    raise ImageError(
        "The {n} files that are chosen are no sequence: choose one image, or files whose names"
        " differ by consecutive numbers alone.",
        n=n,
    )
