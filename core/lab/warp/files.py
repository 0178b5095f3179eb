"""The files of warp maps: their names, their description, and STMaps as OpenEXR or PNG images.

The numbers of an STMap are places, no colours: no curve is applied to them.
"""

import json
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from ...base.errors import MALFORMED, ImageError
from ...files import image_io, png
from .channel_maps import ChannelMaps
from .options import FORMATS, MapOptions
from .stmap import STMap
from .tables import write_npz, write_pgm
from .warp_mesh import write_data, write_obj

# outside of every image, so that programs show nothing there
NOWHERE = -1.0
# Blender takes a file with dots in the names of channels for one of render layers, without a size
CHANNELS = (
    "R",
    "G",
    "B",
    "A",
    "multiplicity",
    *(f"jacobian_{of}" for of in ("xx", "xy", "yx", "yy")),
)
TOP = 65535  # the largest number of 16 bits


def write_exr(path: Path, stmap: STMap, about: str) -> None:
    """Write a map as 32-bit OpenEXR: R = s, G = t, B = coverage, A = 1, and more channels.

    Raises
    ------
    ImageError : it cannot be written, or there is no OpenImageIO
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
    """Write a map as 16-bit PNG: R = s, G = t, B = coverage, each times 65535; 0 where there
    is nothing.
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
    "warp: for each display pixel, at its middle, the place in the picture that it shows, on the"
    " path that most of the pixel is seen by. Where its middle is not seen, but another part is,"
    " the place is the middle of the largest such part, and multiplicity is 0.",
    "view: for each viewer pixel, at its middle, the place on the display that it sees.",
    "EXR: R = s, G = t, B = coverage of the pixel, A = 1; B = 0 where nothing is shown: s and t are"
    " -1 there, or beyond 0 to 1 where a place beside the picture is seen. multiplicity: at how"
    " many places of the viewer's image the display's place is seen."
    " jacobian_xx, _xy, _yx, _yy: pixels of the other image per pixel, x right and y down; the"
    " second letter is the axis of this image.",
    "x.pgm, y.pgm: column and row of the picture made so many times as large; 65535 is nothing.",
    "OBJ and .data: x from -aspect to aspect, y from -1 to 1 upwards over the display, with s and"
    " t. In .data the fifth number is the coverage, -1 where no cell is drawn.",
    "NPZ: map_x and map_y in pixels of the picture, row 0 at the top, whole numbers at the middles"
    " of pixels; -64 is nothing.",
    "PNG: R = s, G = t, B = coverage, each times 65535; B = 0 is nothing.",
)


def names_of(suffix: str, options: MapOptions) -> dict[str, tuple[str, ...]]:
    """The files of each format that is wanted, for a channel."""
    return {
        form: tuple(f"{Path(name).stem}{suffix}{Path(name).suffix}" for name in names)
        for form, names in FORMATS.items()
        if form in options.formats
    }


def suffixes(seen_by: Sequence[tuple[str, float]]) -> list[str]:
    """What is added to the names of files for each channel, by its viewer's name and wavelength,
    m; nothing where there is one channel alone.
    """
    has_viewers, has_wavelengths = (len(set(them)) > 1 for them in zip(*seen_by, strict=True))
    found: list[str] = []
    taken: set[str] = set()  # disks may not tell capitals from small letters

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
    """The files of maps that a folder's maps.json tells of; none where it is no such file.

    Only names that a map can have: nothing else is ever taken for one.
    """
    try:
        told = json.loads((folder / SIDECAR).read_text(encoding="utf-8"))
        names = [
            (form, name)
            for one in told["maps"]
            for form, of_form in one["files"].items()
            for name in of_form
        ]
        return {name for form, name in names if _is_of(form, name)}
    except (OSError, *MALFORMED):
        return set()


def _is_of(form: str, name: str) -> bool:
    """Can a file of this name hold a map of a format?"""
    return any(
        re.fullmatch(rf"{Path(plain).stem}(_[\w-]+)?{re.escape(Path(plain).suffix)}", name)
        for plain in FORMATS.get(form, ())
    )


def remove_earlier(folder: Path, earlier: set[str], names: Iterable[str]) -> None:
    """Remove files of earlier maps, but those of these names, which have been written anew.

    Raises
    ------
    ImageError : one cannot be removed
    """
    kept = {name.casefold() for name in names}  # disks may not tell capitals from small letters
    for name in sorted(earlier):
        path = folder / name
        if name.casefold() in kept or not path.is_file():
            continue
        try:
            path.unlink()
        except OSError as reason:
            raise ImageError(
                "The file '{path}' of earlier maps cannot be removed ({why}): remove it yourself.",
                path=path,
                why=reason.strerror,
            ) from None


def write_maps(
    folder: Path,
    names: dict[str, tuple[str, ...]],
    maps: ChannelMaps,
    about: str,
) -> None:
    """Write the files of a channel, by their names, to a new folder.

    about : a line on them, kept in the files that have room for it

    Raises
    ------
    ImageError : one cannot be written
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
