"""The atlas: a folder of warp maps over a grid of head positions, with an index."""

import json
from collections.abc import Callable, Generator, Iterable
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.errors import MALFORMED, ImageError, RigError
from ...base.fingerprint import fingerprint
from ...base.messages import Message
from ...base.numbers import number
from ...base.steps import subprogress
from ...files import disk
from ...rig.rig import Rig
from ...rig.settings import Settings
from ...rig.viewer import Viewer
from ...solve.session import Session
from . import head_map
from .head_map import HeadMap, Refined, check, map_at, refine, solved_at, too_coarse
from .heads import AXES, HeadBox, HeadGrid, Offset

INDEX = "index.json"
FORM = 1  # version of the index format
BYTES_A_PIXEL = 3  # of a source image, uncompressed
CONVENTION = (
    "axes: head positions, m, to the right, up and forward of `origin`, along the rows of `frame`"
    " (world).",
    "maps: a file for each head position, forward fastest. st: the position in the picture shown by"
    " each display pixel, row 0 at the top, 0 to 1 from the left and lower edge, NaN for nothing."
    " coverage: 0 to 1, of the pixel. path: pixels of two maps with equal numbers show the same"
    " light path.",
    "Between head positions, st is blended by the weights of the cell's corners. Only corners with"
    " the path of the nearest corner with coverage count. coverage is blended among all corners.",
)


@dataclass(frozen=True)
class Atlas:
    """Contents of the index.

    rig : fingerprint of the rig and of the settings
    origin, frame : the viewer's own position, (3,) m, and its axes (3, 3)
    picture_size, display_size : (width, height) px
    tolerance : picture px
    image_key : fingerprint of the source images, None without source images
    planned : results of the refinement
    checked : results of the check at random head positions
    """

    rig: str
    viewer: str
    origin: tuple[float, ...]
    frame: tuple[tuple[float, ...], ...]
    picture_size: tuple[int, int]
    display_size: tuple[int, int]
    tolerance: float
    image_key: str | None
    grid: HeadGrid
    planned: dict[str, Any]
    checked: dict[str, Any] | None = None

    @property
    def has_images(self) -> bool:
        """Whether each map comes with a source image."""
        return self.image_key is not None

    @property
    def maps(self) -> list[str]:
        """File names of the maps, in the grid's order."""
        return [map_name(offset) for offset in self.grid.offsets()]

    @property
    def images(self) -> list[str]:
        """File names of the source images, in the grid's order."""
        if not self.has_images:
            return []
        return [f"source_{_in_name(offset)}.png" for offset in self.grid.offsets()]


def new(
    rig: Rig, viewer: Viewer, key: str, refined: Refined, tolerance: float, image_key: str | None
) -> Atlas:
    """The atlas of a viewer on a refined grid; `key` is the rig's fingerprint."""
    place, display = rig.picture_place, rig.display
    return Atlas(
        rig=key,
        viewer=viewer.name,
        origin=tuple(viewer.position.tolist()),
        frame=tuple(map(tuple, viewer.axes.tolist())),
        picture_size=(place.width, place.height),
        display_size=(display.width, display.height),
        tolerance=tolerance,
        image_key=image_key,
        grid=refined.grid,
        planned={
            "seconds_a_map": refined.seconds,
            "bytes_a_map": refined.n_bytes,
            "off": {axis: asdict(off) for axis, off in refined.off.items()},
        },
    )


def write(folder: Path, atlas: Atlas) -> None:
    """Write the index of an atlas atomically."""
    index = {
        "form": FORM,
        "rig": atlas.rig,
        "viewer": atlas.viewer,
        "origin": atlas.origin,
        "frame": atlas.frame,
        "picture_size": atlas.picture_size,
        "display_size": atlas.display_size,
        "tolerance_px": atlas.tolerance,
        "axes": {name: nodes.tolist() for name, nodes in zip(AXES, atlas.grid.nodes, strict=True)},
        "halvings": atlas.grid.halvings,
        "maps": atlas.maps,
        "images": atlas.images,
        "images_of": atlas.image_key,
        "planned": atlas.planned,
        "checked": atlas.checked,
        "convention": CONVENTION,
    }
    disk.write_text(folder / INDEX, json.dumps(index, indent=2) + "\n")


