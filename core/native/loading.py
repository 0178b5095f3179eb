"""Finds and loads the kernel's library, unless it is switched off."""

import ctypes
import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from .structures import _D, _I, _P, NODE, STRUCTURES

MODULE = "kiriko_kernel"
# environment variable: "off" for numpy, or the path of another library
SWITCH = "KIRIKO_KERNEL"
ENDINGS = {"nt": "dll", "posix": "so"}  # by os.name; macOS accepts any
VERSION = 16  # of the structures' meaning, as in kiriko.h
MOST_LAYERS = 256
# types of results and arguments
FUNCTIONS = {
    "kiriko_layout": (_I, _I),
    "kiriko_begin_tree": (_P, _P, _I),
    "kiriko_follow": (None, _P, _P, _I, _I, _I),
    "kiriko_bisect": (None, _P, _P, _P, _I, _I, _I),
    "kiriko_begin_division": (_P, _P, _I, _I),
    "kiriko_is_done": (_I, _P),
    "kiriko_end": (None, _P, _I),
    "kiriko_divide": (None, _P, _I),
    "kiriko_add": (None, _P, _I, _I),
    "kiriko_find_across": (_I, _P, _I, _I, _P, _I, _D, _P),
    "kiriko_touch": (None, _P, _P, _I),
    "kiriko_paint": (None, _P, _P, _I, _P, _I, _P, _I),
    "kiriko_repaint": (None, _P, _P, _P, _I, _I),
    "kiriko_free_taps": (None, _P),
    "kiriko_halve": (None, _P, _P),
    "kiriko_decode": (_I, _P, _P, *3 * [_I]),
    "kiriko_finish": (None, *4 * [_P], _I, _I),
    "kiriko_fit_fields": (None, _P, _P, _I),
    "kiriko_make_slopes": (None, *3 * [_P], *3 * [_I]),
    "kiriko_sweep_normals": (None, *6 * [_P], *3 * [_I]),
    "kiriko_find_offsets": (None, *5 * [_P], _I, _P, _I),
    "kiriko_make_faces": (None, *6 * [_P], _I, *4 * [_P], _I),
    "kiriko_agree": (None, *9 * [_P], _D, _I, _I, _P, _P, _I),
}

_threads = 0  # one for each processor


def use_threads(number: int) -> None:
    """Set the kernel's number of threads; 0: one for each processor. Results do not change."""
    global _threads
    _threads = number


def n_threads() -> int:
    """The kernel's number of threads."""
    return _threads or _n_processors()


@cache
def _n_processors() -> int:
    # Linux reads a file for it, and progress calls this thousands of times
    return os.cpu_count() or 1


def find_library() -> Path | None:
    """The library file set in the environment or installed by the wheel; None without one."""
    if os.environ.get(SWITCH):
        return Path(os.environ[SWITCH])
    spec = find_spec(MODULE)
    folders = (spec and spec.submodule_search_locations) or []
    return next(
        (path for folder in folders for path in Path(folder).glob(f"*.{ENDINGS[os.name]}")), None
    )


@cache
def loaded() -> ctypes.CDLL | None:
    """The library, if it can be loaded and its structures match this version."""
    path = find_library()
    if path is None:
        return None

    try:
        library = ctypes.CDLL(str(path))
        for name, (result, *arguments) in FUNCTIONS.items():
            function = getattr(library, name)
            function.restype = result
            function.argtypes = arguments
    except (OSError, AttributeError):  # another processor or system, or another library
        return None

    expected = [VERSION, MOST_LAYERS, NODE.itemsize, *map(ctypes.sizeof, STRUCTURES)]
    is_compatible = [library.kiriko_layout(i) for i in range(len(expected))] == expected
    return library if is_compatible else None


_is_off = False


@contextmanager
def off() -> Iterator[None]:
    """Use numpy instead of the kernel within this context."""
    global _is_off
    before, _is_off = _is_off, True
    try:
        yield
    finally:
        _is_off = before


def library() -> ctypes.CDLL | None:
    """The library; None if missing, incompatible, or switched off."""
    return None if _is_off or os.environ.get(SWITCH) == "off" else loaded()
