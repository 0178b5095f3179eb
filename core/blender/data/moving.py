"""Moving pictures: movies and image sequences, at the frame given by their image user.

An image datablock has the pixels of one frame only, the last one used. Without a window a frame is
read from a copy: for a sequence the copy loads the frame's file, for a movie it is scaled to its
own size, which Blender can do at any frame.
"""

import re
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

import bpy

from ...base.errors import ImageError
from ...base.messages import Message
from ...files import disk
from ...files.frame_list import MOST
from ...files.picture_file import has_header

MOVING = {"SEQUENCE", "MOVIE"}
SETTINGS = ("frame_duration", "frame_start", "frame_offset", "use_cyclic")
# the last digits in a sequence's file name are the frame number
NAME = re.compile(r"(.*?)(\d*)(\D*)")
MOST_BYTES = 1 << 28  # bytes of frames a copy of a movie may gather before it is replaced


@dataclass(frozen=True)
class Timing:
    """Timing of a moving image: settings of an image user, by their names.

    As in Cycles it follows the scene whether Auto Refresh, a setting for viewports, is on or off.
    """

    frame_duration: int
    frame_start: int = 1
    frame_offset: int = 0
    use_cyclic: bool = False

    def number(self, now: int) -> int:
        """The image's frame at a frame of the scene, by Blender's rule: the last one is held."""
        n = self.frame_duration
        passed = now - self.frame_start + 1
        if self.use_cyclic and n:
            passed = (passed - 1) % n + 1
        return min(max(passed, 0), n) + self.frame_offset if n else 0


class OfMovie(Message):
    """A note on a movie that is too short, which animations handle separately.

    movie : its name
    """

    movie: str

    def __new__(cls, note: Message, movie: str) -> "OfMovie":
        self = str.__new__(cls, note)
        self.template, self.values = note.template, note.values
        self.movie = movie
        return self


def is_moving(image: bpy.types.Image) -> bool:
    """Whether an image is a movie or a sequence."""
    return image.source in MOVING


def timing_of(user: bpy.types.ImageUser) -> Timing:
    """The settings of an image user."""
    return Timing(**{name: getattr(user, name) for name in SETTINGS})


def whole(image: bpy.types.Image) -> Timing:
    """The timing of a whole moving image from the scene's frame 1 on, for one without a node."""
    return Timing(MOST if image.source == "SEQUENCE" else max(image.frame_duration, 1))


def set_timing(
    user: bpy.types.ImageUser, image: bpy.types.Image, timing: Timing | None = None
) -> None:
    """Have a node show a moving image, in viewports, too.

    timing : None for all of it from the scene's frame 1 on
    """
    if is_moving(image):
        timing = timing or whole(image)
        for name in SETTINGS:
            setattr(user, name, getattr(timing, name))
        user.use_auto_refresh = True


def rate_of(image: bpy.types.Image) -> float:
    """Frames per second of a movie's file; 0 if unknown."""
    before = set(bpy.data.movieclips)
    try:
        clip = bpy.data.movieclips.load(_absolute(image), check_existing=True)
    except RuntimeError:  # the file is gone
        return 0.0
    rate = clip.fps
    if clip not in before:
        bpy.data.movieclips.remove(clip)
    return rate


def number_at(image: bpy.types.Image, timing: Timing | None, now: int) -> int | None:
    """The frame of a moving image at a frame of the scene; None for a still image.

    timing : of its node; None without a node
    """
    return (timing or whole(image)).number(now) if is_moving(image) else None


def file_of(image: bpy.types.Image, number: int) -> Path:
    """The file of a frame of a sequence: the last digits in the image's name are its number."""
    return numbered(Path(_absolute(image)), max(number, 0))


def numbered(path: Path, number: int) -> Path:
    """The file of another frame of a sequence, from one of its files."""
    before, digits, after = NAME.fullmatch(path.stem).groups()
    return path.with_name(f"{before}{number:0{len(digits)}}{after}{path.suffix}")


# by a movie's file: its stamp when last opened, and its number of frames
_n_frames: dict[str, tuple[disk.Stamp | None, int]] = {}


def stamp_of(image: bpy.types.Image, number: int) -> disk.Stamp | None:
    """The stamp of the file of a moving image's frame; None if it is missing."""
    return disk.stamp(Path(_absolute(image)) if image.source == "MOVIE" else file_of(image, number))


def check_there(image: bpy.types.Image, number: int | None, owner: str) -> None:
    """Raise ImageError if the file of a frame is missing. Copies nothing, so panels may call it
    while drawing; `Reel.at` detects a broken file.

    number : None for a still image
    """
    if number is None:
        return
    is_sequence = image.source == "SEQUENCE"
    if not (disk.is_there(file_of(image, number)) if is_sequence else min(image.size)):
        raise _unreadable(image, number, owner)


