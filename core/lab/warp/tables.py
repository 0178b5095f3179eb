"""STMaps as tables of pixels: for ffmpeg's remap filter, and for OpenCV's."""

from io import BytesIO
from pathlib import Path

import numpy as np

from ...base.arrays import Floats
from ...files import disk
from .options import NOTHING
from .stmap import STMap

COLOURS = "-colorspace bt709 -color_primaries bt709 -color_trc bt709 -color_range tv"
FAR = -64.0  # px: so far beside the picture no filter of OpenCV reads any of it


def pixels_of(stmap: STMap) -> Floats:
    """Places (h, w, 2) as pixels of the other image, x right and y down, whole numbers at their
    middles; NaN where nothing is shown.
    """
    width, height = stmap.to_size
    xy = stmap.st * [width, -height] + [-0.5, height - 0.5]
    return np.where(stmap.is_there[..., None], xy, np.nan)


def write_pgm(folder: Path, names: tuple[str, str], stmap: STMap, times: int) -> None:
    """Write the maps of ffmpeg's remap filter: which column, and which row, of the picture made
    `times` as large each pixel shows.

    stmap : with each display pixel cut into `times` a side
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
    """The command that warps a picture, or a film, by the maps.

    The picture is made larger first and the image smaller at last: the filter between them reads
    the nearest pixel. The end is a pixel format that players take, told as Rec.709, which they
    would guess; 4:2:0 wants even sizes.
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
    """Write the maps of OpenCV's remap: map_x, map_y (h, w) float32 px, whole numbers at the
    middles of pixels; coverage (h, w) float32, and the sizes.
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
