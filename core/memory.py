"""How much memory a solve takes, told before it is taken.

The amounts are those that `dev.py bench` measures beside this estimate: within a factor of 2 from 100 MB on.
"""

import ctypes
import os
import sys
from pathlib import Path

from .errors import RigError
from .rig import Rig
from .shares import MOST_KEPT

ALWAYS = 60e6  # bytes
OF_DISPLAY, OF_VIEWER, OF_SHARE, OF_TRIANGLE = 55, 20, 61, 1200  # bytes for each pixel, share, triangle
OWN_SHARES, VIEWER_SHARES, MOST_VIEWER_SHARES = 1.2, 1.5, 14  # for a display pixel; for one of the viewer's, up to


def estimated(rig: Rig) -> dict[str, float]:
    """Bytes that a solve is about to take beside what is there already, by what they are taken for."""
    display, viewer = (float(part.width) * part.height for part in (rig.display, rig.viewer))
    n_triangles = sum(len(part.mesh.triangles) for part in (*rig.glasses, *rig.mirrors))
    n_shares = OWN_SHARES * display + min(VIEWER_SHARES * viewer, MOST_VIEWER_SHARES * display)
    return {
        "display": OF_DISPLAY * display + OF_SHARE * min(n_shares, MOST_KEPT),
        "viewer": OF_VIEWER * viewer,
        "glass": OF_TRIANGLE * n_triangles,
        "always": ALWAYS,
    }


def check_memory(rig: Rig) -> None:
    """Raise RigError when a solve would take more memory than is free."""
    free, parts = available(), estimated(rig)
    total = sum(parts.values())
    if free is None or total <= free:
        return
    display, viewer = rig.display, rig.viewer
    remedies = {
        "display": f"lower the resolution of the display '{display.name}' ({display.width} x {display.height})",
        "viewer": f"lower the resolution of the scene's render ({viewer.width} x {viewer.height})",
        "glass": "give the glass fewer triangles",
        "always": "close other programs",
    }
    remedy = remedies[max(parts, key=parts.get)]
    raise RigError(
        f"Solving would take about {total / 1e9:.2g} GB of memory, but {free / 1e9:.2g} GB are free: {remedy}."
    )


def available() -> float | None:
    """Bytes of memory that are free; all there is where the system tells no more; None where it tells nothing."""
    if sys.platform == "win32":
        return _available_in_windows()
    try:
        kibibytes = dict(line.split(":") for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines())
        return 1024.0 * int(kibibytes["MemAvailable"].split()[0])
    except (OSError, KeyError, ValueError):
        pass
    try:
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (OSError, ValueError):
        return None


class _MemoryStatus(ctypes.Structure):
    """MEMORYSTATUSEX of the Windows API."""

    _fields_ = [
        ("length", ctypes.c_uint32),
        ("load", ctypes.c_uint32),
        *((name, ctypes.c_uint64) for name in ("total", "available", "page", "page_free", "virtual", "virtual_free")),
        ("extended", ctypes.c_uint64),
    ]  # fmt: skip


def _available_in_windows() -> float | None:
    status = _MemoryStatus()
    status.length = ctypes.sizeof(status)
    is_told = ctypes.windll.kernel32.GlobalMemoryStatusEx(ctypes.byref(status))
    return float(status.available) if is_told else None
