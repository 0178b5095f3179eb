"""The kernel's libraries for all platforms, as LIEF reads them: few of them can be run here."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import build_kernel
from environments import FORMATS, ROOT, clean_environment, set_up

pytestmark = pytest.mark.long(reason="the gate builds one platform's zip")

TARGETS = {target.platform.replace("-", "_"): target for target in build_kernel.TARGETS}
FORMAT_OF = {"linux": "ELF", "windows": "PE", "macos": "Mach-O"}
FUNCTION = re.compile(r"^KIRIKO_API\s[^;{]*?\b(\w+)\(", re.MULTILINE)
# Names of zig's own linker, which are in each library that it makes for macOS.
EXPORTS_OF_LINKER = {"macos": {"__dso_handle", "_mh_dylib_header"}}

# The libraries that those of a system need: its own C library and threads.
NEEDS = {
    "linux": {"libc.so.6", "libm.so.6", "libpthread.so.0"},
    "windows": {
        "KERNEL32.dll",
        *(f"api-ms-win-crt-{part}-l1-1-0.dll" for part in ("heap", "math", "runtime", "stdio")),
    },
    "macos": {"/usr/lib/libSystem.B.dylib"},
}
C_LIBRARY = {"malloc", "realloc", "free", "atan2", "hypot", "pow"}
POSIX = {
    *C_LIBRARY,
    *("memcpy", "exp", "floor", "fmod", "rint", "sin"),
    *("pthread_create", "pthread_join"),
}
# Functions that they may take from there. Those of no use to the kernel are MinGW's, which
# begins and ends a library with them, and dyld's.
IMPORTS = {
    "linux": POSIX | {"memset", "sincos"},
    "windows": C_LIBRARY
    | {"rint", "CreateThread", "WaitForSingleObject", "CloseHandle"}
    | {"_initterm", "_initterm_e", "_exit", "abort", "_fpreset", "GetLastError", "Sleep"}
    | {"_initialize_onexit_table", "_register_onexit_function", "_execute_onexit_table"}
    | {"InitializeCriticalSection", "EnterCriticalSection", "LeaveCriticalSection"}
    | {"DeleteCriticalSection", "TlsGetValue", "VirtualProtect", "VirtualQuery"}
    | {"__acrt_iob_func", "__stdio_common_vfprintf", "fwrite"},
    "macos": POSIX | {"bzero", "__bzero", "memset_pattern16", "__sincos_stret", "dyld_stub_binder"},
}

# Bytes of a library that make a part of its record another one, and those in their place.
CHANGES = {
    "exports": {platform: (b"halve", b"halfe") for platform in TARGETS},
    "imports": {platform: (b"hypot\0", b"hypos\0") for platform in TARGETS},
    "needs": {
        **dict.fromkeys(("linux_x64", "linux_arm64"), (b"libm.so.6", b"libz.so.1")),
        **dict.fromkeys(("windows_x64", "windows_arm64"), (b"KERNEL32", b"KERNEL42")),
        **dict.fromkeys(("macos_x64", "macos_arm64"), (b"libSystem.B", b"libSystem.C")),
    },
    "versions": {
        "linux_x64": (b"GLIBC_2.14", b"GLIBC_2.34"),
        "linux_arm64": (b"GLIBC_2.17", b"GLIBC_2.18"),
        # 6.0 of the system, the image's own 0.0, 6.0 of the subsystem
        **dict.fromkeys(
            ("windows_x64", "windows_arm64"),
            (bytes.fromhex("06000000 00000000 0600"), bytes.fromhex("06000000 00000000 0a00")),
        ),
        # macOS, and 11.0 of it
        **dict.fromkeys(
            ("macos_x64", "macos_arm64"),
            (bytes.fromhex("01000000 00000b00"), bytes.fromhex("01000000 00000c00")),
        ),
    },
}

Records = dict[str, dict]


@pytest.fixture(scope="module")
def records(kernels, tmp_path_factory) -> Records:
    """The records of the libraries, by platform."""
    return read(kernels, tmp_path_factory.mktemp("read"))


@pytest.fixture(scope="module")
def changed(kernels, tmp_path_factory) -> Records:
    """The records of libraries with a change, by part and platform."""
    libraries = {}
    for part, changes in CHANGES.items():
        for platform, (before, after) in changes.items():
            assert before in kernels[platform]
            libraries[f"{part} {platform}"] = kernels[platform].replace(before, after)
    return read(libraries, tmp_path_factory.mktemp("read"))


def read(libraries: dict[str, bytes], folder: Path) -> Records:
    """The records of libraries by scripts/read_library.py, with sets in the place of lists."""
    interpreter = set_up(FORMATS, Path(sys.executable))
    paths = [folder / name for name in libraries]
    for path in paths:
        path.write_bytes(libraries[path.name])
    command = [interpreter, ROOT / "scripts" / "read_library.py", *paths]
    answer = subprocess.run(command, env=clean_environment(), capture_output=True, text=True)
    assert answer.returncode == 0, answer.stderr

    told = [
        {key: value if key == "kind" else set(value) for key, value in record.items()}
        for record in json.loads(answer.stdout)
    ]
    return dict(zip(libraries, told, strict=True))


def declared() -> set[str]:
    """Functions that the kernel's sources declare for others."""
    files = build_kernel.SOURCES.glob("*.c")
    return {name for path in files for name in FUNCTION.findall(path.read_text(encoding="utf-8"))}


