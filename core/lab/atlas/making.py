"""An atlas is made: as it is planned, place by place, then checked at heads between them.

Places do not know of each other, so that many machines may share them. A place whose files are
there is not made again, so that work that was stopped goes on where it was.
"""

from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...base.errors import ImageError, RigError
from ...base.fingerprint import fingerprint
from ...base.steps import within
from ...files import disk
from ...rig.rig import Rig
from ...rig.settings import Settings
from ...rig.viewer import Viewer
from ...solve.session import Session
from . import head_map
from .atlas import Atlas, random_heads, write
from .head_map import HeadMap
from .heads import AXES, Offset
from .refine import map_at, solved_at

SaveImage = Callable[[Path, NDArray[np.float32]], None]
CHECKED = 8  # heads


@dataclass(frozen=True, eq=False)
class Making:
    """What an atlas is made of, and where.

    viewer : of the rig, whose head moves
    known : maps that planning traced, by their files' names; each is let go when it is written
    save_image : writes a source image to a new file; None where none can be written
    has_images : are source images asked for?
    """

    session: Session
    rig: Rig
    viewer: Viewer
    settings: Settings
    folder: Path
    save_image: SaveImage | None = None
    has_images: bool = False
    known: dict[str, HeadMap] = field(default_factory=dict)

    @cached_property
    def key(self) -> str:
        """Fingerprint of all that the maps depend on."""
        rig = replace(self.rig, pictures=(self.rig.picture_place,))
        return fingerprint(rig, self.viewer, self.settings.of_optics)

    @cached_property
    def image_key(self) -> str:
        """The same, of the source images."""
        return fingerprint(self.rig, self.viewer, self.settings)

    def at(self, offset: Offset) -> Generator[float, None, HeadMap]:
        """The map of the head at an offset; yields progress 0..1."""
        return map_at(self.session, self.rig, self.viewer, self.settings, offset)


def missing(folder: Path, atlas: Atlas) -> list[int]:
    """The numbers of the places whose files are not there, whole files as they all are."""
    names = zip(atlas.maps, atlas.images or atlas.maps, strict=True)
    return [k for k, files in enumerate(names) if not all((folder / f).exists() for f in files)]


def made(making: Making, atlas: Atlas, numbers: Iterable[int]) -> Generator[float, None, int]:
    """Write the files of places, by their numbers; yields progress 0..1, returns how many were
    missing.
    """
    wanted = sorted(set(numbers) & set(missing(making.folder, atlas)))
    offsets, maps, images = atlas.grid.offsets(), atlas.maps, atlas.images
    for k, place in enumerate(wanted):
        if (known := making.known.pop(maps[place], None)) is not None:
            head_map.write(making.folder / maps[place], known)
            continue

        steps = solved_at(
            making.session, making.rig, making.viewer, making.settings, offsets[place]
        )
        found, source = yield from within(steps, k / len(wanted), (k + 1) / len(wanted))
        with disk.together(making.folder) as new_files:
            head_map.write(new_files / maps[place], found)
            if atlas.has_images:
                making.save_image(new_files / images[place], source)
    return len(wanted)


def checked(making: Making, atlas: Atlas, n: int = CHECKED) -> Generator[float, None, Atlas]:
    """Compare heads at random places, blended and traced; yields progress 0..1, returns the atlas
    with what was found, which its index tells from now on.

    Raises
    ------
    ImageError : files are missing
    """
    lacking = missing(making.folder, atlas)
    if lacking:
        raise ImageError(
            "The atlas in '{folder}' lacks {n} of {of} places, the first is {name}: make them"
            " first.",
            folder=making.folder,
            n=len(lacking),
            of=len(atlas.grid),
            name=atlas.maps[lacking[0]],
        )

    offs, names = [], atlas.maps
    for k, offset in enumerate(random_heads(atlas.grid, n)):
        steps = making.at(offset)
        true = yield from within(steps, k / n, (k + 1) / n)
        numbers, weights = atlas.grid.around(offset)
        maps = [head_map.read(making.folder / names[i]) for i in numbers]
        offs.append(head_map.off(head_map.between(maps, weights), true, atlas.picture_size))

    told = {
        "heads": n,
        "median_px": float(np.median([off.median for off in offs])),
        "most_px": max(off.most for off in offs),
        "at_borders": float(np.mean([off.at_borders for off in offs])),
    }
    atlas = replace(atlas, checked=told)
    write(making.folder, atlas)
    return atlas


def is_fine(atlas: Atlas) -> bool:
    """Does an atlas that was checked keep its tolerance?"""
    return atlas.checked["most_px"] <= atlas.tolerance


def refuse_too_coarse(atlas: Atlas) -> None:
    """Raise RigError where it does not."""
    if not is_fine(atlas):
        raise RigError(
            "With {n} places of the head blending is {off:.3g} px off, of {tolerance:g}: make it"
            " without --plan, or plan it anew with a smaller tolerance.",
            n=len(atlas.grid),
            off=atlas.checked["most_px"],
            tolerance=atlas.tolerance,
        )


def finer(atlas: Atlas, most: int) -> Atlas:
    """The atlas with its worst axis halved; RigError where it would have more than `most` places.

    Lines through the middle of the box told less than its corners have.
    """
    off = atlas.planned["off"]
    axis = max(off, key=lambda name: off[name]["most"])
    grid = atlas.grid.halved(AXES.index(axis))
    if len(grid) > most:
        raise RigError(
            "With {n} places of the head blending is {off:.3g} px off: set a larger tolerance, a"
            " smaller box, or more than {most} places.",
            n=len(atlas.grid),
            off=atlas.checked["most_px"],
            most=most,
        )

    # to a quarter with each halving, where the map is smooth
    less = {**off, axis: {**off[axis], "most": off[axis]["most"] / 4}}
    return replace(atlas, grid=grid, planned={**atlas.planned, "off": less}, checked=None)


def halved(
    making: Making, atlas: Atlas, most: int, n: int = CHECKED
) -> Generator[float, None, Atlas]:
    """Check an atlas, and halve its grid where it misses its tolerance; yields progress 0..1.

    One that lacks places stays: it was halved before. So whoever asks twice gets the same.
    """
    if missing(making.folder, atlas):
        return atlas
    atlas = yield from checked(making, atlas, n)
    if not is_fine(atlas):
        atlas = finer(atlas, most)
        write(making.folder, atlas)
    return atlas


def whole(
    making: Making, atlas: Atlas, most: int, n: int = CHECKED
) -> Generator[float, None, Atlas]:
    """Make all places of a planned atlas and check it, halved until it keeps its tolerance; yields
    progress 0..1.
    """
    done = 0.0
    while True:
        to_do = len(missing(making.folder, atlas))
        end = done + (1 - done) * to_do / (to_do + n)
        yield from within(made(making, atlas, range(len(atlas.grid))), done, end)
        done = (end + 1) / 2  # it may have to be finer
        atlas = yield from within(halved(making, atlas, most, n), end, done)
        if atlas.checked is not None:
            yield 1.0
            return atlas


def share(atlas: Atlas, number: int, of: int) -> range:
    """The numbers of the places that are one of so many shares of an atlas, counted from 1."""
    return range(number - 1, len(atlas.grid), of)
