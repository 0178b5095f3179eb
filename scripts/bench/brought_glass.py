"""Glass as artists bring it, made by script for benches, as Blender evaluates it.

Random ones are in scripts/fuzz/shapes.py.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

from fuzz.shapes import (
    add,
    clouds,
    cut_stone,
    fitting,
    linked,
    mesh_of,
    prism,
    shaken,
    smooth,
    turned,
)
from kiriko.core.blender.read.read_mesh import in_world, read_local
from kiriko.core.rig.parts import ConstantIndex
from kiriko.core.rig.rig import Glass, Mesh

SIZE = 0.05  # m

# half of the profiles, (radius, height) from the middle of the foot on
WINE_GLASS = [
    (0.0, 0.0), (0.02, 0.0), (0.034, 0.002), (0.030, 0.004), (0.008, 0.010), (0.004, 0.03),
    (0.004, 0.07), (0.008, 0.09), (0.025, 0.105), (0.036, 0.13), (0.038, 0.15), (0.034, 0.18),
    (0.032, 0.20),
]  # fmt: skip
BOTTLE = [
    (0.0, 0.0), (0.28, 0.0), (0.3, 0.03), (0.3, 0.55), (0.27, 0.65), (0.1, 0.75), (0.1, 1.0),
    (0.07, 1.0), (0.07, 0.75), (0.24, 0.65), (0.27, 0.55), (0.27, 0.06), (0.0, 0.05),
]  # fmt: skip
# facets of a round brilliant: how many, the first one's turn in parts of a circle,
# elevation in degrees, distance from the middle where the girdle has radius 1
BRILLIANT = [
    (1, 0.0, 90.0, 0.36),  # table
    (8, 0.0, 55.5, 0.5955),  # crown mains
    (8, 0.5, 68.3, 0.4905),  # stars
    (16, 0.5, 48.0, 0.682),  # upper halves
    (8, 0.0, -49.25, 0.6475),  # pavilion mains
    (16, 0.5, -47.8, 0.6655),  # lower halves
]
GIRDLE = (32, 0.5, 0.0, 1.0)
# below a surface at 0.155, into the glass: where both are, the glass counts
WINE = [
    (0.0, 0.0895), (0.008, 0.0895), (0.0098, 0.0905), (0.017, 0.0992), (0.025, 0.1067),
    (0.0345, 0.13), (0.0362, 0.1485), (0.0358, 0.1535), (0.0358, 0.155), (0.035, 0.155),
    (0.0, 0.155),
]  # fmt: skip
VASE = [(0.012, 0.0), (0.018, 0.012), (0.013, 0.028), (0.010, 0.040), (0.014, 0.050)]


def wine_glass(levels: int = 2) -> bpy.types.Object:
    """Screw 32, Solidify 2 mm, Subdivision."""
    thing = add(turned(WINE_GLASS, 32), "SOLIDIFY", thickness=0.002)
    return add(thing, "SUBSURF", levels=levels, quality=6)


def wine() -> bpy.types.Object:
    """The wine in a wine glass: a body of its own, with walls in the middle of the glass's."""
    return add(turned(WINE, 32), "SUBSURF", levels=2, quality=6)


def vase() -> bpy.types.Object:
    """Screw 32 and Solidify, without subdivision: 40 degrees and more from face to face."""
    return add(turned(VASE, 32), "SOLIDIFY", thickness=0.002)


def fine_vase() -> bpy.types.Object:
    """The vase whose profile is the curve of fourth degree through its points."""
    profile = np.array(VASE)
    chords = np.linalg.norm(np.diff(profile, axis=0), axis=1)
    at = np.concatenate([[0], np.cumsum(chords)]) / chords.sum()
    along = np.linspace(0, 1, 65)
    curves = [np.polynomial.Polynomial.fit(at, x, len(at) - 1)(along) for x in profile.T]
    return add(turned(list(zip(*curves, strict=True)), 512), "SOLIDIFY", thickness=0.002)


def suzanne(levels: int = 1) -> bpy.types.Object:
    """The monkey's head, subdivided once."""
    bpy.ops.mesh.primitive_monkey_add()
    smooth(bpy.context.object.data)
    return add(bpy.context.object, "SUBSURF", levels=levels)


def ball(subdivisions: int = 6) -> bpy.types.Object:
    """A ball 1 m across."""
    return linked(smooth(mesh_of("icosphere", subdivisions=subdivisions, radius=0.5)), "Ball")


def displaced(subdivisions: int = 5) -> bpy.types.Object:
    """A ball with clouds on it."""
    return clouds(ball(subdivisions), 0.5, 0.1)


