"""Reads compiled libraries of any platform, without running them, as JSON: a record for each path.

`tests/package/test_libraries.py` runs it in the environment `formats`, whose LIEF reads them all. A
record has the library's `kind` (format, machine, bits, and whether programs load it), the names it
`exports` and `imports`, the libraries it `needs`, and the `versions` of its system it requires. C
names are as in C, without Mach-O's leading underscore.
"""

from __future__ import annotations

import json
import sys

import lief

MACHINES = {
    lief.ELF.ARCH.X86_64: "x64",
    lief.ELF.ARCH.AARCH64: "arm64",
    lief.PE.Header.MACHINE_TYPES.AMD64: "x64",
    lief.PE.Header.MACHINE_TYPES.ARM64: "arm64",
    lief.MachO.Header.CPU_TYPE.X86_64: "x64",
    lief.MachO.Header.CPU_TYPE.ARM64: "arm64",
}


def read_elf(library: lief.ELF.Binary) -> dict[str, object]:
    """The record of a library for Linux."""
    header = library.header
    is_wide = header.identity_class == lief.ELF.Header.CLASS.ELF64
    is_library = header.file_type == lief.ELF.Header.FILE_TYPE.DYN and not library.has_interpreter
    return {
        "kind": ["ELF", MACHINES.get(header.machine_type), 64 if is_wide else 32, is_library],
        "exports": [symbol.name for symbol in library.exported_symbols],
        "imports": [symbol.name for symbol in library.imported_symbols],
        "needs": list(library.libraries),
        "versions": [
            version.name
            for needed in library.symbols_version_requirement
            for version in needed.get_auxiliary_symbols()
        ],
    }


def read_pe(library: lief.PE.Binary) -> dict[str, object]:
    """The record of a library for Windows.

    A function imported by number has the number as its name.
    """
    header = library.optional_header
    imported = [*library.imports, *library.delay_imports]
    is_wide = header.magic == lief.PE.PE_TYPE.PE32_PLUS
    is_library = library.header.has_characteristic(lief.PE.Header.CHARACTERISTICS.DLL)
    system = header.major_operating_system_version, header.minor_operating_system_version
    subsystem = header.major_subsystem_version, header.minor_subsystem_version
    return {
        "kind": ["PE", MACHINES.get(library.header.machine), 64 if is_wide else 32, is_library],
        "exports": [entry.name for entry in library.get_export().entries],
        "imports": [
            f"number {entry.ordinal}" if entry.is_ordinal else entry.name
            for needed in imported
            for entry in needed.entries
        ],
        "needs": [needed.name for needed in imported],
        "versions": [f"Windows_{major}.{minor}" for major, minor in (system, subsystem)],
    }


def read_macho(library: lief.MachO.Binary) -> dict[str, object]:
    """The record of a library for macOS; arm64 requires a signature to load it.

    Exports are from the table used by the system.
    """
    header = library.header
    machine = MACHINES.get(header.cpu_type)
    is_wide = header.magic == lief.MachO.MACHO_TYPES.MAGIC_64
    is_library = header.file_type == lief.MachO.Header.FILE_TYPE.DYLIB
    is_loaded = is_library and (library.has_code_signature or machine == "x64")
    own_name = lief.MachO.LoadCommand.TYPE.ID_DYLIB
    build = library.build_version
    return {
        "kind": ["Mach-O", machine, 64 if is_wide else 32, is_loaded],
        "exports": [export.symbol.name[1:] for export in library.dyld_info.exports],
        "imports": [symbol.name.removeprefix("_") for symbol in library.imported_symbols],
        "needs": [other.name for other in library.libraries if other.command != own_name],
        "versions": [f"{build.platform.name}_{'.'.join(map(str, build.minos[:2]))}"],
    }


def read(path: str) -> dict[str, object]:
    """The record of a library, by its format."""
    library = lief.parse(path)
    if isinstance(library, lief.ELF.Binary):
        return read_elf(library)
    if isinstance(library, lief.PE.Binary):
        return read_pe(library)
    if isinstance(library, lief.MachO.Binary):
        return read_macho(library)
    sys.exit(f"{path} is a library of no format that is known here.")


if __name__ == "__main__":
    print(json.dumps([read(path) for path in sys.argv[1:]]))
