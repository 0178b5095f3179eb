"""The glasses of the gallery, standing on a table at z = 0. Lengths in m."""

from __future__ import annotations

import math

import bmesh
import bpy
import numpy as np
from mathutils import Matrix

from fuzz.shapes import add, behind, linked, mesh_of, smooth, turned
from kiriko.core.blender.materials.shaders import be_glass

# half of the profiles in mm, (radius, height) from the middle of the foot on
GOBLET = (
    (0, 0), (26, 0), (31, 2.5), (27, 5), (12, 7.5), (5.5, 11), (4.5, 17), (4.5, 24), (8, 30),
    (21, 36), (34, 48), (41, 66), (42, 86), (38, 108),
)  # fmt: skip
BOTTLE = (
    (0, 0), (34, 0), (36.5, 3), (36.5, 8), (36.5, 120), (36, 130), (30, 148), (14, 166),
    (12.5, 178), (12.5, 214), (15.5, 216), (15.5, 224), (13.5, 226), (9.5, 224), (9.5, 178),
    (11.5, 168), (27, 146), (33, 129), (33.5, 120), (33.5, 8), (32, 4), (0, 3.5),
)  # fmt: skip
GIRDLE, DEPTH = 0.036, 0.030


def in_metres(profile: tuple[tuple[float, float], ...]) -> list[tuple[float, float]]:
    """A profile in m."""
    return [(radius / 1000, height / 1000) for radius, height in profile]


def of_glass(thing: bpy.types.Object, name: str, ior: float) -> bpy.types.Object:
    """The object with a material of glass."""
    thing.name = thing.data.name = name
    material = bpy.data.materials.new("Glass")
    be_glass(material, ior, True)
    thing.data.materials.append(material)
    return thing


def goblet() -> bpy.types.Object:
    """A goblet with a wide bowl, 108 mm high, its wall 1.6 mm thick."""
    thing = turned(in_metres(GOBLET), 48)
    add(thing, "SOLIDIFY", thickness=0.0016, offset=1.0)
    return of_glass(add(thing, "SUBSURF", levels=2, render_levels=2), "Goblet", 1.52)


def bottle() -> bpy.types.Object:
    """A bottle on its side, its neck to the right."""
    thing = add(turned(in_metres(BOTTLE), 64), "SUBSURF", levels=2, render_levels=2)
    thing.matrix_world = Matrix.Translation((-0.105, 0.0, 0.0367)) @ Matrix.Rotation(
        math.pi / 2, 4, "Y"
    )
    return of_glass(thing, "Bottle", 1.52)


def crystal() -> bpy.types.Object:
    """A crystal block with eight sides, cut around a flat front and a flat back."""
    turn = 2 * np.pi * np.arange(8) / 8
    facets = [(0.0, 0.0, 0.5 * DEPTH), (0.0, np.pi, 0.5 * DEPTH)]
    for around in turn:
        facets += [(around, np.pi / 2, GIRDLE)]
        facets += [(around, np.radians(42), 0.0265), (around, np.pi - np.radians(42), 0.0265)]
    around, lean, distance = np.array(facets).T
    normals = [np.sin(lean) * np.cos(around), -np.cos(lean), np.sin(lean) * np.sin(around)]
    thing = linked(behind(np.stack(normals, axis=1), distance), "Crystal")
    thing.data.transform(Matrix.Translation((0.0, 0.0, GIRDLE)))
    return of_glass(thing, "Crystal", 1.52)


def cube() -> bpy.types.Object:
    """An acrylic cube of 50 mm with narrow cut edges, turned."""
    mesh = mesh_of("cube", size=0.05)
    shape = bmesh.new()
    shape.from_mesh(mesh)
    bmesh.ops.bevel(shape, geom=shape.edges, offset=0.0012, segments=1, affect="EDGES")
    shape.to_mesh(mesh)
    shape.free()
    mesh.transform(
        Matrix.Translation((0.0, 0.0, 0.025)) @ Matrix.Rotation(math.radians(-24), 4, "Z")
    )
    return of_glass(linked(mesh, "Cube"), "Acrylic Cube", 1.49)


def lens() -> bpy.types.Object:
    """A round lens, 80 mm wide and 32 mm thick, on its rim."""
    mesh = smooth(mesh_of("icosphere", subdivisions=6, radius=1.0))
    mesh.transform(Matrix.Translation((0, 0, 0.04)) @ Matrix.Diagonal((0.04, 0.016, 0.04, 1)))
    return of_glass(linked(mesh, "Lens"), "Lens", 1.52)


def letters() -> bpy.types.Object:
    """A word in bevelled letters, 40 mm high."""
    data = bpy.data.curves.new("Text", "FONT")
    data.body = "KIRIKO"
    data.align_x = "CENTER"
    data.size, data.space_character = 0.056, 1.18
    data.extrude, data.bevel_depth, data.bevel_resolution = 0.010, 0.0022, 3
    data.offset = 0.0016
    thing = linked(data, "Letters")
    thing.rotation_euler.x = math.pi / 2
    return of_glass(thing, "Letters", 1.49)
