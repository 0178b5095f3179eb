"""Does an atlas of warp maps hold between its places? A part of `dev.py farm`.

A head moves in a box before glass. Kiriko plans a grid of its places, halved until blended maps
keep the tolerance, and writes their maps. Then heads at random places of the box are compared: the
map that the reader for others (scripts/atlas_reader.py) blends, and the one that is traced there.
*off* is in picture px, over the display pixels whose path all maps share: at the median head the
median, and the largest of what 95 % of the pixels keep; *at borders* are the other pixels, of
those that are lit. *every pixel* is the 95 % of all pixels that both maps show, at borders too.
"""

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np

from atlas_reader import Atlas as Reader
from bench.solve import brought
from kiriko.core.base.steps import finish
from kiriko.core.lab.atlas import atlas as atlas_plan
from kiriko.core.lab.atlas import atlas as making
from kiriko.core.lab.atlas import head_map
from kiriko.core.lab.atlas.atlas import Atlas, random_heads
from kiriko.core.lab.atlas.heads import HeadBox
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session

PIXELS = 256  # a side, of display and viewer
HEADS = 100
MOST = 1000
BOX = HeadBox((-0.03, -0.02, -0.05), (0.03, 0.02, 0.05))  # m, a head in its seat
TOLERANCE = 1.0  # px of the picture


@dataclass(frozen=True)
class Row:
    """An atlas and its heads."""

    glass: str
    atlas: Atlas
    seconds: float
    offs: list[head_map.Off]
    of_all: list[float]
    n_bytes: int

    @property
    def is_kept(self) -> bool:
        return max(off.most for off in self.offs) <= self.atlas.tolerance

    def text(self) -> str:
        halved = " x ".join(str(len(nodes)) for nodes in self.atlas.grid.nodes)
        median = np.median([off.median for off in self.offs])
        most = max(off.most for off in self.offs)
        at_borders = np.mean([off.at_borders for off in self.offs])
        return (
            f"| {self.glass} | {halved} | {self.seconds:.0f} s | {self.n_bytes / 1e6:.1f} MB"
            f" | {median:.4f} | {most:.3f} | {at_borders:.1%} | {np.median(self.of_all):.3f}"
            f" | {'kept' if self.is_kept else 'MISSED'} |"
        )


HEADING = (
    "| glass | places | made in | size | off, px: median | 95 %, worst head | at borders"
    " | every pixel, 95 % | tolerance |\n|---|---|---|---|---|---|---|---|---|"
)


def row(glass: str, pixels: int, n_heads: int, tolerance: float) -> Row:
    """Make an atlas of a glass, and try heads in it."""
    with tempfile.TemporaryDirectory() as name:
        rig = brought(glass, pixels=pixels, display_pixels=pixels)
        of = making.Making(Session(), rig, rig.viewer, Settings(), Path(name))
        started = perf_counter()
        atlas = finish(atlas_plan.planned(of, BOX, tolerance, MOST, False, ""))
        atlas = finish(making.whole(of, atlas, MOST))
        seconds = perf_counter() - started
        n_bytes = sum(path.stat().st_size for path in of.folder.iterdir())

        offs, of_all = zip(*_tried(of, atlas, n_heads), strict=True)
        return Row(glass, atlas, seconds, list(offs), list(of_all), n_bytes)


def _tried(of: making.Making, atlas: Atlas, n: int) -> Iterator[tuple[head_map.Off, float]]:
    """Each head: how far off it is where paths are shared, and the 95 % of all pixels."""
    reader = Reader(of.folder, kept=len(atlas.grid))
    size = np.array(atlas.picture_size)
    for offset in random_heads(atlas.grid, n, seed=1):
        true = finish(of.at(offset))
        st, coverage = reader.at(*offset)
        numbers, weights = atlas.grid.around(offset)
        maps = [head_map.read(of.folder / atlas.maps[k]) for k in numbers]
        is_whole = head_map.between(maps, weights).is_whole
        found = head_map.HeadMap(st, coverage, true.path)

        both = (coverage > 0) & (true.coverage > 0)
        apart = np.hypot(*((st - true.st)[both] * size).T)
        blended = head_map.Blended(found, is_whole)
        yield head_map.off(blended, true, atlas.picture_size), float(np.quantile(apart, 0.95))
