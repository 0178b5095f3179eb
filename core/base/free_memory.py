"""Free memory, and a one-sentence refusal of work that would exceed it."""

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from .errors import RigError
from .numbers import number

MEMINFO, STATM = Path("/proc/meminfo"), Path("/proc/self/statm")
GROUPS, GROUPS_OF_SELF = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")
# files of a control group: its limit and its use, bytes; the line of memory.stat with droppable
# file cache
V1 = "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"
V2 = "memory.max", "memory.current", "inactive_file"


def check_free(needed: float, work: str, remedy: str) -> None:
    """Raise RigError, with the remedy, if work needs more memory (bytes) than is free."""
    free = available()
    if free is not None and needed > free:
        raise RigError(
            "{work} needs about {needed} GB of memory, but only {free} GB are free: {remedy}.",
            work=work,
            needed=number(needed / 1e9),
            free=number(free / 1e9),
            remedy=remedy,
        )


def is_free(needed: float) -> bool:
    """Whether so many bytes are free; True if unknown."""
    free = available()
    return free is None or needed <= free


def available() -> float | None:
    """Bytes this process can still allocate, None if unknown.

    The minimum of the system's free memory, the limits of the process's control groups (containers,
    batch systems) and its own address space.
    """
    if sys.platform == "win32":
        return _available_in_windows()
    found = (_free_in_system(), *_free_in_groups(), _free_address_space())
    return min((max(free, 0.0) for free in found if free is not None), default=None)


def _free_in_system() -> float | None:
    """Free bytes on Linux; total bytes on other systems."""
    try:
        lines = (line.split(":") for line in MEMINFO.read_text(encoding="ascii").splitlines())
        return 1024.0 * int(dict(lines)["MemAvailable"].split()[0])
    except (OSError, KeyError, ValueError):
        pass
    try:
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (OSError, ValueError):
        return None


def _free_in_groups() -> Iterator[float]:
    """Free bytes within each limit of the process's control groups and their parents."""
    try:
        groups = [line.split(":", 2) for line in GROUPS_OF_SELF.read_text().splitlines()]
    except OSError:
        return
    for _, controllers, path in groups:
        if controllers not in ("", "memory"):
            continue
        root = GROUPS / controllers  # version 2 has one tree for all controllers
        limit, used, cached = V1 if controllers else V2
        group = root / path.lstrip("/")
        for folder in (group, *group.parents):
            with suppress(OSError, ValueError, KeyError):  # "max": no limit
                free = int((folder / limit).read_text()) - int((folder / used).read_text())
                of_files = dict(map(str.split, (folder / "memory.stat").read_text().splitlines()))
                yield float(free + int(of_files[cached]))
            if folder == root:
                break


def _free_address_space() -> float | None:
    """Bytes left under the process's address-space limit (`ulimit -v`), None without one."""
    import resource

    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    try:
        pages = int(STATM.read_text(encoding="ascii").split()[0])
    except (OSError, ValueError):
        return None
    used = float(pages * os.sysconf("SC_PAGE_SIZE"))
    return None if limit == resource.RLIM_INFINITY else limit - used


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
    is_read = ctypes.windll.kernel32.GlobalMemoryStatusEx(ctypes.byref(status))
    return float(status.available) if is_read else None
