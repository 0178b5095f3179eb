"""Is a movie's file whole? Its container's own lengths tell, without a frame being decoded."""

from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

EBML = bytes.fromhex("1a45dfa3")  # Matroska and WebM
SEGMENT = bytes.fromhex("18538067")
BOXES = {b"ftyp", b"moov", b"mdat", b"free", b"skip", b"wide"}  # that MP4 and QuickTime begin with


def missing(path: Path) -> float:
    """The share of a movie's file that is missing at its end, by the lengths of its parts; 0 for a
    whole file, for one that tells no lengths and for one that cannot be read.

    Sources: AVI RIFF file reference (size of a RIFF list, little endian, without its head of 8
    bytes); RFC 8794, 4 and 5 (EBML: all bits of the length set mean unknown); ISO/IEC 14496-12, 4.2
    (size of a box with its head; 1: 64 bits follow its name; 0: to the end of the file).
    """
    try:
        there = path.stat().st_size
        with path.open("rb") as file:
            wanted = max(_ends(file, there), default=0)
    except OSError:
        return 0.0
    return max(0.0, 1 - there / wanted) if wanted else 0.0


def _ends(file: BinaryIO, there: int) -> Iterator[int]:
    """Where the parts of a file end, as far as they are there and told."""
    head = file.read(12)
    if head[:4] == b"RIFF":
        yield from _riff_ends(file, there)
    elif head[:4] == EBML:
        yield from _ebml_ends(file, there)
    elif head[4:8] in BOXES:
        yield from _box_ends(file, there)


def _riff_ends(file: BinaryIO, there: int) -> Iterator[int]:
    end = 0
    while end + 8 <= there:
        file.seek(end)
        name, size = file.read(4), int.from_bytes(file.read(4), "little")
        if name != b"RIFF" or size in (0, 2**32 - 1):  # of a stream that was never closed
            return
        end += 8 + size + size % 2
        yield end - size % 2


def _ebml_ends(file: BinaryIO, there: int) -> Iterator[int]:
    end = 0
    while end + 12 <= there:
        file.seek(end)
        name, first = file.read(4), file.read(1)[0]
        if name not in (EBML, SEGMENT) or not first:
            return
        n = 9 - first.bit_length()  # bytes of the length, by its leading zeros
        bits = 7 * n
        size = int.from_bytes(bytes([first]) + file.read(n - 1), "big") & (2**bits - 1)
        if size == 2**bits - 1:
            return
        end += 4 + n + size
        yield end


def _box_ends(file: BinaryIO, there: int) -> Iterator[int]:
    end = 0
    while end + 8 <= there:
        file.seek(end)
        size = int.from_bytes(file.read(4), "big")
        if not file.read(4).isalnum():
            return  # no box, but bytes behind the last one
        if size == 1:
            size = int.from_bytes(file.read(8), "big")
        if size < 8:
            return
        end += size
        yield end
