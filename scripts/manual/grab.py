"""A picture of Blender's window as raw RGB, row 0 at the top.

Blender's own screenshot reads the front buffer, which is black with software OpenGL. Then the
picture comes from the X server.
"""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path

import bpy
import numpy as np

ALL_PLANES = ctypes.c_ulong(-1)
Z_PIXMAP = 2
SHOT = "shot.png"  # Blender's own, which is read and gone again


class XImage(ctypes.Structure):
    """The beginning of Xlib's structure of the same name."""

    _fields_ = (
        *((name, ctypes.c_int) for name in ("width", "height", "xoffset", "format")),
        ("data", ctypes.POINTER(ctypes.c_ubyte)),
        *((name, ctypes.c_int) for name in ("byte_order", "unit", "bit_order", "pad", "depth")),
        ("bytes_per_line", ctypes.c_int),
    )


def grab(window: bpy.types.Window, path: Path) -> tuple[int, int]:
    """Write the window's pixels into a file; its width and height."""
    pixels = look(window, path.with_name(SHOT))
    path.write_bytes(pixels.tobytes())
    return pixels.shape[1], pixels.shape[0]


def look(window: bpy.types.Window, path: Path) -> np.ndarray:
    """The window's pixels (height, width, 3), uint8, by a temporary file at `path`."""
    if is_black(path):
        return by_x_server(window.width, window.height)
    with bpy.context.temp_override(window=window):
        return by_blender(path)


def glance(window: bpy.types.Window, path: Path) -> bytes:
    """Bytes that are equal while the window does not change. No image is added or removed, or
    Cycles would restart the viewport's image.
    """
    if is_black(path):
        return by_x_server(window.width, window.height).tobytes()
    screenshot(path)
    written = path.read_bytes()
    path.unlink()
    return written


@cache
def is_black(path: Path) -> bool:
    """Whether Blender's own screenshot is black on this machine, by a temporary file."""
    return not by_blender(path).any()


def screenshot(path: Path) -> None:
    """Have Blender write a PNG of its window."""
    bpy.ops.screen.screenshot(filepath=str(path), check_existing=False)


def by_blender(path: Path) -> np.ndarray:
    """Blender's own screenshot (height, width, 3), uint8."""
    screenshot(path)
    image = bpy.data.images.load(str(path))
    width, height = image.size
    values = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(values)
    bpy.data.images.remove(image)
    path.unlink()
    rows = values.reshape(height, width, -1)[::-1, :, :3]
    return np.ascontiguousarray((rows * 255 + 0.5).astype(np.uint8))


def by_x_server(width: int, height: int) -> np.ndarray:
    """The window of this size, as the X server shows it (height, width, 3), uint8."""
    x11 = ctypes.CDLL("libX11.so.6")
    x11.XOpenDisplay.restype = ctypes.c_void_p
    x11.XDefaultRootWindow.restype = ctypes.c_ulong
    x11.XDefaultRootWindow.argtypes = [ctypes.c_void_p]
    x11.XGetImage.restype = ctypes.POINTER(XImage)
    x11.XGetImage.argtypes = [
        ctypes.c_void_p, ctypes.c_ulong, ctypes.c_int, ctypes.c_int, ctypes.c_uint, ctypes.c_uint,
        ctypes.c_ulong, ctypes.c_int,
    ]  # fmt: skip
    display = ctypes.c_void_p(x11.XOpenDisplay(None))
    root = x11.XDefaultRootWindow(display)
    x, y = place_of_window(x11, display, root, (width, height))
    image = x11.XGetImage(display, root, x, y, width, height, ALL_PLANES, Z_PIXMAP).contents

    n_bytes = image.bytes_per_line * height
    rows = np.ctypeslib.as_array(image.data, (n_bytes,)).reshape(height, -1)
    pixels = rows[:, : 4 * width].reshape(height, width, 4)[:, :, 2::-1]
    taken = np.ascontiguousarray(pixels)
    x11.XCloseDisplay(display)
    return taken


def place_of_window(
    x11: ctypes.CDLL, display: ctypes.c_void_p, root: int, size: tuple[int, int]
) -> tuple[int, int]:
    """Where on the screen the window of this size is, from the upper left corner."""
    one = ctypes.c_ulong
    todo = [root]
    while todo:
        name = todo.pop()
        above, parent, n, list_ = one(), one(), ctypes.c_uint(), ctypes.POINTER(one)()
        x11.XQueryTree(display, one(name), *map(ctypes.byref, (above, parent, list_, n)))
        todo += list_[: n.value]
        place = (ctypes.c_int(), ctypes.c_int())
        extent = [ctypes.c_uint() for _ in range(4)]
        x11.XGetGeometry(display, one(name), *map(ctypes.byref, (above, *place, *extent)))
        if name != root and (extent[0].value, extent[1].value) == size:
            x11.XTranslateCoordinates(
                display, one(name), one(root), 0, 0, *map(ctypes.byref, (*place, above))
            )
            return place[0].value, place[1].value
    return 0, 0  # a server without a window manager: Blender has the whole screen