def read(folder: Path) -> Atlas | None:
    """The atlas in a folder; None without an index.

    Raises
    ------
    ImageError : the index is malformed
    """
    path = folder / INDEX
    if not disk.is_there(path):
        return None

    try:
        index = json.loads(disk.read_bytes(path).decode())
        if index["form"] != FORM:
            raise ValueError(f"form {index['form']}")
        nodes = [index["axes"][axis] for axis in AXES]
        halvings = tuple(max((len(along) - 1).bit_length() - 1, 0) for along in nodes)
        if list(halvings) != index["halvings"]:
            raise ValueError("its halvings are not those of its axes")
        low, high = (tuple(float(along[k]) for along in nodes) for k in (0, -1))
        return Atlas(
            rig=index["rig"],
            viewer=index["viewer"],
            origin=tuple(index["origin"]),
            frame=tuple(map(tuple, index["frame"])),
            picture_size=tuple(index["picture_size"]),
            display_size=tuple(index["display_size"]),
            tolerance=float(index["tolerance_px"]),
            image_key=index["images_of"] if index["images"] else None,
            grid=HeadGrid(HeadBox(low, high), halvings),
            planned=index["planned"],
            checked=index["checked"],
        )
    except MALFORMED as reason:
        raise ImageError(
            "'{path}' is not the index of an atlas ({why}). Choose another folder, or remove the"
            " file.",
            path=path,
            why=reason,
        ) from None


def random_heads(grid: HeadGrid, n: int, seed: int = 0) -> list[Offset]:
    """Reproducible random positions in the box of a grid."""
    within = np.random.default_rng(seed).random((n, 3))
    low, high = np.array(grid.box.low), np.array(grid.box.high)
    return [tuple(offset) for offset in (low + within * (high - low)).tolist()]


def map_name(offset: Offset) -> str:
    """File name of the map at an offset."""
    return f"map_{_in_name(offset)}.npz"


def _in_name(offset: Offset) -> str:
    """An offset in file names, mm; halving the grid does not change it."""
    return "_".join(f"{1e3 * x + 0.0:+.4f}" for x in offset)


def amount(atlas: Atlas) -> Message:
    """Estimated number of positions, time and size."""
    n = len(atlas.grid)
    width, height = atlas.display_size
    n_bytes = atlas.planned["bytes_a_map"]
    if atlas.has_images:
        n_bytes += width * height * BYTES_A_PIXEL
    return Message(
        "{n} head positions ({right} across, {up} up, {forward} forward): about {minutes} min and"
        " up to {mb} MB",
        n=n,
        **dict(zip(AXES, map(len, atlas.grid.nodes), strict=True)),
        minutes=number(n * atlas.planned["seconds_a_map"] / 60),
        mb=number(n * n_bytes / 1e6),
    )


SaveImage = Callable[[Path, NDArray[np.float32]], None]
CHECKED = 8  # head positions


@dataclass(frozen=True, eq=False)
class Making:
    """Inputs and output folder of an atlas.

    viewer : of the rig, whose head moves
    traced : maps traced by planning, by file name; each is released once written
    save_image : writes a source image to a new file; None if no image can be written
    has_images : whether source images are requested
    """

    session: Session
    rig: Rig
    viewer: Viewer
    settings: Settings
    folder: Path
    save_image: SaveImage | None = None
    has_images: bool = False
    traced: dict[str, HeadMap] = field(default_factory=dict)

    @cached_property
    def key(self) -> str:
        """Fingerprint of everything the maps depend on."""
        rig = replace(self.rig, pictures=(self.rig.picture_place,))
        return fingerprint(rig, self.viewer, self.settings.of_optics)

    @cached_property
    def image_key(self) -> str:
        """Fingerprint of everything the source images depend on."""
        return fingerprint(self.rig, self.viewer, self.settings)

    def at(self, offset: Offset) -> Generator[float, None, HeadMap]:
        """The map of the head at an offset. Yields progress 0..1."""
        return map_at(self.session, self.rig, self.viewer, self.settings, offset)


def missing(folder: Path, atlas: Atlas) -> list[int]:
    """Numbers of the positions with missing files. Files are written atomically, so an existing
    file is complete.
    """
    names = zip(atlas.maps, atlas.images or atlas.maps, strict=True)
    return [k for k, files in enumerate(names) if not all((folder / f).exists() for f in files)]


