"""Warp map files: options, the maps of a channel, and file formats."""

import json
import re
from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from ...base.arrays import Floats
from ...base.errors import MALFORMED, ImageError, RigError, out_of_range
from ...base.free_memory import check_free
from ...base.messages import Message, quoted
from ...base.steps import hold_progress, subprogress
from ...files import disk, image_io, png
from ...rig.rig import PicturePlace, Rig
from ...solve.channel import Channel
from .stmap import (
    STMap,
    WarpMesh,
    mesh_error,
    mesh_grid,
    mesh_of,
    of_places,
    quads_of,
    view_stmap,
    warp_map,
    write_data,
    write_obj,
)
from .view_from_display import paths_shown, refuse_views, view_from_display

# the files of each format
FORMATS = {
    "EXR": ("warp.exr", "view.exr"),
    "FFMPEG": ("x.pgm", "y.pgm"),
    "OBJ": ("warp.obj",),
    "DATA": ("warp.data",),
    "NPZ": ("warp.npz",),
    "PNG": ("warp.png",),
}
TIMES = (1, 2, 4)
MOST_OVERSCAN = 100.0
BYTES = 600  # per point of a map at the memory peak, measured with ten candidates per point
SMALLER = Message("set a smaller ffmpeg Size, or other formats")
NOTHING = 65535  # marks an empty pixel in a .pgm: beyond every image, so ffmpeg fills it


def wavelengths_for(rig: Rig, wavelength: float) -> tuple[float, ...]:
    """Wavelengths of a rig's maps, m: the display's primaries if the glass disperses, else the
    wavelength of the solve.
    """
    return rig.display.primaries if rig.disperses else (wavelength,)


@dataclass(frozen=True)
class MapOptions:
    """Options of the map export.

    formats : keys of FORMATS
    overscan : per cent, enlargement of the picture at each side
    times : size of the maps for ffmpeg, in display pixels
    mesh_step : display px, approximate distance of mesh nodes; at most the display's size
    """

    formats: tuple[str, ...] = ("EXR",)
    overscan: float = 0.0
    times: int = 2
    mesh_step: float = 8.0

    def check(self) -> None:
        """Raise RigError if the options are invalid."""
        if not self.formats:
            raise RigError("No map format is selected. Select one or more.")
        if not 0 <= self.overscan <= MOST_OVERSCAN:
            owner = Message("The map export")
            raise out_of_range(owner, "Overscan", f"{self.overscan:g} %", 0, MOST_OVERSCAN)
        if self.times not in TIMES:
            raise RigError(
                "{name} is '{value}': set it to one of {choices}.",
                name=Message("ffmpeg Size"),
                value=self.times,
                choices=quoted(map(str, TIMES)),
            )
        if not 1 <= self.mesh_step < np.inf:
            raise RigError(
                "The mesh step is {step:g} display pixels. Set 1 or more.", step=self.mesh_step
            )

    def check_for(self, place: PicturePlace) -> None:
        """Raise RigError if a picture is too large for a format."""
        if "FFMPEG" in self.formats and self.times * max(place.width, place.height) > NOTHING:
            raise RigError(
                "The picture '{picture}' has {width} x {height} pixels, but maps for ffmpeg at"
                " {times} x allow {most}: {remedy}.",
                picture=place.name,
                width=place.width,
                height=place.height,
                times=self.times,
                most=NOTHING // self.times,
                remedy=SMALLER,
            )


def memory_needed(display_size: tuple[int, int], options: MapOptions) -> float:
    """Approximate peak memory of a viewer's maps, bytes."""
    width, height = display_size
    larger = options.times**2 if "FFMPEG" in options.formats and options.times > 1 else 0
    return BYTES * width * height * (1 + larger)


def check_memory(rig: Rig, options: MapOptions) -> None:
    """Raise RigError if the maps of a viewer need more memory than is free, or the display has
    views.
    """
    refuse_views(rig)
    display = rig.display
    remedy = Message(
        "lower the resolution of the display '{display}' ({width} x {height})",
        display=display.name,
        width=display.width,
        height=display.height,
    )
    if "FFMPEG" in options.formats and options.times > 1:
        remedy = SMALLER
    needed = memory_needed((display.width, display.height), options)
    check_free(needed, Message("Exporting maps"), remedy)


@dataclass(frozen=True, eq=False)
class ChannelMaps:
    """The maps of a channel; None if no requested file needs them.

    warp : from display pixels
    view : from viewer pixels
    larger : from display pixels, each divided into `times` x `times`
    """

    warp: STMap
    view: STMap | None
    larger: STMap | None
    times: int
    mesh: WarpMesh | None