def scan(n_triangles: int = 5000) -> bpy.types.Object:
    """A noisy ball thinned out to so many triangles, as a scanner sees it."""
    mesh = mesh_of("icosphere", subdivisions=6 if n_triangles < 10_000 else 8, radius=0.5)
    thing = linked(smooth(shaken(mesh, 2e-4, np.random.default_rng(1))), "Scan")
    return add(thing, "DECIMATE", ratio=n_triangles / len(mesh.polygons))


def text(**sizes: float) -> bpy.types.Object:
    """A word, upright; caps, bevels and sides share no vertices."""
    data = bpy.data.curves.new("Text", "FONT")
    data.body = "Ki"
    for name, value in sizes.items():
        setattr(data, name, value)
    data.transform(Matrix.Rotation(math.pi / 2, 4, "X"))
    return linked(data, "Text")


def remeshed_text() -> bpy.types.Object:
    """A text rebuilt of voxels, shaded smooth."""
    thing = text(extrude=0.15)
    return add(thing, "REMESH", mode="VOXEL", voxel_size=0.03, use_smooth_shade=True)


def ellipsoid(subdivisions: int = 5) -> bpy.types.Object:
    """A ball whose axes differ."""
    mesh = mesh_of("icosphere", subdivisions=subdivisions, radius=0.5)
    mesh.transform(Matrix.Diagonal((1.0, 0.8, 0.6, 1.0)))
    return linked(smooth(mesh), "Ellipsoid")


def bottle(levels: int = 2) -> bpy.types.Object:
    """A hollow surface of revolution from the profile of its wall."""
    return add(turned(BOTTLE, 64), "SUBSURF", levels=levels, quality=6)


def cube() -> bpy.types.Object:
    """A cube, rotated as in the reference rig to show an edge."""
    mesh = mesh_of("cube", size=1.0)
    mesh.transform(Matrix.Rotation(math.radians(15.8), 4, "Z"))
    return linked(mesh, "Cube")


def gem() -> bpy.types.Object:
    """A round brilliant of 57 facets and a girdle of 32, table towards the viewer."""
    facets = [
        ((k + first) / n, elevation, d)
        for n, first, elevation, d in [*BRILLIANT, GIRDLE]
        for k in range(n)
    ]
    turn, elevation, distances = np.array(facets).T
    thing = cut_stone(2 * np.pi * turn, np.radians(elevation), distances)
    thing.data.transform(Matrix.Rotation(math.pi / 2, 4, "X"))
    return thing


def cut_cylinder() -> bpy.types.Object:
    """A cylinder of 24 sides with flat facets and bevelled rims."""
    thing = linked(prism(24, radius1=0.5, radius2=0.5), "Cylinder")
    return add(thing, "BEVEL", width=0.06, limit_method="ANGLE")


def bauble() -> bpy.types.Object:
    """A thin-walled ball with a neck, open at its top: inside and outside are one surface."""
    arc = [(math.sin(a) * 0.5, -math.cos(a) * 0.5) for a in np.linspace(0, math.pi - 0.2, 24)]
    return add(turned([*arc, (0.1, 0.6)], 48), "SOLIDIFY", thickness=0.02)


def nine_balls(subdivisions: int = 4) -> bpy.types.Object:
    """Balls side by side, by two Array modifiers."""
    thing = ball(subdivisions)
    for offset in ((1.1, 0.0, 0.0), (0.0, 0.0, 1.1)):
        add(thing, "ARRAY", count=3, relative_offset_displace=offset)
    return thing


def dissolved() -> bpy.types.Object:
    """A ball with clouds on it, rebuilt of voxels, its flat parts dissolved: facets of any shape in
    smooth shading, as a sculpture is thinned out for the game.
    """
    thing = clouds(ball(5), 0.3, 0.25)
    add(thing, "REMESH", mode="VOXEL", voxel_size=0.02, use_smooth_shade=True)
    return add(thing, "DECIMATE", decimate_type="DISSOLVE", angle_limit=0.2)


def struts() -> bpy.types.Object:
    """The edges of a ball as rods: light goes through four of them and more."""
    return add(add(ball(2), "WIREFRAME", thickness=0.1), "SUBSURF", levels=2)