def made(making: Making, atlas: Atlas, numbers: Iterable[int]) -> Generator[float, None, int]:
    """Write the missing files of numbered positions. Yields progress 0..1, returns how many were
    missing.
    """
    wanted = sorted(set(numbers) & set(missing(making.folder, atlas)))
    offsets, maps, images = atlas.grid.offsets(), atlas.maps, atlas.images
    for k, place in enumerate(wanted):
        if (traced := making.traced.pop(maps[place], None)) is not None:
            head_map.write(making.folder / maps[place], traced)
            continue

        steps = solved_at(
            making.session, making.rig, making.viewer, making.settings, offsets[place]
        )
        found, source = yield from subprogress(steps, k / len(wanted), (k + 1) / len(wanted))
        with disk.together(making.folder) as new_files:
            head_map.write(new_files / maps[place], found)
            if atlas.has_images:
                making.save_image(new_files / images[place], source)
    return len(wanted)


def checked(making: Making, atlas: Atlas, n: int = CHECKED) -> Generator[float, None, Atlas]:
    """Compare blended with traced maps at `n` random head positions, and write the result to the
    index. Yields progress 0..1, returns the updated atlas.

    Raises
    ------
    ImageError : files are missing
    """
    absent = missing(making.folder, atlas)
    if absent:
        raise ImageError(
            "{n} of {of} maps are missing in the atlas '{folder}', starting with {name}. Make"
            " them, then check the atlas.",
            n=len(absent),
            of=len(atlas.grid),
            folder=making.folder,
            name=atlas.maps[absent[0]],
        )

    offs, names = [], atlas.maps
    for k, offset in enumerate(random_heads(atlas.grid, n)):
        steps = making.at(offset)
        true = yield from subprogress(steps, k / n, (k + 1) / n)
        numbers, weights = atlas.grid.around(offset)
        maps = [head_map.read(making.folder / names[i]) for i in numbers]
        offs.append(head_map.off(head_map.between(maps, weights), true, atlas.picture_size))

    result = {
        "heads": n,
        "median_px": float(np.median([off.median for off in offs])),
        "most_px": max(off.most for off in offs),
        "at_borders": float(np.mean([off.at_borders for off in offs])),
    }
    atlas = replace(atlas, checked=result)
    write(making.folder, atlas)
    return atlas


def is_fine(atlas: Atlas) -> bool:
    """Whether a checked atlas meets its tolerance."""
    return atlas.checked["most_px"] <= atlas.tolerance


def refuse_too_coarse(atlas: Atlas) -> None:
    """Raise RigError if a checked atlas misses its tolerance."""
    if not is_fine(atlas):
        raise RigError(
            "With {n} head positions, blended maps are {off:.3g} px off; the tolerance is"
            " {tolerance:g} px. Make the atlas without --plan, or plan it again with a smaller"
            " tolerance.",
            n=len(atlas.grid),
            off=atlas.checked["most_px"],
            tolerance=atlas.tolerance,
        )


def finer(atlas: Atlas, most: int) -> Atlas:
    """The atlas with its worst axis halved; RigError above `most` positions.

    Needed because the box's corners can be worse than the lines through its middle, which planning
    measures.
    """
    off = atlas.planned["off"]
    axis = max(off, key=lambda name: off[name]["most"])
    grid = atlas.grid.halved(AXES.index(axis))
    if len(grid) > most:
        raise too_coarse(len(atlas.grid), atlas.checked["most_px"], most)

    # the error of a smooth map falls to a quarter with each halving
    less = {**off, axis: {**off[axis], "most": off[axis]["most"] / 4}}
    return replace(atlas, grid=grid, planned={**atlas.planned, "off": less}, checked=None)