def maps_of(channel: Channel, options: MapOptions) -> Generator[float, None, ChannelMaps]:
    """The maps of a channel for the requested formats. Yields progress 0..1."""
    forms = set(options.formats)
    width, height = channel.view_map.display_size
    n_view = channel.viewer.width * channel.viewer.height
    grid = mesh_grid((width, height), options.mesh_step)

    # progress is about proportional to the number of rays
    parts = {
        "warp": width * height,
        "view": n_view if "EXR" in forms else 0,
        "larger": width * height * options.times**2 if "FFMPEG" in forms else 0,
        "mesh": len(grid) if forms & {"OBJ", "DATA"} else 0,
    }
    ends = dict(zip(parts, np.cumsum(list(parts.values())) / sum(parts.values()), strict=True))

    strongest = yield from hold_progress(0.0, paths_shown(channel.plan, channel.view_map))
    steps = warp_map(channel, 1, options.overscan, strongest)
    warp = yield from subprogress(steps, 0.0, ends["warp"])
    view = larger = mesh = None
    if parts["view"]:
        view = yield from subprogress(view_stmap(channel, warp), ends["warp"], ends["view"])
    if parts["larger"]:
        larger = warp
        if options.times > 1:
            steps = warp_map(channel, options.times, options.overscan, strongest)
            larger = yield from subprogress(steps, ends["view"], ends["larger"])
    if parts["mesh"]:
        steps = view_from_display(channel.plan, channel.view_map, grid, strongest)
        places = yield from subprogress(steps, ends["larger"], ends["mesh"])
        pixels = grid.pixels((width, height))
        coverage = channel.coverage.of_display.ravel()[pixels].reshape(grid.rows, grid.columns)
        place = channel.plan.rig.place_of(channel.viewer)
        stmap = of_places(place, channel.viewer, grid, places, coverage, options.overscan)
        mesh = mesh_of((width, height), options.mesh_step, stmap, places)

    return ChannelMaps(warp, view, larger, options.times, mesh)


