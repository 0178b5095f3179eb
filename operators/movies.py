"""A movie of an animation's frames: those that are not there are solved first."""

from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path

import bpy

from ..core.base.errors import ImageError, RigError
from ..core.base.messages import Message
from ..core.base.steps import within
from ..core.blender import movie
from ..core.blender.image import size_of
from ..core.files import disk, image_io
from ..core.image.test_card import card
from . import folder, frames, work
from .export import gamma_of

SOLVED = 0.9  # of the progress
ENCODED = ("PNG8", "PNG16", "TIFF16")  # formats of frames in a display's own numbers
LONGEST = 3600.0  # s of a test card


@dataclass(frozen=True)
class Wish:
    """A movie that is wanted.

    path : without suffix, which the codec gives
    codec : a key of movie.CODECS
    card : s that a test card is shown for, before, 0..LONGEST
    """

    path: Path
    codec: str
    card: float = 0.0
    overwrite: bool = False

    @property
    def file(self) -> Path:
        """Its file."""
        suffix = movie.CODECS[self.codec].suffix
        return self.path.with_name(self.path.name.removesuffix(suffix) + suffix)


def made(
    context: bpy.types.Context, run: frames.Run, wish: Wish, tally: frames.Tally, remedy: str
) -> Generator[float, None, None]:
    """Solve the frames of a run that are not there, and make a movie of all; yields progress 0..1.

    remedy : ends the sentence that there is such a file already

    Raises
    ------
    RigError, ImageError
        A frame is lacking, or the movie cannot be made; it is whole or not there.
    """
    if run.form not in ENCODED:
        raise ImageError(
            "A movie is made of frames in the display's own numbers: choose PNG or TIFF as their"
            " format."
        )
    display = work.read(context).rig.display
    size = display.width, display.height
    movie.check(wish.codec, size)
    if not wish.overwrite:
        folder.refuse_existing(wish.file.parent, [wish.file.name], remedy)

    yield from within(frames.solved(context, run, tally), 0.0, SOLVED)
    if tally.failed or tally.others:
        raise RigError("The movie would lack frames: {told}", told=tally.told(wish.file.parent))
    if tally.stale:
        raise RigError("{reason}", reason=tally.stale_words)
    files = list(run.files.values())
    _check_sizes(set(files) - set(tally.files), size)

    yield SOLVED
    scene = context.scene
    with disk.scratch(wish.file.parent) as scratch:
        first = _test_card(scratch, scene, wish, display.name, size) if wish.card else None
        with disk.together(wish.file.parent) as new:
            movie.encode(new / wish.file.name, files, wish.codec, size, scene, first)
    # the last step: an Esc that was pressed meanwhile would call a movie stopped that is there


def _check_sizes(files: set[Path], size: tuple[int, int]) -> None:
    """Refuse frames that were there, and have another size."""
    for file in sorted(files):
        found = size_of(file)
        if found != size:
            raise ImageError(
                "The frame '{file}' has {found} pixels, the display {size}: remove it, or solve it"
                " anew.",
                file=file,
                found=_by(found),
                size=_by(size),
            )


def _by(size: tuple[int, int]) -> str:
    return f"{size[0]} x {size[1]}"


def _test_card(
    scratch: Path, scene: bpy.types.Scene, wish: Wish, name: str, size: tuple[int, int]
) -> movie.Card:
    """The test card, with the display's name and numbers over it."""
    rate = scene.render.fps / scene.render.fps_base
    file = image_io.write(scratch / "card.png", card(*size), "PNG8", gamma=gamma_of(scene))
    numbers = f"{_by(size)}, {rate:.4g} fps, {movie.CODECS[wish.codec].label}"
    n = max(1, round(wish.card * rate))
    return movie.Card(file, n, (name, numbers, wish.file.name))


def told(wish: Wish, run: frames.Run) -> Message:
    """The movie, in a sentence."""
    return Message(
        "Wrote '{file}', {n} frames in {codec}.",
        file=wish.file,
        n=len(run.files),
        codec=movie.CODECS[wish.codec].label,
    )
