"""A small rig that solves in a fraction of a second: a cube, 64 pixels."""

from dataclasses import replace
from types import ModuleType

import bmesh
import bpy
import numpy as np
import pytest
from mathutils import Matrix

from extension import loaded

SIDE = 0.05


def cube(side: float = SIDE, turn: float = 0.0) -> bpy.types.Object:
    """A selected cube of glass (no role yet), turned about z by `turn` rad."""
    thing = bpy.data.objects.new("Cube", primitive("cube", size=side))
    thing.matrix_world = Matrix.Rotation(turn, 4, "Z")
    bpy.context.scene.collection.objects.link(thing)
    thing.select_set(True)
    return thing


def primitive(make: str, **sizes: object) -> bpy.types.Mesh:
    """A mesh of a bmesh primitive."""
    mesh = bpy.data.meshes.new("mesh")
    shape = bmesh.new()
    # bmesh.ops keeps the address of the name only: it has to live until the call is over
    name = f"create_{make}"
    getattr(bmesh.ops, name)(shape, **sizes)
    shape.to_mesh(mesh)
    shape.free()
    return mesh


def new_object(data: bpy.types.ID | None, role: str = "NONE") -> bpy.types.Object:
    """A new object in the scene, with a role."""
    thing = bpy.data.objects.new("thing", data)
    bpy.context.scene.collection.objects.link(thing)
    thing.kiriko.role = role
    return thing


def show_scene(scene: bpy.types.Scene) -> None:
    """Have the window show a scene.

    Not by `context.window`: in Blender 4.2 the context, once asked for its `tool_settings`, takes
    the scene of that moment for the owner of its window. Setting the window's scene then tags that
    one, freed or not, and so wrote into arrays of a kept view map.
    """
    bpy.context.window_manager.windows[0].scene = scene


def small_rig(ior: float = 1.49, **options: object) -> dict[str, bpy.types.Object]:
    """A rig around a cube; the objects by role."""
    glass = cube()
    glass.kiriko.use_ior, glass.kiriko.ior = True, ior
    small = {
        "viewer_resolution": 64,
        "display_resolution": (64, 64),
        "field": 0.04,
        "picture_size": 0.03,
    }
    bpy.ops.kiriko.add_rig(**{**small, **options})
    return {thing.kiriko.role: thing for thing in bpy.context.scene.objects}


def short_walks(kiriko: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    """An eye box and its curves are found by few looks at nine points of the picture."""
    names = ("core.lab.measure.head_range", "core.lab.measure.head_range")
    box, curves = (loaded(name) for name in names)
    for module, name, few in (
        (box, "N_POINTS", 3),
        (box, "N_BETWEEN", 2),
        (box, "SETTLED", 0.1),
        (curves, "N_STEPS", 2),
    ):
        monkeypatch.setattr(module, name, few)


def short_reports(kiriko: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two runs on a short ladder, and few looks by heads that move."""
    module = loaded("operators.report")
    whole = module.measure

    def short(*args: object, ladders: object, **options: object) -> object:
        short = replace(ladders, tolerances=(1.0, 0.1), runs=2)
        return whole(*args, ladders=short, **options)

    monkeypatch.setattr(module, "measure", short)
    short_walks(kiriko, monkeypatch)


def record_text(fields: dict[str, object]) -> str:
    """Text of a record as Kiriko writes it; `fields` may be parsed from such a text."""
    kept = loaded("core.blender.data.stored_records")
    own = ("version", "checksum")
    return kept.text_of({name: value for name, value in fields.items() if name not in own})


def pixels(image: bpy.types.Image) -> np.ndarray:
    """Pixels (h, w, 4), row 0 at the top."""
    flat = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(flat)
    return flat.reshape(image.size[1], image.size[0], 4)[::-1]


def linear_lattice() -> np.ndarray:
    """The default picture (1024, 1024, 3), linear, row 0 at the top."""
    encoded = pixels(bpy.data.images["Kiriko Lattice"])[..., :3]
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def inventory() -> dict[str, list[str]]:
    """Names of all that a file holds, without Blender's own render result."""
    groups = (
        "scenes",
        "collections",
        "objects",
        "meshes",
        "cameras",
        "materials",
        "images",
        "node_groups",
        "worlds",
    )

    return {
        group: sorted(b.name for b in getattr(bpy.data, group) if b.name != "Render Result")
        for group in groups
    }
