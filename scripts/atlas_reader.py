"""A reader of Kiriko's atlases for head tracking. Copy it; it needs only numpy.

    atlas = Atlas("FOLDER")
    st, coverage = atlas.at(right, up, forward)  # m, from the viewer's own position

st (h, w, 2) is the position in the picture shown by each display pixel, 0..1 from its left and
lower edge, row 0 at the top; NaN for nothing. `python3 atlas_reader.py FOLDER 0.01 0 0` prints how
much of the display is lit.
"""

import json
import sys
from functools import lru_cache
from pathlib import Path

import numpy as np


class Atlas:
    """The maps in a folder; the last ones read are cached."""

    def __init__(self, folder, kept=16):
        self.folder = Path(folder)
        self.index = json.loads((self.folder / "index.json").read_text(encoding="utf-8"))
        self.axes = [np.array(self.index["axes"][name]) for name in ("right", "up", "forward")]
        self.read = lru_cache(kept)(self._read)

    def _read(self, number):
        with np.load(self.folder / self.index["maps"][number]) as arrays:
            return arrays["st"], arrays["coverage"], arrays["path"]

    def corners(self, head):
        """The maps around a head and their weights, the nearest first; a head beyond the grid
        counts as at its edge.
        """
        numbers, weights = np.zeros(1, int), np.ones(1)
        if not np.isfinite(head).all():
            raise ValueError(f"the head is at {head}: wait until it is tracked again")
        for nodes, x in zip(self.axes, head, strict=True):
            x = np.clip(x, nodes[0], nodes[-1])
            low = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, max(len(nodes) - 2, 0))
            high = min(low + 1, len(nodes) - 1)
            t = (x - nodes[low]) / (nodes[high] - nodes[low]) if high > low else 0.0
            numbers = np.add.outer(numbers * len(nodes), [low, high]).ravel()
            weights = np.multiply.outer(weights, [1 - t, t]).ravel()
        order = [k for k in np.argsort(-weights, kind="stable") if weights[k] > 0]
        return [(self.read(int(numbers[k])), np.float32(weights[k])) for k in order]

    def at(self, right=0.0, up=0.0, forward=0.0):
        """The map of a head: st (h, w, 2) and coverage (h, w)."""
        corners = self.corners((right, up, forward))
        (st, coverage, path), _ = corners[0]
        path, decided = path.copy(), coverage > 0
        for (_, covers, other), _ in corners[1:]:  # the nearest with coverage
            path[~decided & (covers > 0)] = other[~decided & (covers > 0)]
            decided |= covers > 0

        total, blended, coverage = np.zeros(path.shape), np.zeros(st.shape), np.zeros(path.shape)
        for (places, covers, other), weight in corners:
            counts = weight * ((covers > 0) & (other == path))
            total += counts
            blended += counts[..., None] * np.nan_to_num(places)
            coverage += weight * covers
        with np.errstate(invalid="ignore"):
            return blended / total[..., None], coverage


if __name__ == "__main__":
    places, covered = Atlas(sys.argv[1]).at(*map(float, sys.argv[2:]))
    print(f"{(covered > 0).mean():.1%} of the display is lit")
