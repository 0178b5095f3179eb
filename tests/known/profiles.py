"""ICC profiles of displays, written here: a matrix and a curve; and the code points of a PNG."""

import struct
import zlib
from itertools import pairwise

import numpy as np

# columns of the profiles of sRGB, Display P3 and Adobe RGB (1998), as they are published
COLUMNS = {
    "sRGB": ((0.43607, 0.22249, 0.01392), (0.38515, 0.71687, 0.09708), (0.14307, 0.06061, 0.7141)),
    "P3": ((0.51512, 0.2412, -0.00105), (0.29198, 0.69225, 0.04189), (0.1571, 0.06657, 0.78407)),
    "Adobe": (
        (0.60974, 0.31111, 0.01947),
        (0.20528, 0.62567, 0.06087),
        (0.14919, 0.06322, 0.74457),
    ),
}


def fixed(*values: float) -> bytes:
    return b"".join(struct.pack(">i", round(65536 * value)) for value in values)


def profile(columns: tuple, curve: bytes) -> bytes:
    """An ICC profile of a display."""
    tags = {b"%cTRC" % c: curve for c in b"rgb"}
    tags |= {
        b"%cXYZ" % c: b"XYZ \0\0\0\0" + fixed(*xyz) for c, xyz in zip(b"rgb", columns, strict=True)
    }
    padded = [data + b"\0" * (-len(data) % 4) for data in tags.values()]
    starts = np.cumsum([132 + 12 * len(tags), *map(len, padded)]).tolist()
    table = b"".join(
        name + struct.pack(">II", start, end - start)
        for name, (start, end) in zip(tags, pairwise(starts), strict=True)
    )
    head = struct.pack(">I4sI12s", starts[-1], b"none", 0x04000000, b"mntrRGB XYZ ")
    head += bytes(12) + b"acsp" + bytes(28) + fixed(0.9642, 1, 0.8249) + bytes(48)
    return head + struct.pack(">I", len(tags)) + table + b"".join(padded)


def with_code_points(png: bytes, primaries: int) -> bytes:
    """A PNG that says that it has these primaries (ITU-T H.273) and the curve of sRGB."""
    body = b"cICP" + bytes([primaries, 13, 0, 1])
    chunk = struct.pack(">I", 4) + body + struct.pack(">I", zlib.crc32(body))
    return png[:33] + chunk + png[33:]
