"""An atlas: a folder of warp maps over a grid of heads, with an index that a reader needs alone."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...base.errors import MALFORMED, ImageError
from ...base.messages import Message
from ...base.numbers import number
from ...files import disk
from ...rig.rig import Rig
from ...rig.viewer import Viewer
from .heads import AXES, HeadBox, HeadGrid, Offset
from .refine import Refined

INDEX = "index.json"
FORM = 1  # of the index
BYTES_A_PIXEL = 3  # of a source image, before its file makes it smaller
CONVENTION = (
    "axes: places of the head, m, to the right, up and forward of `origin`, along the rows of"
    " `frame` (world).",
    "maps: a file for each place, forward fastest. st: for each display pixel, row 0 at the top,"
    " the place in the picture that it shows, 0 to 1 from its left and lower edge, NaN for nothing."
    " coverage: 0 to 1, of the pixel. path: pixels of two maps show the same path of the light"
    " where these numbers are equal.",
    "Between places st is blended by the weights of the corners of the cell, among those whose path"
    " is that of the nearest corner that shows the pixel; coverage is blended among all.",
)


@dataclass(frozen=True)
class Atlas:
    """What the index tells.

    rig : fingerprint of the rig, and of the settings, that the maps are of
    origin, frame : the viewer's own place, (3,) m, and its axes (3, 3)
    picture_size, display_size : (width, height) px
    tolerance : px of the picture
    image_key : fingerprint of what the source images beside the maps are of; None: there are none
    planned : what refining told; checked : what heads at random places told
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
        """Is there a source image beside each map?"""
        return self.image_key is not None

    @property
    def maps(self) -> list[str]:
        """The files of the maps, a place after the other."""
        return [map_name(offset) for offset in self.grid.offsets()]

    @property
    def images(self) -> list[str]:
        """The files of the source images, likewise."""
        if not self.has_images:
            return []
        return [f"source_{_in_name(offset)}.png" for offset in self.grid.offsets()]


def new(
    rig: Rig, viewer: Viewer, key: str, refined: Refined, tolerance: float, image_key: str | None
) -> Atlas:
    """The atlas of a viewer's head with a grid that is fine enough; key: the rig's fingerprint."""
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
    """Write the index of an atlas, whole or not at all."""
    told = {
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
    disk.write_text(folder / INDEX, json.dumps(told, indent=2) + "\n")


def read(folder: Path) -> Atlas | None:
    """The atlas in a folder; None where there is none.

    Raises
    ------
    ImageError : its index cannot be understood
    """
    path = folder / INDEX
    if not disk.is_there(path):
        return None

    try:
        told = json.loads(disk.read_bytes(path).decode())
        if told["form"] != FORM:
            raise ValueError(f"form {told['form']}")
        nodes = [told["axes"][axis] for axis in AXES]
        halvings = tuple(max((len(along) - 1).bit_length() - 1, 0) for along in nodes)
        if list(halvings) != told["halvings"]:
            raise ValueError("its halvings are not those of its axes")
        low, high = (tuple(float(along[k]) for along in nodes) for k in (0, -1))
        return Atlas(
            rig=told["rig"],
            viewer=told["viewer"],
            origin=tuple(told["origin"]),
            frame=tuple(map(tuple, told["frame"])),
            picture_size=tuple(told["picture_size"]),
            display_size=tuple(told["display_size"]),
            tolerance=float(told["tolerance_px"]),
            image_key=told["images_of"] if told["images"] else None,
            grid=HeadGrid(HeadBox(low, high), halvings),
            planned=told["planned"],
            checked=told["checked"],
        )
    except MALFORMED as reason:
        raise ImageError(
            "The file '{path}' is no index of an atlas ({why}): choose another folder, or remove"
            " it.",
            path=path,
            why=reason,
        ) from None


def random_heads(grid: HeadGrid, n: int, seed: int = 0) -> list[Offset]:
    """Places in the box of a grid, the same whenever it is asked."""
    within = np.random.default_rng(seed).random((n, 3))
    low, high = np.array(grid.box.low), np.array(grid.box.high)
    return [tuple(offset) for offset in (low + within * (high - low)).tolist()]


def map_name(offset: Offset) -> str:
    """The file of a place's map."""
    return f"map_{_in_name(offset)}.npz"


def _in_name(offset: Offset) -> str:
    """A place as it stands in names of files, mm; a grid of more places keeps the names."""
    return "_".join(f"{1e3 * x + 0.0:+.4f}" for x in offset)


def amount(atlas: Atlas) -> Message:
    """How many places, how long they take and how large they are, before they are made."""
    n = len(atlas.grid)
    told = Message(
        "{n} places of the head ({right} right, {up} up, {forward} forward): about"
        " {minutes} min and {mb} MB",
        n=n,
        **dict(zip(AXES, map(len, atlas.grid.nodes), strict=True)),
        minutes=number(n * atlas.planned["seconds_a_map"] / 60),
        mb=number(n * atlas.planned["bytes_a_map"] / 1e6),
    )
    if not atlas.has_images:
        return told
    width, height = atlas.display_size
    most = n * width * height * BYTES_A_PIXEL / 1e6
    return Message("{atlas}, and up to {mb} MB of source images", atlas=told, mb=number(most))