def _unreadable(image: bpy.types.Image, number: int, owner: str) -> ImageError:
    is_movie = image.source == "MOVIE"
    return ImageError(
        "Frame {number} of the image '{image}' of {owner} cannot be read: {file} is missing or"
        " broken. Check the file and the frames set in the image's texture.",
        number=number,
        image=image.name,
        owner=owner,
        file=_absolute(image) if is_movie else str(file_of(image, number)),
    )


def _absolute(image: bpy.types.Image) -> str:
    return bpy.path.abspath(image.filepath, library=image.library)


class Reel:
    """Copies of images for reading frames. A movie's copy stays open between frames, which saves
    the search for each. Close a reel before undo or loading a file.
    """

    def __init__(self) -> None:
        self._copy: bpy.types.Image | None = None
        # session uid of the image, and its file
        self._of: tuple[int, disk.Stamp | None] | None = None
        self._n_read = 0

    def at(self, image: bpy.types.Image, number: int, owner: str) -> bpy.types.Image:
        """A copy of a moving image with the pixels of a frame, valid until the next call.

        number : from 1 in a movie, as in the file names in a sequence

        Raises
        ------
        ImageError
            The file is missing, or Blender cannot read it.
        """
        check_there(image, number, owner)
        is_movie = image.source == "MOVIE"
        of = image.session_uid, stamp_of(image, number)
        if not (is_movie and self._of == of and self._n_read):
            self.close()
            self._copy, self._of = image.copy(), of

        copy = self._copy
        if is_movie:
            copy.filepath_raw = _absolute(image)
            with suppress(RuntimeError):  # no such frame
                copy.scale(*copy.size, frame=number)
        else:
            file = file_of(image, number)
            if not has_header(file):
                raise _unreadable(image, number, owner)
            copy.source, copy.filepath_raw = "FILE", str(file)

        width, height = copy.size
        if min(width, height) < 1:
            self.close()
            raise _unreadable(image, number, owner)

        if is_movie and not self._n_read:
            _n_frames[_absolute(image)] = of[1], copy.frame_duration
        self._n_read += 1
        if self._n_read * 4 * width * height > MOST_BYTES:
            self._n_read = 0
        return copy

    def close(self) -> None:
        """Remove the copy."""
        if self._copy is not None:
            with suppress(ReferenceError):
                bpy.data.images.remove(self._copy)
        self._copy, self._of, self._n_read = None, None, 0


@contextmanager
def at_frame(
    image: bpy.types.Image, number: int | None, owner: str, reel: Reel | None = None
) -> Iterator[bpy.types.Image]:
    """An image with the pixels of a frame: the image itself if it is still.

    reel : an open reel; None for a temporary one
    """
    if number is None:
        yield image
        return
    own = reel or Reel()
    try:
        yield own.at(image, number, owner)
    finally:
        if reel is None:
            own.close()


def ended(image: bpy.types.Image, timing: Timing | None, now: int) -> list[str]:
    """A note on a movie that has ended at a frame of the scene, and shows its last frame.

    timing : of its node; None without a node. A timing that ends before the movie is
        intended, and gives no note
    """
    if image.source != "MOVIE":
        return []
    timing = timing or whole(image)
    endless = timing if timing.use_cyclic else replace(timing, frame_duration=MOST)
    number = endless.number(now)
    last = timing.frame_duration + timing.frame_offset
    n = n_frames_of(image)
    if not timing.frame_duration or number <= n or last < n:
        return []
    note = Message(
        "The movie '{image}' has only {n} frames; its last one is shown at frame {number}.",
        image=image.name,
        n=n,
        number=number,
    )
    return [OfMovie(note, image.name)]


def n_frames_of(image: bpy.types.Image) -> int:
    """The number of frames of a movie: of its present file if frames were read from it, else as
    Blender opened it, which Blender does not update.
    """
    stamp, n = _n_frames.get(_absolute(image), (None, 0))
    return n if stamp is not None and stamp == stamp_of(image, 1) else image.frame_duration


def numbered_next_to(file: Path) -> list[Path]:
    """The files with consecutive numbers around a numbered file, itself included; none without a
    number or neighbour.
    """
    digits = NAME.fullmatch(file.stem)[2]
    try:
        names = {one.name for one in file.parent.iterdir()} if digits else set()
    except OSError:
        names = set()
    first = last = int(digits or 0)
    while first > 0 and numbered(file, first - 1).name in names:
        first -= 1
    while numbered(file, last + 1).name in names:
        last += 1
    return [numbered(file, k) for k in range(first, last + 1)] if last > first else []


def sequence_of(files: Collection[Path]) -> tuple[Path, Timing]:
    """The first file of a sequence, and the timing that shows it at the scene's frame 1 and each
    next one a frame later.

    Raises
    ------
    ImageError
        The file names differ by more than consecutive numbers.
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
        "The {n} chosen files are not a sequence. Choose one image, or files with consecutive"
        " numbers.",
        n=n,
    )
