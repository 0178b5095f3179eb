"""Names of temporary files and folders, which tell the process that made them; those that it left
behind are removed.
"""

import hashlib
import os
import platform
import shutil
from contextlib import suppress
from pathlib import Path

PREFIX = ".kiriko-"  # of such files' names
MOVING = "-moving-"  # in the name of one that is there while a set of files takes its place
BOOT = Path("/proc/sys/kernel/random/boot_id")  # another one at each start of Linux
NUMBERS = Path("/proc/self/ns/pid")  # the set that numbers of processes are of


def own_name() -> str:
    """How names of this process's temporary files and folders begin; no other's do."""
    return f"{PREFIX}{_started()}-{os.getpid()}-"


def _started() -> str:
    """Tells this start of this machine, and its processes' numbers, from others; the machine alone
    if the system does not tell more, as macOS; "any" on Windows, where no process is asked for.
    """
    try:
        start = BOOT.read_text(encoding="ascii").strip()
        # processes in a container have numbers of their own
        return hashlib.sha1(
            f"{start} {NUMBERS.stat().st_ino}".encode(), usedforsecurity=False
        ).hexdigest()[:12]
    except OSError:
        name = platform.node() if os.name == "posix" else ""
        return (
            hashlib.sha1(name.encode(), usedforsecurity=False).hexdigest()[:12] if name else "any"
        )


def remove_left(folder: Path) -> bool:
    """Remove temporary files and folders that processes left in a folder when they were killed.

    Returns whether one was killed while it moved a set of files into the folder.

    Only those of this start of this machine, whose process is gone: another machine may be at work
    in the same folder. One that has a user's file, as of a set that was being replaced, stays.
    """
    is_part = False
    for place in folder.glob(f"{PREFIX}*"):
        if is_of_the_gone(place.name) and not (place / "old").exists():
            is_part |= MOVING in place.name
            if place.is_dir():
                shutil.rmtree(place, ignore_errors=True)
            else:
                with suppress(OSError):
                    place.unlink()
    return is_part


def is_of_the_gone(name: str) -> bool:
    """Does a name begin with that of a process, of this start of this machine, that is gone?"""
    started = _started()
    own = f"{PREFIX}{started}-"
    number, dash, _ = name.removeprefix(own).partition("-")
    is_own = started != "any" and name.startswith(own) and dash and number.isdecimal()
    return bool(is_own) and not _is_running(int(number))


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)  # on Linux, nothing else than to ask
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):  # it is another user's, or no number of a process
        return True
    return True
