"""Makes the examples in assets/: glass, and the rig built around it by Add Rig; all systems.

Runs in the oldest supported Blender, whose files all later ones open:
`PYTHONPATH=.dev/link:scripts:tests .dev/bpy-4.2.23/bin/python scripts/make_examples.py`
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from pathlib import Path

import bpy  # first: it adds Blender's other modules

import bmesh  # isort: skip
from mathutils import Matrix

from bench.brought_glass import BOTTLE, wine_glass
from fuzz.shapes import add, linked, mesh_of, turned
from kiriko.core.bench.systems import SYSTEMS
from kiriko.core.blender.materials import shaders
from known.registered import registered

FOLDER = Path(__file__).resolve().parent.parent / "assets"
INDEX = 1.52  # soda-lime glass


def ball() -> None:
    """None: Add Rig makes the ball."""


def goblet() -> bpy.types.Object:
    """A wine glass of a profile, by Screw, Solidify and Subdivision."""
    return wine_glass()


def cut_cube() -> bpy.types.Object:
    """A cube with flat facets cut along its edges, turned a little."""
    data = mesh_of("cube", size=0.05)
    shape = bmesh.new()
    shape.from_mesh(data)
    bmesh.ops.bevel(shape, geom=shape.edges, offset=0.004, segments=1, affect="EDGES")
    shape.to_mesh(data)
    shape.free()
    thing = linked(data, "Cut Cube")
    thing.rotation_euler.z = math.radians(15.8)
    return thing


def bottle() -> bpy.types.Object:
    """A hollow bottle, 15 cm high, by Screw and Subdivision."""
    thing = turned(BOTTLE, 32)
    thing.data.transform(Matrix.Scale(0.15, 4))
    add(thing, "SUBSURF", levels=2)
    return thing


EXAMPLES: dict[str, Callable[[], bpy.types.Object | None]] = {
    "Ball": ball,
    "Goblet": goblet,
    "Cut Cube": cut_cube,
    "Bottle": bottle,
}


def make(name: str) -> None:
    """Make the file of an example with glass."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    thing = EXAMPLES[name]()
    bpy.ops.object.select_all(action="DESELECT")

    if thing is not None:
        thing.name = thing.data.name = name
        material = bpy.data.materials.new("Glass")
        shaders.be_glass(material, INDEX, True)
        thing.data.materials.append(material)
        thing.select_set(True)
        bpy.context.view_layer.objects.active = thing

    bpy.ops.kiriko.add_rig()
    save(name)


def make_system(kind: str) -> None:
    """Make the file of a system."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.kiriko.add_rig(kind=kind)
    save(kind)


def save(name: str) -> None:
    """Write the open file into assets/."""
    bpy.ops.outliner.orphans_purge(do_recursive=True)
    path = FOLDER / f"example_{name.lower().replace(' ', '_')}.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=True, copy=True)
    path.with_suffix(".blend1").unlink(missing_ok=True)


def main() -> None:
    registered()
    for name in EXAMPLES:
        make(name)
        sys.stdout.write(f"{name}\n")
    for kind in SYSTEMS:
        make_system(kind)


if __name__ == "__main__":
    main()