def description(
    channel: Channel, maps: ChannelMaps, names: dict[str, tuple[str, ...]]
) -> dict[str, Any]:
    """Description of a channel's maps as plain data, for the sidecar file."""
    warp = maps.warp
    coverage = channel.coverage.of_display
    found = {
        "viewer": {
            "name": channel.viewer.name,
            "size": [channel.viewer.width, channel.viewer.height],
        },
        "wavelength_nm": 1e9 * channel.wavelength,
        "index": {
            glass.name: glass.ior.at(channel.wavelength) for glass in channel.plan.rig.glasses
        },
        "files": {form: list(of_form) for form, of_form in names.items()},
        "tolerance_px": channel.view_map.tolerance,
        "coverage": float(coverage.mean()),
        "picture_on_display": float(warp.coverage.mean()),
        "folds": {
            "of_display": float((warp.multiplicity > 1).mean()),
            "most": int(warp.multiplicity.max()),
        },
    }
    if "FFMPEG" in names:
        found["ffmpeg"] = {
            "times": maps.times,
            "command": ffmpeg_command(names["FFMPEG"], warp.size, warp.to_size, maps.times),
        }
    if maps.mesh is not None:
        found["mesh"] = {
            "nodes": [n // maps.mesh.finer + 1 for n in maps.mesh.path.shape[::-1]],
            "faces": len(quads_of(maps.mesh)),
            "off_px": mesh_error(maps.mesh),
        }
    return found


COLOURS = "-colorspace bt709 -color_primaries bt709 -color_trc bt709 -color_range tv"
FAR = -64.0  # px; far enough outside that OpenCV's filters read no part of the picture


def pixels_of(stmap: STMap) -> Floats:
    """Positions (h, w, 2) as pixels of the other image, x right and y down, integers at pixel
    middles; NaN for empty pixels.
    """
    width, height = stmap.to_size
    xy = stmap.st * [width, -height] + [-0.5, height - 0.5]
    return np.where(stmap.is_there[..., None], xy, np.nan)


def write_pgm(folder: Path, names: tuple[str, str], stmap: STMap, times: int) -> None:
    """Write the maps of ffmpeg's remap filter: column and row in the picture enlarged `times`
    times.

    stmap : with each display pixel divided into `times` x `times`
    """
    size = np.array(stmap.to_size) * times
    with np.errstate(invalid="ignore"):
        pixel = np.floor((pixels_of(stmap) + 0.5) * times)
        pixel = np.where(np.isfinite(pixel), np.clip(pixel, 0, size - 1), NOTHING)

    width, height = stmap.size
    for axis, name in enumerate(names):
        header = f"P5\n{width} {height}\n{NOTHING}\n".encode()
        disk.write_bytes(folder / name, header + pixel[..., axis].astype(">u2").tobytes())


def ffmpeg_command(
    names: tuple[str, str], display_size: tuple[int, int], picture_size: tuple[int, int], times: int
) -> str:
    """The ffmpeg command to warp a picture or a film.

    remap reads the nearest pixel, so the picture is enlarged before it and the result reduced after
    it. The output has a pixel format that players support, tagged as Rec.709, or they would guess;
    4:2:0 needs even sizes.
    """
    width, height = display_size
    larger = "x".join(str(n * times) for n in picture_size)
    last = "yuv420p" if width % 2 == height % 2 == 0 else "yuv444p"
    steps = [
        f"[0:v]scale={larger}:flags=bicubic,format=gbrp[p]",
        "[p][1:v][2:v]remap=fill=black[w]",
        f"[w]scale={width}x{height}:flags=area:out_color_matrix=bt709:out_range=tv,"
        f"format={last}[v]",
    ]
    x, y = names
    return (
        f'ffmpeg -i PICTURE -i {x} -i {y} -filter_complex "{";".join(steps)}" -map "[v]"'
        f' -map "0:a?" {COLOURS} OUT.mp4'
    )


def write_npz(path: Path, stmap: STMap) -> None:
    """Write the maps of OpenCV's remap: map_x, map_y (h, w) float32 px, integers at pixel middles;
    coverage (h, w) float32, and the picture's size.
    """
    xy = np.nan_to_num(pixels_of(stmap), nan=FAR).astype(np.float32)
    file = BytesIO()
    np.savez_compressed(
        file,
        map_x=xy[..., 0],
        map_y=xy[..., 1],
        coverage=stmap.coverage.astype(np.float32),
        picture_size=np.array(stmap.to_size),
    )
    disk.write_bytes(path, file.getvalue())


# outside of every image, so programs show nothing there
NOWHERE = -1.0
# a dot in a channel name would make Blender read the file as render layers, without a size
CHANNELS = (
    "R",
    "G",
    "B",
    "A",
    "multiplicity",
    *(f"jacobian_{of}" for of in ("xx", "xy", "yx", "yy")),
)
TOP = 65535  # 16 bits


def write_exr(path: Path, stmap: STMap, about: str) -> None:
    """Write a map as 32-bit OpenEXR: R = s, G = t, B = coverage, A = 1, and further channels.

    Raises
    ------
    ImageError : the file cannot be written, or OpenImageIO is missing
    """
    oiio = image_io.openimageio()
    width, height = stmap.size
    pixels = np.empty((height, width, len(CHANNELS)), np.float32)
    pixels[..., :2] = np.where(np.isfinite(stmap.st), stmap.st, NOWHERE)
    pixels[..., 2] = stmap.coverage
    pixels[..., 3] = 1.0
    pixels[..., 4] = stmap.multiplicity
    pixels[..., 5:] = stmap.jacobian.reshape(height, width, 4)

    spec = oiio.ImageSpec(width, height, len(CHANNELS), "float")
    spec.channelnames = CHANNELS
    spec.alpha_channel = CHANNELS.index("A")
    spec.attribute("compression", "zip")
    spec.attribute("oiio:ColorSpace", "data")
    spec.attribute("Software", "Kiriko")
    spec.attribute("ImageDescription", about)
    image_io.put(path, spec, pixels)


def write_png(path: Path, stmap: STMap, about: str) -> None:
    """Write a map as 16-bit PNG: R = s, G = t, B = coverage, each times 65535; 0 for empty
    pixels.
    """
    there = stmap.is_there[..., None]
    values = np.concatenate([stmap.st, stmap.coverage[..., None]], axis=2)
    numbers = np.rint(np.clip(np.where(there, values, 0.0), 0, 1) * TOP).astype(np.uint16)
    if not image_io.has_openimageio():
        png.write(path, numbers)
        return

    oiio = image_io.openimageio()
    spec = oiio.ImageSpec(*stmap.size, 3, "uint16")
    spec.attribute("oiio:ColorSpace", "data")
    spec.attribute("Software", "Kiriko")
    spec.attribute("ImageDescription", about)
    image_io.put(path, spec, numbers)


SIDECAR = "maps.json"
CONVENTION = (
    "s and t are 0 to 1 from the picture's left and lower edge; the middle of pixel i of W is at"
    " (i + 0.5) / W.",
    "warp: the position in the picture shown by the middle of each display pixel, on the path that"
    " shows most of the pixel. If the middle is not seen but another part of the pixel is, the"
    " position is the middle of the largest such part, and multiplicity is 0.",
    "view: the position on the display seen by the middle of each viewer pixel.",
    "EXR: R = s, G = t, B = coverage of the pixel, A = 1. If B = 0, the pixel shows nothing: s and"
    " t are -1, or outside of 0 to 1 if the light comes from next to the picture. multiplicity:"
    " number of positions in the viewer's image where the display's position is seen."
    " jacobian_xx, _xy, _yx, _yy: pixels of the other image per pixel, x right and y down; the"
    " second letter is the axis of this image.",
    "x.pgm, y.pgm: column and row in the picture, enlarged by ffmpeg Size; 65535 is nothing.",
    "OBJ and .data: x from -aspect to aspect, y from -1 to 1 upwards over the display, with s and"
    " t. In .data the fifth number is the coverage, -1 where no cell is drawn.",
    "NPZ: map_x and map_y in pixels of the picture, row 0 at the top, integers at pixel middles;"
    " -64 is nothing.",
    "PNG: R = s, G = t, B = coverage, each times 65535; B = 0 is nothing.",
)


def names_of(suffix: str, options: MapOptions) -> dict[str, tuple[str, ...]]:
    """File names of a channel by requested format."""
    return {
        form: tuple(f"{Path(name).stem}{suffix}{Path(name).suffix}" for name in names)
        for form, names in FORMATS.items()
        if form in options.formats
    }


def suffixes(seen_by: Sequence[tuple[str, float]]) -> list[str]:
    """Suffixes of file names, one for each channel's viewer name and wavelength, m; empty for a
    single channel.
    """
    has_viewers, has_wavelengths = (len(set(them)) > 1 for them in zip(*seen_by, strict=True))
    found: list[str] = []
    taken: set[str] = set()  # casefolded: file systems may ignore case

    for viewer, wavelength in seen_by:
        base = "_" + re.sub(r"[^\w-]+", "_", viewer) if has_viewers else ""
        base += f"_{1e9 * wavelength:.0f}nm" if has_wavelengths else ""
        suffix, n = base, 1
        while suffix.casefold() in taken:
            n += 1
            suffix = f"{base}_{n}"
        taken.add(suffix.casefold())
        found.append(suffix)

    return found


def earlier_files(folder: Path) -> set[str]:
    """Map files listed in a folder's maps.json; empty if it is missing or malformed.

    Only valid names of maps are returned, so no other file is ever removed.
    """
    try:
        sidecar = json.loads((folder / SIDECAR).read_text(encoding="utf-8"))
        names = [
            (form, name)
            for one in sidecar["maps"]
            for form, of_form in one["files"].items()
            for name in of_form
        ]
        return {name for form, name in names if _is_of(form, name)}
    except (OSError, *MALFORMED):
        return set()


def _is_of(form: str, name: str) -> bool:
    """Whether a map of this format can have this file name."""
    return any(
        re.fullmatch(rf"{Path(plain).stem}(_[\w-]+)?{re.escape(Path(plain).suffix)}", name)
        for plain in FORMATS.get(form, ())
    )


def remove_earlier(folder: Path, earlier: set[str], names: Iterable[str]) -> None:
    """Remove files of earlier maps, except the newly written `names`.

    Raises
    ------
    ImageError : a file cannot be removed
    """
    written = {name.casefold() for name in names}  # file systems may ignore case
    for name in sorted(earlier):
        path = folder / name
        if name.casefold() in written or not path.is_file():
            continue
        try:
            path.unlink()
        except OSError as reason:
            raise ImageError(
                "The old file '{path}' cannot be removed ({why}). Remove it yourself.",
                path=path,
                why=reason.strerror,
            ) from None


def write_maps(
    folder: Path,
    names: dict[str, tuple[str, ...]],
    maps: ChannelMaps,
    about: str,
) -> None:
    """Write the files of a channel to a new folder.

    names : file names by format
    about : one line, stored in formats with room for a comment

    Raises
    ------
    ImageError : a file cannot be written
    """
    for form, of_form in names.items():
        paths = [folder / name for name in of_form]
        if form == "EXR":
            for path, stmap in zip(paths, (maps.warp, maps.view), strict=True):
                write_exr(path, stmap, about)
        elif form == "PNG":
            write_png(paths[0], maps.warp, about)
        elif form == "NPZ":
            write_npz(paths[0], maps.warp)
        elif form == "FFMPEG":
            write_pgm(folder, of_form, maps.larger, maps.times)
        elif form == "OBJ":
            write_obj(paths[0], maps.mesh, about)
        else:
            write_data(paths[0], maps.mesh)