def halved(
    making: Making, atlas: Atlas, most: int, n: int = CHECKED
) -> Generator[float, None, Atlas]:
    """Check an atlas, and halve its grid if it misses its tolerance. Yields progress 0..1.

    An atlas with missing positions is returned unchanged: it has already been halved, and a
    repeated task must give the same result.
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
    """Make all positions of a planned atlas, check it, and halve it until it meets its tolerance.
    Yields progress 0..1.
    """
    done = 0.0
    while True:
        to_do = len(missing(making.folder, atlas))
        end = done + (1 - done) * to_do / (to_do + n)
        yield from subprogress(made(making, atlas, range(len(atlas.grid))), done, end)
        done = (end + 1) / 2  # another halving may follow
        atlas = yield from subprogress(halved(making, atlas, most, n), end, done)
        if atlas.checked is not None:
            yield 1.0
            return atlas


def share(atlas: Atlas, number: int, of: int) -> range:
    """Numbers of the positions in one of `of` shares; shares count from 1."""
    return range(number - 1, len(atlas.grid), of)


def planned(
    making: Making, box: HeadBox, tolerance: float, most: int, overwrite: bool, remedy: str
) -> Generator[float, None, Atlas]:
    """Find a fine enough grid and write the index. Yields progress 0..1.

    Maps of the same rig in the folder are reused, others removed if `overwrite` is set. Existing
    source images stay, requested or not.

    Raises
    ------
    RigError, MeshError : the rig cannot be solved somewhere in the box, or not finely enough
    ImageError : the folder has an atlas of another rig or box, or source images of another picture,
        and `overwrite` is not set; `remedy` ends the message
    """
    rig = making.rig
    check(rig, making.viewer, box, tolerance, most)
    before = read(making.folder)
    is_of_rig = before is not None and before.rig == making.key
    if before is not None and not is_of_rig and not overwrite:
        raise ImageError(
            "The folder '{folder}' has an atlas of another rig. Choose another folder, or"
            " {remedy}.",
            folder=making.folder,
            remedy=remedy,
        )
    image_key = _image_key(making, before if is_of_rig else None, overwrite, remedy)
    if is_of_rig and (before.grid.box, before.tolerance) == (box, tolerance):
        if before.image_key == image_key:
            return before
        atlas = replace(before, image_key=image_key)
    else:
        if _has_places_of_another_box(making.folder, before, box) and not overwrite:
            raise ImageError(
                "The folder '{folder}' has an atlas for other head positions. Choose another"
                " folder, or {remedy}.",
                folder=making.folder,
                remedy=remedy,
            )
        refined = yield from refine(making.at, box, rig.picture_place, tolerance, most)
        if image_key is None:  # with source images, each position is solved again
            found = refined.maps.items()
            making.traced.update((map_name(offset), one) for offset, one in found)
        atlas = new(rig, making.viewer, making.key, refined, tolerance, image_key)

    write(making.folder, atlas)
    if before is not None:
        reused = set(atlas.maps) if is_of_rig else set()
        reused |= set(atlas.images) if before.image_key == image_key else set()
        _remove(making.folder, {*before.maps, *before.images} - reused)
    return atlas


def _image_key(making: Making, before: Atlas | None, overwrite: bool, remedy: str) -> str | None:
    """Fingerprint of the planned source images; None without source images.

    before : existing atlas of the same rig
    """
    if before is not None and before.has_images:
        if before.image_key == making.image_key:
            return making.image_key
        if not overwrite:
            raise ImageError(
                "The folder '{folder}' has source images for another picture or other light"
                " settings. Choose another folder, or {remedy}.",
                folder=making.folder,
                remedy=remedy,
            )
    return making.image_key if making.has_images else None


def _has_places_of_another_box(folder: Path, atlas: Atlas | None, box: HeadBox) -> bool:
    """Whether a new box would discard existing files. Boxes hardly ever have positions in
    common.
    """
    if atlas is None or atlas.grid.box == box:
        return False
    return len(missing(folder, atlas)) < len(atlas.grid)


def _remove(folder: Path, names: Iterable[str]) -> None:
    for name in names:
        try:
            (folder / name).unlink(missing_ok=True)
        except OSError as reason:
            raise ImageError(
                "The old file '{path}' cannot be removed ({why}). Remove it yourself.",
                path=folder / name,
                why=reason.strerror,
            ) from None


def planned_before(making: Making) -> Atlas:
    """The atlas in the folder; RigError if it belongs to another rig, or its source images to
    another picture.
    """
    atlas = read(making.folder)
    if atlas is None:
        raise ImageError(
            "The folder '{folder}' has no {index}. Plan the atlas first.",
            folder=making.folder,
            index=INDEX,
        )
    is_of_images = not atlas.has_images or atlas.image_key == making.image_key
    if not (atlas.rig == making.key and is_of_images):
        raise RigError(
            "The atlas in '{folder}' was planned for another rig, picture or light. Plan it again.",
            folder=making.folder,
        )
    if making.has_images and not atlas.has_images:
        raise RigError(
            "The atlas in '{folder}' was planned without source images. Plan it again with them;"
            " its maps stay.",
            folder=making.folder,
        )
    return atlas
