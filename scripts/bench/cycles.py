"""Where the light of each viewer pixel lands, beside Cycles, through glass as artists bring it.

`python3 scripts/dev.py cycles [--glass NAME ...] [--surface CHOICE ...] [--pixels N]`. Add Rig sets
each glass up, and Cycles traces the middle of each viewer pixel; in single precision, and without
total reflection. Differences in display px, of 512. `apart` is the share of rays that arrive in
Cycles and land more than a pixel elsewhere or nowhere in Kiriko: pixels on a border between two
ways. `compared` is the share of Kiriko's light that arrives in Cycles, too. Where faces are curved,
Cycles sees them cut into as many triangles as memory allows.
"""

from __future__ import annotations

import argparse

import bpy
from mathutils import Matrix

from fuzz.run import judge
from kiriko.core.blender.scene import read
from known.registered import registered

from .brought_glass import GLASSES, INDICES, SIZE, add_glass_option, fitting
from .irregular import CHOICES


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add_glass_option(parser)
    parser.add_argument(
        "--surface",
        nargs="+",
        choices=CHOICES,
        default=["facets", "automatic"],
        help="only these choices",
    )
    parser.add_argument(
        "--pixels", type=int, default=256, metavar="N", help="of the viewer, across"
    )
    arguments = parser.parse_args()
    registered()

    rows = [
        f"{'glass':<16}{'surface':>10}{'median px':>11}{'95 % px':>9}"
        f"{'apart %':>9}{'compared %':>12}"
    ]
    for name in arguments.glass:
        for choice in arguments.surface:
            scene = set_up(name, choice, arguments.pixels)
            found = judge(scene, read(bpy.context.evaluated_depsgraph_get(), scene))
            apart = 100 * found["apart"]
            both = 100 * found["both"]
            told = f"{found['median']:11.4f}{found['most']:9.4f}{apart:9.2f}{both:12.1f}"
            rows.append(f"{name:<16}{choice:>10}{told}")

    print("", *rows, sep="\n")  # apart from the lines that Blender prints


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


if __name__ == "__main__":
    main()
