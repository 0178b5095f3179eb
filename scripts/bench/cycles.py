"""Landings of viewer pixels compared with Cycles, through glass from artists: `dev.py cycles`.

Add Rig sets each glass up, and Cycles traces the middle of each viewer pixel in single precision.
Differences are in display px, of 512. `apart`: fraction of the rays that arrive in Cycles and land
more than a pixel elsewhere or nowhere in Kiriko, at pixels on a border between two paths.
`compared`: fraction of Kiriko's light that arrives in Cycles, too. `gaps` and `normals`: fractions
of Kiriko's light that pass a gap in open glass, or are bent by normals that contradict their faces,
as the result reports; then 95 % and `apart` without both. Light past the glass does not count.
Curved faces are divided in Cycles into as many triangles as memory allows.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import bpy
import numpy as np
from mathutils import Matrix

from fuzz.run import compared, how_far
from kiriko.core.blender.read.scene import read
from known.judged_meshes import CHOICES
from known.registered import registered

from .brought_glass import GLASSES, INDICES, SIZE, fitting
from .runner import Bench, Row, option, run


def measure(name: str, make: object, arguments: argparse.Namespace) -> Iterator[Row]:
    """Compare the landings through a glass, by some choices of *Surface*."""
    registered()
    for choice in arguments.surface:
        scene = set_up(name, choice, arguments.pixels)
        found = compared(scene, read(bpy.context.evaluated_depsgraph_get(), scene))
        is_reported = found.by_gap | found.by_odd_normal
        of_all, of_rest = (
            how_far(found.is_ours & some, found.is_theirs & some, found.off) or {}
            for some in (found.is_glass, found.is_glass & ~is_reported)
        )
        is_ours = found.is_ours & found.is_glass
        yield {
            "surface": choice,
            "median px": of_all.get("median"),
            "95 % px": of_all.get("most"),
            "apart %": 100 * of_all.get("apart", np.nan),
            "compared %": 100 * of_all.get("both", np.nan),
            "gaps %": 100 * found.by_gap[is_ours].mean(),
            "normals %": 100 * found.by_odd_normal[is_ours].mean(),
            "95 % px of the rest": of_rest.get("most"),
            "apart % of the rest": 100 * of_rest.get("apart", np.nan),
        }


def set_up(name: str, choice: str, pixels: int) -> bpy.types.Scene:
    """The scene with a glass, and the rig of Add Rig around it."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    thing = GLASSES[name]()
    thing.matrix_world = Matrix.Scale(SIZE, 4) @ fitting(thing)
    thing.kiriko.use_ior = True
    thing.kiriko.ior = INDICES.get(name, 1.49)
    thing.kiriko.surface = choice.upper()
    bpy.context.view_layer.objects.active = thing
    thing.select_set(True)
    # light spreads far behind such glass
    options = {"viewer_resolution": pixels, "display_resolution": (512, 512), "display_size": 0.3}
    assert bpy.ops.kiriko.add_rig(picture_size=0.035, **options) == {"FINISHED"}
    return bpy.context.scene


COLUMNS = {
    "surface": "s", "median px": ".4f", "95 % px": ".4f", "apart %": ".2f", "compared %": ".1f",
    "gaps %": ".2f", "normals %": ".2f", "95 % px of the rest": ".4f",
    "apart % of the rest": ".2f",
}  # fmt: skip

if __name__ == "__main__":
    run(
        __doc__,
        "bench.cycles",
        Bench(GLASSES, COLUMNS, measure),
        option("--surface", nargs="+", choices=CHOICES, default=["facets", "automatic"]),
        option("--pixels", type=int, default=256, metavar="N", help="of the viewer, across"),
    )
