"""Image files on disk: truncation, orientation, colour profile, and reading photographs."""

import re
import struct
from pathlib import Path
from tempfile import gettempdir
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..base.arrays import Floats
from ..base.errors import ImageError
from ..base.free_memory import check_free
from ..base.messages import Message
from . import image_io, png
from .disk import read_bytes, scratch
from .encoding import DISPLAY_P3, REC709, REC2020, linear_from_srgb, xyz_from

JPEG, TIFF, RIFF = b"\xff\xd8\xff", (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"), b"RIFF"
GIF, GIF_END = b"GIF8", b";"
IN_SCAN = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]", re.DOTALL)  # a marker that ends a scan
SCAN, END = b"\xff\xda", b"\xff\xd9"  # JPEG markers: start of scan, end of image
OF_PIXEL = 40  # bytes: a photograph as float32, rotated, and searched (27 to 35 measured)
EXR = b"v/1\x01"
CICP = "cICP"
# precedes Exif data in a JPEG, a PNG and a WebP
EXIF = re.compile(rb"(Exif\0\0|eXIf|EXIF....)(?=II\*\0|MM\0\*)", re.DOTALL)
ORIENTATION = 0x112
STRAIGHT = "oiio:UnassociatedAlpha"  # colours not multiplied by alpha
# by codes of ITU-T H.273: red, green, blue and white of Rec.709, Rec.2020 and Display P3
PRIMARIES = {
    1: REC709,
    9: REC2020,
    12: DISPLAY_P3,
}
SRGB_CURVE = 13
D50 = np.array([0.9642, 1.0, 0.8249])  # XYZ of the white point of ICC profiles
# XYZ to cone responses, in which whites are adapted. Source: ICC.1:2022, Annex E
BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)


def is_cut(path: Path) -> bool:
    """Whether an image is truncated, for the formats Blender loads anyway, with the rest grey or
    black.

    False if the file does not exist, and for TIFF without OpenImageIO.

    Source: a JPEG ends with EOI (ITU-T T.81, B.2.1), a GIF with a semicolon; a WebP's RIFF header
    gives its length.
    """
    try:
        data = read_bytes(path)
        if data.startswith(JPEG):
            return not _has_jpeg_end(data)
        if data.startswith(GIF):
            return not data.rstrip(b"\0").endswith(GIF_END)
        if data.startswith(RIFF):
            return len(data) < 8 + int.from_bytes(data[4:8], "little")
        if data.startswith(TIFF) and image_io.has_openimageio():
            image_io.read(path, is_plain=True)
    except ImageError:
        return path.is_file()
    return False


def _has_jpeg_end(data: bytes) -> bool:
    """Whether a JPEG has its end marker.

    Data after the end, such as the film of a motion photograph, is ignored. Within a scan, a byte
    FF that starts no marker is followed by 00 or a restart marker.
    """
    at, is_scan = 2, False
    while at + 4 <= len(data) or data[at : at + 2] == END:
        if data[at : at + 2] == END:
            return is_scan
        if data[at] != 0xFF:
            return False
        if data[at + 1] == 0xFF:  # padding
            at += 1
            continue
        is_scan |= data[at : at + 2] == SCAN
        at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
        if is_scan:
            mark = IN_SCAN.search(data, at)
            if mark is None:
                return False
            at = mark.start()
    return False


def has_header(path: Path) -> bool:
    """Whether an OpenEXR file's header is complete; True for other files.

    Blender 4.2 hangs on a truncated header.
    """
    with path.open("rb") as file:
        data = file.read(1 << 16)
    # after magic number and version: name, type, length and value of each attribute
    rest = data[8:] if data.startswith(EXR) else b"\0"
    while rest[:1] not in {b"", b"\0"}:
        rest = rest.split(b"\0", 2)[-1]
        rest = rest[4 + int.from_bytes(rest[:4], "little") :]
    return bool(rest)


def said_by(path: Path) -> dict[str, Any]:
    """Metadata of a file under OpenImageIO's names, plus a PNG's cICP; only orientation and cICP
    without OpenImageIO.
    """
    has_reader = image_io.has_openimageio()
    try:
        with path.open("rb") as file:
            data = file.read(1 << 12 if has_reader else -1)
        said = image_io.about(path) if has_reader else _orientation(data)
    except (ImageError, OSError):
        return {}
    at = data.find(CICP.encode(), 0, 1 << 12)
    is_there = at > 0 and data.startswith(png.SIGNATURE)
    return said | {CICP: data[at + 4 : at + 8]} if is_there else said


def _orientation(data: bytes) -> dict[str, Any]:
    """A file's orientation, 1 to 8, under OpenImageIO's name.

    Source: TIFF 6.0, section 2. Exif data has the same form: after a marker in a JPEG, in its own
    chunk in a PNG or WebP.
    """
    found = EXIF.search(data)
    start = 0 if data.startswith(TIFF[:2]) else found.end() if found else len(data)
    order = "<" if data[start : start + 2] == b"II" else ">"
    try:
        (at,) = struct.unpack_from(f"{order}I", data, start + 4)
        (n,) = struct.unpack_from(f"{order}H", data, start + at)
        for k in range(n):
            tag, _, _, value = struct.unpack_from(f"{order}HHIH", data, start + at + 2 + 12 * k)
            if tag == ORIENTATION and 1 <= value <= 8:
                return {"Orientation": value}
    except struct.error:  # truncated or missing
        pass
    return {}