def newest_system(platform: str) -> tuple[str, tuple[int, ...]]:
    """The version that all systems have on which the wheel may be installed, by its tag."""
    if platform.startswith("windows"):
        return "Windows", (6, 3)  # the number of 8.1, the oldest that Blender 4.2 runs on
    names = {"manylinux": "GLIBC", "macosx": "MACOS"}
    name, major, minor = re.match(r"([a-z]+)_(\d+)_(\d+)_", TARGETS[platform].tag).groups()
    return names[name], (int(major), int(minor))


def faults(record: dict, platform: str) -> dict[str, object]:
    """The parts of a library's record that are not as its platform asks for, and by what."""
    system, machine = platform.split("_")
    named, newest = newest_system(platform)
    kind = [FORMAT_OF[system], machine, 64, True]
    versions = {
        (name, number) for name, _, number in (v.partition("_") for v in record["versions"])
    }
    exports = declared() | EXPORTS_OF_LINKER.get(system, set())
    found = {
        "kind": [] if record["kind"] == kind else record["kind"],
        "exports": record["exports"] ^ exports,
        "needs": record["needs"] ^ NEEDS[system],
        "imports": record["imports"] - IMPORTS[system],
        "versions": {
            (name, number)
            for name, number in versions
            if name != named or tuple(map(int, number.split("."))) > newest
        },
    }
    return {part: fault for part, fault in found.items() if fault}


@pytest.mark.parametrize("platform", TARGETS)
def test_a_library_is_what_its_platform_loads(records, platform):
    """A library is of its platform's format and machine, exports the functions that the sources
    declare and no others, and needs nothing that not each system of its wheel's tag has.
    """
    assert faults(records[platform], platform) == {}
    assert records[platform]["versions"]


def test_the_lists_name_nothing_that_no_library_takes(records):
    """Each function that the libraries of a system may import is imported by one of them."""
    for system, allowed in IMPORTS.items():
        of_system = [records[name]["imports"] for name in TARGETS if name.startswith(system)]
        assert set.union(*of_system) == allowed


@pytest.mark.parametrize("platform", TARGETS)
def test_a_library_of_another_platform_is_told(records, platform):
    """The library of each other platform has the wrong kind, whatever else it has."""
    for other in set(TARGETS) - {platform}:
        assert "kind" in faults(records[other], platform)


@pytest.mark.parametrize("platform", TARGETS)
@pytest.mark.parametrize("part", CHANGES)
def test_a_part_that_is_changed_is_told(changed, platform, part):
    """A function under another name, one that nobody has, another library or a newer system is
    found as such, and nothing else.
    """
    assert list(faults(changed[f"{part} {platform}"], platform)) == [part]
