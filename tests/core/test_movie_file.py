"""Is a movie's file whole? By containers that are built here, as their specifications have them."""

from pathlib import Path

import pytest

from kiriko.core.movie_file import missing

EBML, SEGMENT = bytes.fromhex("1a45dfa3"), bytes.fromhex("18538067")


def box(name: bytes, n: int, is_long: bool = False) -> bytes:
    """An MP4 box with n bytes in it, its length in 32 or in 64 bits."""
    if is_long:
        return b"\0\0\0\1" + name + (n + 16).to_bytes(8, "big") + bytes(n)
    return (n + 8).to_bytes(4, "big") + name + bytes(n)


def riff(n: int) -> bytes:
    return b"RIFF" + n.to_bytes(4, "little") + b"AVI " + bytes(n - 4)


def ebml(name: bytes, n: int, length: int) -> bytes:
    """An element with n bytes in it, whose length takes so many bytes."""
    return name + ((1 << 7 * length) | n).to_bytes(length, "big") + bytes(n)


WHOLE = {
    "avi": riff(5000),
    "avi, two lists": riff(5001) + b"\0" + riff(700),
    "mkv": ebml(EBML, 35, 1) + ebml(SEGMENT, 5000, 8),
    "mkv, short lengths": ebml(EBML, 35, 1) + ebml(SEGMENT, 5000, 2),
    "mp4, index last": box(b"ftyp", 24) + box(b"mdat", 5000) + box(b"moov", 900),
    "mp4, index first": box(b"ftyp", 24) + box(b"moov", 900) + box(b"mdat", 5000, is_long=True),
}
UNTOLD = {
    "avi, never closed": b"RIFF\0\0\0\0AVI " + bytes(500),
    "mkv, a stream": ebml(EBML, 35, 1) + SEGMENT + b"\x01" + b"\xff" * 7 + bytes(500),
    "mp4, to the end": box(b"ftyp", 24) + b"\0\0\0\0mdat" + bytes(500),
    "no movie": b"GIF89a" + bytes(500),
    "empty": b"",
}


@pytest.mark.parametrize("name", WHOLE)
def test_the_missing_share_is_that_which_was_cut(name: str, tmp_path: Path) -> None:
    """Nothing of a whole file; of one that ends in its last part the very share of its bytes. Bytes
    behind the end are none that are missing.
    """
    data, path = WHOLE[name], tmp_path / "movie"
    for n in (len(data), len(data) - 1, len(data) - 600):
        path.write_bytes(data[:n])
        assert missing(path) == pytest.approx(1 - n / len(data), abs=1e-15)
    for behind in (bytes(100), b"\xff" * 16):
        path.write_bytes(data + behind)
        assert missing(path) == 0


@pytest.mark.parametrize("name", UNTOLD)
def test_a_file_that_tells_no_length_lacks_nothing(name: str, tmp_path: Path) -> None:
    path = tmp_path / "movie"
    assert missing(path) == 0  # it is not there
    for n in range(0, len(UNTOLD[name]) + 1, 7):
        path.write_bytes(UNTOLD[name][:n])
        is_cut_early = n < 44 and name.startswith(("mkv", "mp4"))
        assert missing(path) == 0 or is_cut_early