def read_photograph(path: Path | str) -> np.ndarray:
    """Numbers of an image file as `read`, rotated upright by Exif orientation: (h, w, c) float32.

    Raises
    ------
    ImageError
        The file is missing or broken.
    RigError
        Searching it needs more memory than is free.
    """
    width, height = image_io.size(path)
    check_free(
        float(OF_PIXEL) * width * height,
        Message("Reading the photograph '{path}'", path=path),
        Message("choose a smaller one ({width} x {height} pixels)", width=width, height=height),
    )
    pixels, about = image_io.read(path)
    return turned(pixels, about.get("Orientation", 1))


def turned(pixels: np.ndarray, orientation: int) -> np.ndarray:
    """Pixels (h, w, ...) rotated or mirrored by an Exif orientation, 1 to 8."""
    rows_are_columns = orientation > 4
    pixels = pixels.swapaxes(0, 1) if rows_are_columns else pixels
    down = -1 if orientation in {3, 4, 7, 8} else 1
    across = -1 if orientation in {2, 3, 6, 7} else 1
    return pixels[::down, ::across]


def upright(path: Path) -> tuple[bytes, str]:
    """An image file rotated upright by its Exif orientation, and the suffix of its format.

    The format keeps the numbers unchanged, with their colour profile. ImageError if it cannot be
    read or written.
    """
    oiio = image_io.openimageio()
    plain = oiio.ImageSpec()
    plain.attribute(STRAIGHT, 1)
    stored = oiio.ImageBuf(str(path), 0, 0, plain)
    about = stored.spec()
    pixels = stored.get_pixels(about.format, stored.roi_full)
    if stored.has_error:
        raise image_io.unreadable(path, stored.geterror())

    pixels = np.ascontiguousarray(turned(pixels, about.get_int_attribute("Orientation", 1)))
    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, about.format)
    spec.channelnames, spec.alpha_channel = about.channelnames, about.alpha_channel
    for one in about.extra_attribs:
        if one.name in {STRAIGHT, "ICCProfile", "chromaticities"}:
            spec.attribute(one.name, one.type, one.value)

    is_float, is_tiff = pixels.dtype.kind == "f", stored.file_format_name == "tiff"
    suffix = ".tif" if is_tiff else ".exr" if is_float else ".png"
    with scratch(Path(gettempdir())) as folder:
        image_io.put(folder / f"upright{suffix}", spec, pixels)
        return read_bytes(folder / f"upright{suffix}"), suffix


def light_said(said: dict[str, Any], numbers: Floats) -> Floats | None:
    """Linear Rec.709 light of numbers (n, 3), 0..1, by a file's profile or chromaticities.

    None without either, or if the profile is not a matrix with curves.
    """
    if CICP in said:
        primaries, curve = PRIMARIES.get(said[CICP][0]), said[CICP][1]
        if primaries is None or curve != SRGB_CURVE:
            return None
        return _rec709_from_xyz(linear_from_srgb(numbers) @ _xyz_from(primaries).T)
    if "ICCProfile" in said:
        return _light_by_profile(np.asarray(said["ICCProfile"], np.uint8).tobytes(), numbers)
    if "chromaticities" in said:
        return _rec709_from_xyz(numbers @ _xyz_from(said["chromaticities"]).T)
    return None


def _rec709_from_xyz(xyz: Floats) -> Floats:
    return xyz @ np.linalg.inv(_xyz_from(REC709)).T


def _xyz_from(chromaticities: ArrayLike) -> Floats:
    """Matrix (3, 3) to XYZ, adapted to D50, from x and y (8,) of red, green, blue and white."""
    made = xyz_from(chromaticities)
    gain = (BRADFORD @ D50) / (BRADFORD @ made.sum(axis=1))
    return np.linalg.inv(BRADFORD) @ np.diag(gain) @ BRADFORD @ made


def _light_by_profile(profile: bytes, numbers: Floats) -> Floats | None:
    """Linear light by an ICC profile. Source: ICC.1:2022, 7.3, 8.3.3, 10.6, 10.18."""
    try:
        (n,) = struct.unpack_from(">I", profile, 128)
        entries = (struct.unpack_from(">4sII", profile, 132 + 12 * k) for k in range(min(n, 100)))
        tags = {name: profile[start : start + size] for name, start, size in entries}
        columns = [_numbers_of(tags[b"%cXYZ" % c], 8, 3) for c in b"rgb"]
        curves = [_curve(tags[b"%cTRC" % c]) for c in b"rgb"]
    except (KeyError, struct.error):
        return None
    light = np.column_stack([curve(numbers[:, k]) for k, curve in enumerate(curves)])
    return _rec709_from_xyz(light @ np.array(columns))


def _numbers_of(tag: bytes, start: int, n: int) -> Floats:
    """Fixed-point numbers (16.16 bits)."""
    return np.array(struct.unpack_from(f">{n}i", tag, start)) / 65536


def _curve(tag: bytes) -> Any:
    """The function from numbers to light in a curve tag."""
    if tag.startswith(b"para"):
        (kind,) = struct.unpack_from(">H", tag, 8)
        g, a, b, c, d, e, f = (*_numbers_of(tag, 12, (1, 3, 4, 5, 7)[kind]), *[0.0] * 6)[:7]
        if kind == 0:
            return lambda x: x**g
        if kind < 3:  # the power law starts where its base is 0
            d, c, e, f = -b / a, 0.0, c, c
        return lambda x: np.where(x >= d, np.maximum(a * x + b, 0) ** g + e, c * x + f)
    (n,) = struct.unpack_from(">I", tag, 8)
    table = np.array(struct.unpack_from(f">{n}H", tag, 12)) / (256 if n == 1 else 65535)
    if n < 2:
        return lambda x: x ** (table[0] if n else 1.0)
    return lambda x: np.interp(x, np.linspace(0, 1, n), table)
