"""How much memory is free, and a refusal, in one sentence, of work that would take more."""

import ctypes
import os
import sys
from pathlib import Path

from .errors import RigError
from .numbers import number


def check_free(needed: float, work: str, remedy: str) -> None:
    """Raise RigError, with the remedy, when some work would take more memory, bytes,
    than is free.
    """
    free = available()
    if free is not None and needed > free:
        raise RigError(
            "{work} would take about {needed} GB of memory, but {free} GB are free: {remedy}.",
            work=work,
            needed=number(needed / 1e9),
            free=number(free / 1e9),
            remedy=remedy,
        )


def is_free(needed: float) -> bool:
    """Is so much memory free, bytes, as far as that is known?"""
    free = available()
    return free is None or needed <= free


def available() -> float | None:
    """Bytes of memory that are free; all there is where the
    system tells no more; None where it tells nothing.
    """
    if sys.platform == "win32":
        return _available_in_windows()

    try:
        kibibytes = dict(
            line.split(":")
            for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        )
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
        *((name, ctypes.c_uint64) for name in ("total", "available", "page", "page_free",
        "virtual", "virtual_free")),
        ("extended", ctypes.c_uint64),
    ]  # fmt: skip


def _available_in_windows() -> float | None:
    status = _MemoryStatus()
    status.length = ctypes.sizeof(status)
    is_told = ctypes.windll.kernel32.GlobalMemoryStatusEx(ctypes.byref(status))
    return float(status.available) if is_told else None
