"""Random glass as artists bring it: texts, curves, splines, metaballs, bodies of modifiers.

Each is an object about one unit across around the origin, not yet in its place.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import combinations

import bmesh
import bpy
import numpy as np
from mathutils import Matrix

Random = np.random.Generator

SAME = 1e-7  # of the unit: nearer corners are one


def shown_points(thing: bpy.types.Object) -> np.ndarray:
    """Vertices (n, 3) of an object as it is shown, in its own coordinates."""
    bpy.context.view_layer.update()
    evaluated = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    evaluated.to_mesh_clear()
    return points.reshape(-1, 3)


def fitting(thing: bpy.types.Object) -> Matrix:
    """The matrix that moves an object to the origin and scales it to one unit, if it has a size."""
    points = shown_points(thing)
    if not len(points):
        return Matrix()
    low = points.min(axis=0)
    high = points.max(axis=0)
    size = float((high - low).max()) or 1.0
    return Matrix.Scale(1 / size, 4) @ Matrix.Translation((-(low + high) / 2).tolist())


def add(thing: bpy.types.Object, kind: str, **options: object) -> bpy.types.Object:
    """Give an object a modifier with options."""
    modifier = thing.modifiers.new(kind.title(), kind)
    for name, value in options.items():
        setattr(modifier, name, value)
    return thing


def clouds(thing: bpy.types.Object, scale: float, strength: float) -> bpy.types.Object:
    """Give an object a Displace modifier."""
    texture = bpy.data.textures.new("Clouds", "CLOUDS")
    texture.noise_scale = scale
    return add(thing, "DISPLACE", texture=texture, strength=strength)


def linked(data: bpy.types.ID, name: str) -> bpy.types.Object:
    """A new object in the scene."""
    thing = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def mesh_of(make: str, **sizes: object) -> bpy.types.Mesh:
    """A mesh of a bmesh primitive."""
    mesh = bpy.data.meshes.new("Shape")
    shape = bmesh.new()
    # bmesh.ops keeps the address of the name only: it has to live until the call is over
    name = f"create_{make}"
    getattr(bmesh.ops, name)(shape, **sizes)
    shape.to_mesh(mesh)
    shape.free()
    return mesh


def smooth(mesh: bpy.types.Mesh) -> bpy.types.Mesh:
    """The mesh, shaded smooth all over."""
    mesh.polygons.foreach_set("use_smooth", np.ones(len(mesh.polygons), bool))
    mesh.update()
    return mesh


def shaken(mesh: bpy.types.Mesh, noise: float, random: Random) -> bpy.types.Mesh:
    """The mesh with its vertices moved at random, by a standard deviation in its own units."""
    places = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", places)
    mesh.vertices.foreach_set("co", places + random.normal(0, noise, places.shape))
    return mesh


def behind(normals: np.ndarray, distances: np.ndarray) -> bpy.types.Mesh:
    """The convex body behind all planes, by their outward normals (p, 3) and distances (p,) from
    the origin.

    Its corners are where three planes meet and no other cuts them off.
    """
    three = np.array(list(combinations(range(len(normals)), 3)))
    three = three[np.abs(np.linalg.det(normals[three])) > 1e-6]
    corners = np.linalg.solve(normals[three], distances[three][..., None])[..., 0]
    corners = corners[(corners @ normals.T <= distances + SAME).all(axis=1)]
    corners = np.unique(np.round(corners / SAME), axis=0) * SAME

    faces = []
    for normal, distance in zip(normals, distances, strict=True):
        on_it = np.flatnonzero(np.abs(corners @ normal - distance) < 4 * SAME)
        if len(on_it) < 3:
            continue
        across = np.linalg.svd(normal[None])[2][1:]
        across[1] = np.cross(normal, across[0])
        x, y = across @ (corners[on_it] - corners[on_it].mean(axis=0)).T
        faces.append(on_it[np.argsort(np.arctan2(y, x))].tolist())

    mesh = bpy.data.meshes.new("Behind")
    mesh.from_pydata(corners.tolist(), [], faces)
    return mesh


def turned(profile: list[tuple[float, float]], steps: int) -> bpy.types.Object:
    """A profile of radii and heights, turned about z by a Screw modifier; shaded smooth."""
    mesh = bpy.data.meshes.new("Profile")
    mesh.from_pydata(
        [(x, 0.0, z) for x, z in profile], [(k, k + 1) for k in range(len(profile) - 1)], []
    )
    thing = linked(mesh, "Turned")
    # on the axis only: by default a stem of less than a centimetre becomes a line
    merged = {"use_merge_vertices": True, "merge_threshold": 1e-6}
    smooth_ones = {"use_smooth_shade": True, "use_normal_calculate": True}
    return add(thing, "SCREW", steps=steps, render_steps=steps, **merged, **smooth_ones)


def prism(sides: int, **sizes: float) -> bpy.types.Mesh:
    """A cylinder or cone of flat sides, one unit high."""
    return mesh_of("cone", cap_ends=True, segments=sides, depth=1.0, **sizes)


# Random ones


def text(random: Random, bevel: float = 0.0) -> bpy.types.Object:
    """An extruded text, upright; its caps and sides share no vertices."""
    data = bpy.data.curves.new("Text", "FONT")
    data.body = "".join(random.choice(list("AKORTX8&"), 2)) if random.random() < 0.5 else "Ki"
    data.extrude = random.uniform(0.05, 0.3)
    data.bevel_depth, data.bevel_resolution = bevel, 2
    data.resolution_u = int(random.integers(2, 8))
    data.transform(Matrix.Rotation(math.pi / 2, 4, "X"))
    return linked(data, "Text")


def rod(random: Random) -> bpy.types.Object:
    """A curve with a bevel and filled caps: three touching shells."""
    data = bpy.data.curves.new("Rod", "CURVE")
    data.dimensions, data.use_fill_caps = "3D", True
    data.bevel_depth = random.uniform(0.1, 0.4)
    data.bevel_resolution = int(random.integers(1, 8))
    data.resolution_u = int(random.integers(2, 12))
    spline = data.splines.new("BEZIER")
    spline.bezier_points.add(int(random.integers(1, 3)))
    for k, point in enumerate(spline.bezier_points):
        point.co = (k, *random.normal(0, 0.2, 2))
        point.handle_left_type = point.handle_right_type = "AUTO"
    return linked(data, "Rod")


def spline_sphere(random: Random) -> bpy.types.Object:
    """A NURBS sphere or torus: its seam and poles have vertices of their own."""
    bpy.context.view_layer.update()
    kind = random.choice(["sphere", "torus"])
    getattr(bpy.ops.surface, f"primitive_nurbs_surface_{kind}_add")(radius=0.5)
    thing = bpy.context.object
    for spline in thing.data.splines:
        spline.resolution_u = spline.resolution_v = int(random.integers(2, 7))
    return thing


def metaballs(random: Random) -> bpy.types.Object:
    """Two or three metaballs that melt into each other.

    A name of their own: Blender melts all whose names differ by a number alone, as finely as the
    first asks for, in its units. A thousandth as large, it would fill the others with cubes.
    """
    name = f"Metaballs {len(bpy.data.metaballs)}"
    data = bpy.data.metaballs.new(name)
    data.resolution = random.uniform(0.15, 0.4)
    for k in range(int(random.integers(2, 4))):
        element = data.elements.new()
        element.co = (0.9 * k, *random.normal(0, 0.2, 2))
        element.radius = random.uniform(0.8, 1.3)
    return linked(data, name)


def remeshed(random: Random) -> bpy.types.Object:
    """A body rebuilt of voxels, smooth: no vertex lies where it was meant to be."""
    cube, ball = mesh_of("cube", size=1.0), mesh_of("icosphere", subdivisions=3, radius=0.5)
    thing = linked(random.choice([cube, ball]), "Remeshed")
    size, is_smooth = random.uniform(0.08, 0.2), bool(random.random() < 0.7)
    return add(thing, "REMESH", mode="VOXEL", voxel_size=size, use_smooth_shade=is_smooth)


def scan(random: Random) -> bpy.types.Object:
    """A noisy, irregular ball, smooth, as a scanner sees it, thinned out by a Decimate modifier."""
    mesh = mesh_of("icosphere", subdivisions=4, radius=0.5)
    thing = linked(smooth(shaken(mesh, 10 ** random.uniform(-5, -2), random)), "Scan")
    return add(thing, "DECIMATE", ratio=random.uniform(0.1, 0.9))


def unwelded(random: Random) -> bpy.types.Object:
    """A body whose faces share no vertices, as many files have it; half with a Weld modifier."""
    meshes = {
        "cube": lambda: mesh_of("cube", size=1.0),
        "icosphere": lambda: mesh_of("icosphere", subdivisions=2, radius=0.5),
        "cone": lambda: prism(24, radius1=0.5, radius2=0.3),
    }
    mesh = meshes[random.choice([*meshes])]()
    shape = bmesh.new()
    shape.from_mesh(mesh)
    bmesh.ops.split_edges(shape, edges=shape.edges[:])
    shape.to_mesh(mesh)
    shape.free()
    thing = linked(mesh, "Unwelded")
    return add(thing, "WELD", merge_threshold=1e-4) if random.random() < 0.5 else thing


def array(random: Random) -> bpy.types.Object:
    """Bodies side by side by an Array modifier: apart, touching, or one in the other."""
    thing, count = linked(mesh_of("cube", size=1.0), "Array"), int(random.integers(2, 4))
    offset = random.choice([1.0, 1.2, 0.7]), 0.0, 0.0
    return add(thing, "ARRAY", count=count, relative_offset_displace=offset)


def engraved(random: Random) -> bpy.types.Object:
    """A cube with a groove or a pit cut into it by a Boolean modifier."""
    thing = linked(mesh_of("cube", size=1.0), "Engraved")
    cutter = linked(prism(7, radius1=0.2, radius2=0.05), "Cutter")
    cutter.scale.z = 0.6
    cutter.location = (*random.uniform(-0.2, 0.2, 2), 0.5)
    cutter.hide_render, cutter.display_type = True, "WIRE"
    cutter.parent = thing
    return add(thing, "BOOLEAN", operation="DIFFERENCE", object=cutter, solver="EXACT")


def wine_glass(random: Random) -> bpy.types.Object:
    """A profile turned by Screw, given a wall by Solidify and rounded by Subdivision."""
    radii = np.array([0.0, 0.3, 0.05, 0.04, 0.25, 0.32, 0.28])
    radii *= random.uniform(0.9, 1.1, len(radii))
    heights = 0.0, 0.0, 0.05, 0.4, 0.6, 0.8, 1.0
    thing = turned([*zip(radii, heights, strict=True)], int(random.integers(6, 12)))
    add(thing, "SOLIDIFY", thickness=0.02)
    return add(thing, "SUBSURF", levels=1, render_levels=1)


def bottle(random: Random) -> bpy.types.Object:
    """A hollow body, open at its top: the profile of its wall, turned; half of them subdivided."""
    outside = [(random.uniform(0.1, 0.4), z) for z in (0.0, 0.3, 0.6, 0.8, 1.0)]
    wall = random.uniform(0.01, 0.05)
    inside = [(x - wall, max(z, wall)) for x, z in reversed(outside)]
    thing = turned([(0.0, 0.0), *outside, *inside, (0.0, wall)], int(random.integers(6, 24)))
    return add(thing, "SUBSURF", levels=1, render_levels=1) if random.random() < 0.5 else thing


def vase(random: Random) -> bpy.types.Object:
    """A coarse profile, turned and given a wall by Solidify: large angles from face to face."""
    profile = [(random.uniform(0.15, 0.45), z) for z in np.linspace(0.0, 1.0, 5)]
    thing = turned(profile, int(random.integers(6, 32)))
    return add(thing, "SOLIDIFY", thickness=random.uniform(0.02, 0.08))


def bauble(random: Random) -> bpy.types.Object:
    """A ball with a thin wall and an open neck: its inside and outside are one surface."""
    open_at = random.uniform(0.1, 0.6)
    arc = [(math.sin(a) * 0.5, -math.cos(a) * 0.5) for a in np.linspace(0, math.pi - open_at, 12)]
    neck = [(arc[-1][0], 0.6)] if random.random() < 0.5 else []
    thing = turned([*arc, *neck], int(random.integers(8, 24)))
    return add(thing, "SOLIDIFY", thickness=random.uniform(0.005, 0.05))


def gem(random: Random) -> bpy.types.Object:
    """A table, and rings of facets around an axis, as a stone is cut."""
    facets = [(0.0, math.pi / 2, random.uniform(0.2, 0.4))]
    for elevation in (0.9, 0.0, -0.8):
        n = int(random.integers(3, 12))
        each = elevation * random.uniform(0.8, 1.2), random.uniform(0.35, 0.5)
        facets += [(2 * math.pi * k / n, *each) for k in range(n)]
    return cut_stone(*np.array(facets).T)


def cut_stone(turn: np.ndarray, elevation: np.ndarray, distances: np.ndarray) -> bpy.types.Object:
    """The body behind facets, by their angles and their distances from the middle (n,)."""
    across = np.cos(elevation)
    normals = [np.cos(turn) * across, np.sin(turn) * across, np.sin(elevation)]
    return linked(behind(np.stack(normals, axis=1), distances), "Gem")


def cut_cylinder(random: Random) -> bpy.types.Object:
    """A cylinder of flat facets whose edges a Bevel modifier rounds or breaks."""
    thing = linked(prism(int(random.integers(3, 24)), radius1=0.5, radius2=0.5), "Cut")
    limit = random.choice(["ANGLE", "NONE"])
    width, segments = random.uniform(0.005, 0.1), int(random.integers(1, 4))
    return add(thing, "BEVEL", limit_method=limit, width=width, segments=segments)


def displaced(random: Random) -> bpy.types.Object:
    """A smooth ball with clouds on it, by a Displace modifier."""
    thing = linked(smooth(mesh_of("icosphere", subdivisions=3, radius=0.5)), "Displaced")
    return clouds(thing, random.uniform(0.2, 0.8), random.uniform(0.02, 0.3))


BROUGHT: dict[str, Callable[[Random], bpy.types.Object]] = {
    "text": text,
    "bevelled text": lambda random: text(random, bevel=random.uniform(0.01, 0.04)),
    "rod": rod,
    "splines": spline_sphere,
    "metaballs": metaballs,
    "remeshed": remeshed,
    "scan": scan,
    "unwelded": unwelded,
    "array": array,
    "engraved": engraved,
    "wine glass": wine_glass,
    "bottle": bottle,
    "vase": vase,
    "bauble": bauble,
    "gem": gem,
    "cut cylinder": cut_cylinder,
    "displaced ball": displaced,
}