BEVEL = {"extrude": 0.12, "bevel_depth": 0.03, "bevel_resolution": 3}
GLASSES: dict[str, Callable[[], bpy.types.Object]] = {
    "ball": ball,
    "cube": cube,
    "ellipsoid": ellipsoid,
    "bottle": bottle,
    "wine glass": wine_glass,
    "vase": vase,
    "Suzanne": suzanne,
    "text, bevelled": lambda: text(**BEVEL),
    "text, remeshed": remeshed_text,
    "gem": gem,
    "cut cylinder": cut_cylinder,
    "displaced ball": displaced,
    "scan": scan,
    "large scan": lambda: scan(100_000),
    "bauble": bauble,
    "nine balls": nine_balls,
}
# only on request by name, not in any table
OTHERS: dict[str, Callable[[], bpy.types.Object]] = {
    "dissolved": dissolved,
    "struts": struts,
    "text, spaced": lambda: text(**BEVEL, space_character=1.2),  # non-overlapping letters
    "wine glass, filled": wine_glass,
}
# the intended surface, much finer, if the mesh of a glass approximates one
MEANT: dict[str, Callable[[], bpy.types.Object]] = {
    "ball": lambda: ball(8),
    "ellipsoid": lambda: ellipsoid(8),
    "bottle": lambda: bottle(4),
    "wine glass": lambda: wine_glass(4),
    "vase": fine_vase,
    "Suzanne": lambda: suzanne(4),
    "text, bevelled": lambda: text(**BEVEL | {"bevel_resolution": 24}, resolution_u=96),
    "displaced ball": lambda: displaced(8),
    "scan": lambda: ball(8),
    "large scan": lambda: ball(8),
    "nine balls": lambda: nine_balls(6),
}
FILLINGS = {"wine glass, filled": (wine, 1.34)}  # and their indices
INDICES = {"gem": 2.42}  # others are of 1.49
# m, height of the point to look at; other glasses are seen at their middle, SIZE across
BOWLS = {"wine glass": 0.14, "wine glass, filled": 0.14}


def made(name: str) -> Mesh:
    """The evaluated mesh of a glass in world space, with Blender's normals."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    thing = (GLASSES | OTHERS)[name]()
    return evaluated(thing, place_of(name, thing))


def meant(name: str) -> Mesh | None:
    """The mesh of the intended surface, in the place of the glass; None if it is unknown.

    A glass with only flat faces is its own intended surface.
    """
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    thing = GLASSES[name]()
    place = place_of(name, thing)
    if name in MEANT:
        return evaluated(MEANT[name](), place)
    drawn = evaluated(thing, place)
    is_flat = drawn.is_smooth is None or not drawn.is_smooth.any()
    return drawn if is_flat else None


def filled(name: str, mesh: Mesh) -> tuple[Glass, ...]:
    """A glass of a mesh, and its filling, if it has one."""
    glass = Glass("glass", mesh, ConstantIndex(INDICES.get(name, 1.49)), priority=1)
    if name not in FILLINGS:
        return (glass,)
    make, of_filling = FILLINGS[name]
    within = replace(evaluated(make(), place_of(name, None)), surface=mesh.surface)
    return glass, Glass("filling", within, ConstantIndex(of_filling))


def place_of(name: str, thing: bpy.types.Object | None) -> Matrix:
    """Position of a glass object on the bench; a bowl is at its glass."""
    if name in BOWLS:
        return Matrix.Translation((0, 0, -BOWLS[name]))
    return Matrix.Scale(SIZE, 4) @ fitting(thing)


def rebuilt(fine: Mesh, **options: object) -> Mesh:
    """A smooth-shaded mesh, remade by a modifier with these options."""
    data = bpy.data.meshes.new("Fine")
    data.from_pydata(fine.vertices.tolist(), [], fine.triangles.tolist())
    thing = linked(smooth(data), "Fine")
    add(thing, **options)
    mesh = evaluated(thing, Matrix())
    bpy.data.meshes.remove(data)
    return mesh


def evaluated(thing: bpy.types.Object, place: Matrix) -> Mesh:
    """The mesh of an object with its modifiers, at a place in the world."""
    bpy.context.view_layer.update()
    result = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh, _ = in_world(read_local(result.to_mesh(), has_normals=True), np.array(place))
    result.to_mesh_clear()
    return mesh


# of a mesh, as they are written
PARTS = (
    *("vertices", "triangles", "corner_normals", "is_smooth", "has_mean_normals", "rounding"),
    "polygon",
)


def main() -> None:
    """Write glasses to a folder as numpy files: options FOLDER [--meant] [NAME ...].

    With --meant, write the intended surfaces, if they are known.
    """
    folder, *names = sys.argv[1:]
    is_meant = names[:1] == ["--meant"]
    for name in names[is_meant:] or GLASSES:
        mesh = meant(name) if is_meant else made(name)
        if mesh is None:
            continue
        np.savez(
            Path(folder, f"{name}.npz"),
            index=INDICES.get(name, 1.49),
            **{part: getattr(mesh, part) for part in PARTS if getattr(mesh, part) is not None},
        )


if __name__ == "__main__":
    main()
