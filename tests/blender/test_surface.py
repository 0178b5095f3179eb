"""The surface meant by smooth shading: settings, normals, creases and limit surfaces as they
are read.
"""

import importlib
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from types import ModuleType
from typing import Any

import bmesh
import bpy
import numpy as np
import pytest
from mathutils import Matrix

from small_rigs import new_object, primitive

HAS_FLOAT_NORMALS = bpy.app.version >= (4, 5)


@pytest.fixture
def read(scene: bpy.types.Scene, kiriko: ModuleType) -> Callable[[], Any]:
    module = importlib.import_module(f"{kiriko.__name__}.core.blender.read.scene")
    return lambda: module.read(bpy.context, scene)


def box() -> bpy.types.Object:
    """A smooth-shaded glass box of 2 x 3 x 4, on which every kind of mean is another one."""
    mesh = primitive("cube", size=1.0)
    mesh.transform(Matrix.Diagonal((2.0, 3.0, 4.0, 1.0)))
    return smooth(mesh)


def smooth(mesh: bpy.types.Mesh, role: str = "GLASS") -> bpy.types.Object:
    mesh.shade_smooth()
    return new_object(mesh, role)


def ball() -> bpy.types.Object:
    return smooth(primitive("uvsphere", u_segments=16, v_segments=8, radius=1.0))


def tilted(mesh: bpy.types.Mesh) -> list[list[float]]:
    """A unit vector for each vertex, up to 17 degrees off a ball's normal."""
    points = np.array([v.co.normalized()[:] for v in mesh.vertices])
    points[:, 0] += 0.3
    return (points / np.linalg.norm(points, axis=1, keepdims=True)).tolist()


def give_normals(mesh: bpy.types.Mesh, normals: np.ndarray) -> None:
    """Custom normals of the vertices (n, 3), in the numbers themselves where Blender can
    hold them.
    """
    if HAS_FLOAT_NORMALS:
        attribute = mesh.attributes.new("custom_normal", "FLOAT_VECTOR", "POINT")
        attribute.data.foreach_set("vector", np.asarray(normals, np.float32).ravel())
        mesh.update()
    else:
        mesh.normals_split_custom_set_from_vertices(np.asarray(normals).tolist())


def subdivide(thing: bpy.types.Object, levels: int = 2) -> bpy.types.Modifier:
    modifier = thing.modifiers.new("Fine", "SUBSURF")
    modifier.levels = modifier.render_levels = levels
    return modifier


def crease(thing: bpy.types.Object, is_creased: Callable[[np.ndarray], bool]) -> None:
    """A full crease on the edges of an object whose two ends (2, 3) say so."""
    points = np.array([v.co[:] for v in thing.data.vertices])
    weights = [float(is_creased(points[list(edge.vertices)])) for edge in thing.data.edges]
    thing.data.attributes.new("crease_edge", "FLOAT", "EDGE").data.foreach_set("value", weights)


def is_top(ends: np.ndarray) -> bool:
    return bool((ends[:, 2] > 0).all())


@pytest.mark.parametrize("role", ["GLASS", "MIRROR"])
def test_surface_is_set_on_the_object(read: Callable[[], Any], role: str) -> None:
    """Automatic unless the artist says otherwise, of glass and mirror alike."""
    thing = smooth(primitive("uvsphere", u_segments=8, v_segments=4, radius=1.0), role)
    choices = (
        (None, "automatic"),
        ("FACETS", "facets"),
        ("SMOOTH", "smooth"),
        ("AUTOMATIC", "automatic"),
    )

    for choice, surface in choices:
        if choice:
            thing.kiriko.surface = choice
        rig = read().rig
        assert [part.mesh.surface for part in (*rig.glasses, *rig.mirrors)] == [surface]


def test_surface_is_that_of_whoever_has_the_role(read: Callable[[], Any]) -> None:
    """The members of an instanced collection take it from the empty that is glass."""
    member = smooth(primitive("uvsphere", u_segments=8, v_segments=4, radius=1.0), "NONE")
    collection = bpy.data.collections.new("box")
    collection.objects.link(member)
    bpy.context.scene.collection.objects.unlink(member)
    empty = new_object(None, "GLASS")
    empty.instance_type = "COLLECTION"
    empty.instance_collection = collection
    empty.kiriko.surface = "FACETS"
    assert [glass.mesh.surface for glass in read().rig.glasses] == ["facets"]


def test_normals_that_nobody_gave_are_means(read: Callable[[], Any]) -> None:
    """Shade smooth, sharp edges and a bevel leave Blender's means.

    Flat shading has no corner normals at all.
    """
    thing = box()
    assert read().rig.glasses[0].mesh.has_mean_normals
    thing.data.edges.foreach_set("use_edge_sharp", np.arange(12) % 2 == 0)
    thing.data.update()
    assert read().rig.glasses[0].mesh.has_mean_normals
    thing.modifiers.new("bevel", "BEVEL").width = 0.1
    assert read().rig.glasses[0].mesh.has_mean_normals
    thing.data.shade_flat()
    mesh = read().rig.glasses[0].mesh
    assert mesh.corner_normals is None
    assert not mesh.has_mean_normals


def test_polygons_tell_which_edges_were_drawn(read: Callable[[], Any]) -> None:
    """Triangles of one polygon follow each other, whichever way quads are split, and have the same
    number in a mirrored mesh; polygons without area leave no gap that matters. Given normals need
    none.
    """
    thing = smooth(
        primitive("cone", segments=7, radius1=1.0, radius2=0.5, depth=1.0, cap_ends=True)
    )
    thing.scale.x = -1
    mesh = read().rig.glasses[0].mesh
    sizes = np.bincount(mesh.polygon)
    assert sorted(sizes) == [2] * 7 + [5, 5]
    assert (np.diff(mesh.polygon) >= 0).all()
    for polygon, n in enumerate(sizes):
        corners = mesh.triangles[mesh.polygon == polygon]
        assert len(np.unique(corners)) == n + 2
    thing.data.normals_split_custom_set_from_vertices(tilted(thing.data))
    assert read().rig.glasses[0].mesh.polygon is None


@pytest.mark.parametrize("levels", [1, 2])
def test_a_subdivided_torus_lies_on_splines(
    read: Callable[[], Any], kiriko: ModuleType, levels: int
) -> None:
    """With Blender's own vertices and polygons all of it is curved, and normals of faces agree, but
    for float32.
    """
    major, minor = 16, 5
    bpy.ops.mesh.primitive_torus_add(major_segments=major, minor_segments=minor)
    thing = bpy.context.object
    thing.data.shade_smooth()
    thing.kiriko.role = "GLASS"
    subdivide(thing).levels = levels
    mesh = read().rig.glasses[0].mesh
    assert mesh.polygon.max() + 1 == major * minor * 4**levels
    make = importlib.import_module(f"{kiriko.__name__}.core.glass.surfaces").make_surface
    surface = make(replace(mesh, surface="automatic"))
    assert surface.n_curved == len(mesh.triangles)


@pytest.mark.parametrize(
    "way", ["split", "float", "WEIGHTED_NORMAL", "NORMAL_EDIT", "DATA_TRANSFER", "BEVEL"]
)
def test_normals_that_the_artist_gave_are_no_means(read: Callable[[], Any], way: str) -> None:
    """Set by hand or by a modifier."""
    thing = box()
    if way == "split":
        thing.data.normals_split_custom_set_from_vertices(tilted(thing.data))
    elif way == "float":
        give_normals(thing.data, tilted(thing.data))
    else:
        modifier = thing.modifiers.new("normals", way)
        if way == "DATA_TRANSFER":
            modifier.object = smooth(
                primitive("uvsphere", u_segments=32, v_segments=16, radius=3.0), "NONE"
            )
            modifier.use_loop_data = True
            modifier.data_types_loops = {"CUSTOM_NORMAL"}
        elif way == "BEVEL":
            modifier.harden_normals, modifier.width = True, 0.1

    assert not read().rig.glasses[0].mesh.has_mean_normals


def test_custom_normals_that_have_no_effect_are_means(read: Callable[[], Any]) -> None:
    """A subdivision modifier that does not use custom normals
    drops them, though Blender 4 says they are there.
    """
    thing = ball()
    thing.data.normals_split_custom_set_from_vertices(tilted(thing.data))
    modifier = subdivide(thing)
    for modifier.use_custom_normals in (False, True):
        assert read().rig.glasses[0].mesh.has_mean_normals == (not modifier.use_custom_normals)


def test_means_that_an_importer_wrote_are_means(read: Callable[[], Any]) -> None:
    """Custom normals that are Blender's own means, but for the rounding to 16 bits,
    change nothing.
    """
    thing = ball()
    plain = read().rig.glasses[0].mesh
    thing.data.normals_split_custom_set_from_vertices(
        [n.vector[:] for n in thing.data.vertex_normals]
    )
    assert thing.data.has_custom_normals
    found = read().rig.glasses[0].mesh
    assert found.has_mean_normals
    assert np.abs(found.corner_normals - plain.corner_normals).max() < 1e-4


@pytest.mark.skipif(
    not HAS_FLOAT_NORMALS, reason="Blender 4.2 holds no normals that are no normals"
)
@pytest.mark.parametrize("bad", [np.nan, np.inf, 0.0])
def test_bad_normals_are_handed_on(read: Callable[[], Any], bad: float) -> None:
    """A normal that is not finite, or none, is no means, warns of nothing and is for core to judge.

    Others are kept.
    """
    thing = ball()
    normals = np.array([v.co.normalized()[:] for v in thing.data.vertices])
    normals[5] = bad
    give_normals(thing.data, normals)
    mesh = read().rig.glasses[0].mesh
    assert not mesh.has_mean_normals
    is_bad = mesh.triangles == 5
    lengths = np.linalg.norm(mesh.corner_normals, axis=2)
    assert is_bad.any()
    assert np.abs(lengths[~is_bad] - 1).max() < 1e-12
    assert (lengths[is_bad] == 0).all() if bad == 0 else np.isnan(lengths[is_bad]).all()


def creased_cube(levels: int = 3) -> tuple[bpy.types.Object, bpy.types.Modifier]:
    """A cube of 2 under a subdivision modifier, with a full
    crease around its top, whose limit is flat there: z = 1.
    """
    thing = smooth(primitive("cube", size=2.0))
    crease(thing, is_top)
    return thing, subdivide(thing, levels)


def test_a_full_crease_is_sharp(read: Callable[[], Any]) -> None:
    """The creased top is flat to its edge, and the walls do not feel it.

    Elsewhere normals are as they were.
    """
    thing, modifier = creased_cube()
    mesh = read().rig.glasses[0].mesh
    assert mesh.has_mean_normals
    on_top = (np.abs(mesh.corners[..., 2] - 1) < 1e-6).all(axis=1)

    assert on_top.sum() == 2 * 8 * 8
    assert np.abs(mesh.corner_normals[on_top] - [0, 0, 1]).max() < 5e-6  # float32 of narrow faces
    rim = (np.abs(mesh.corners[..., 2] - 1) < 1e-6) & ~on_top[:, None]
    assert rim.any()

    a, b, c = np.moveaxis(mesh.corners, 1, 0)
    face = np.cross(b - a, c - a)
    face /= np.linalg.norm(face, axis=1, keepdims=True)
    beside = np.einsum("tcj,tj->tc", mesh.corner_normals, face)[rim]

    # a wall of eight faces turns by less from face to face
    assert beside.min() > np.cos(np.radians(15))
    modifier.use_creases = False
    plain = read().rig.glasses[0].mesh
    modifier.use_creases = True
    thing.kiriko.surface = "FACETS"
    as_drawn = read().rig.glasses[0].mesh

    # Blender's means lean over the edge
    assert np.abs(as_drawn.corner_normals[rim]).max(axis=0)[2] > 0.3
    elsewhere = as_drawn.corners[..., 2] < 1 - 1e-6
    assert np.abs(as_drawn.corner_normals[elsewhere] - mesh.corner_normals[elsewhere]).max() < 1e-6
    assert plain.corners[..., 2].max() < 1 - 1e-3


def lens(segments: int = 96, rings: int = 16) -> bpy.types.Object:
    """A biconvex lens of 44 mm, both faces of 50 mm, by Shade Smooth by Angle: its rim is sharp."""
    mesh = bpy.data.meshes.new("lens")
    bm = bmesh.new()
    end = np.arcsin(0.022 / 0.05)
    for side in (1, -1):
        angle = np.linspace(end, 0, rings + 1)
        radius, height = 0.05 * np.sin(angle), 0.05 * side * (np.cos(angle) - np.cos(end))
        profile = [bm.verts.new((r, 0, z)) for r, z in zip(radius, height, strict=True)]
        edges = [bm.edges.new(two) for two in pairwise(profile)]
        bmesh.ops.spin(
            bm,
            geom=[*profile, *edges],
            axis=(0, 0, 1),
            steps=segments,
            angle=2 * np.pi,
            use_duplicate=False,
        )
    bmesh.ops.remove_doubles(bm, verts=bm.verts, dist=1e-6)
    bmesh.ops.recalc_face_normals(bm, faces=bm.faces)
    bm.to_mesh(mesh)
    bm.free()
    thing = new_object(mesh, "GLASS")
    bpy.context.view_layer.objects.active = thing
    thing.select_set(True)
    bpy.ops.object.shade_smooth_by_angle(angle=np.radians(30))
    return thing


def test_normals_at_a_sharp_rim_are_those_of_the_surface(
    read: Callable[[], Any], kiriko: ModuleType
) -> None:
    """A lens's own to a hundredth of what Blender's means are off there, which are those of the
    last faces.
    """
    lens()
    mesh = read().rig.glasses[0].mesh
    make = importlib.import_module(f"{kiriko.__name__}.core.glass.surfaces").make_surface
    curved = make(replace(mesh, surface="automatic")).curved
    assert len(curved.triangle) == len(mesh.triangles)

    places, means = mesh.corners[curved.triangle], mesh.corner_normals[curved.triangle]
    middle = np.sqrt(0.05**2 - 0.022**2) * np.sign(means[..., 2:])
    own = places + middle * [0, 0, 1]
    own /= np.linalg.norm(own, axis=2, keepdims=True)
    off, off_by_means = (
        np.linalg.norm(normals - own, axis=2).max()
        for normals in (curved.vertex_normal[curved.vertex], means)
    )
    assert off_by_means > 0.01
    assert off < 0.01 * off_by_means


def test_a_soft_crease_and_one_without_subdivision_are_not_sharp(read: Callable[[], Any]) -> None:
    """Only a full crease that a shown modifier follows makes an edge."""
    thing, modifier = creased_cube()
    thing.data.attributes["crease_edge"].data.foreach_set("value", np.full(12, 0.9, np.float32))
    thing.data.update()
    soft = read().rig.glasses[0].mesh
    thing.kiriko.surface = "FACETS"

    assert np.array_equal(soft.corner_normals, read().rig.glasses[0].mesh.corner_normals)
    thing.kiriko.surface = "SMOOTH"
    crease_of = thing.data.attributes["crease_edge"].data
    crease_of.foreach_set("value", np.ones(12, np.float32))
    thing.data.update()
    modifier.show_viewport = False
    mesh = read().rig.glasses[0].mesh
    corners = mesh.corners / np.sqrt(3)

    # the mean at a cube's corner is its diagonal
    assert np.abs(mesh.corner_normals - corners).max() < 1e-6


def test_reading_creases_changes_nothing(read: Callable[[], Any]) -> None:
    """Sharp edges are marked on a copy only, and the second reading is the first again."""
    thing, _ = creased_cube()
    first, second = (read().rig.glasses[0].mesh for _ in range(2))
    assert np.array_equal(first.corner_normals, second.corner_normals)
    assert "sharp_edge" not in thing.data.attributes
    evaluated = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
    assert "sharp_edge" not in evaluated.to_mesh().attributes
    evaluated.to_mesh_clear()


@pytest.mark.parametrize("has_crease", [False, True])
def test_vertices_of_a_subdivision_lie_on_its_limit(
    read: Callable[[], Any], has_crease: bool
) -> None:
    """Those of two levels are among those of four, and the
    cube's corner is where Catmull-Clark's limit has it.
    """
    thing = smooth(primitive("cube", size=2.0))
    if has_crease:
        crease(thing, is_top)
    modifier = subdivide(thing)
    points = {}
    for modifier.levels in (2, 4):
        points[modifier.levels] = read().rig.glasses[0].mesh.vertices
    apart = np.linalg.norm(points[2][:, None] - points[4][None], axis=2).min(axis=1)

    assert apart.max() < 1e-6
    # (n^2 v + 4 sum of the edges' ends + sum of the faces' far
    # corners) / (n (n + 5)) for n = 3: (9 + 4 - 1) / 24
    lowest = points[2][np.argmin(points[2] @ [1, 1, 1])]

    assert np.abs(lowest + 0.5).max() < 1e-5


def test_vertices_beside_the_limit_are_noted(read: Callable[[], Any]) -> None:
    """A subdivision modifier that does not use the limit
    surface is named with its object, and the remedy.
    """
    thing = smooth(primitive("cube", size=2.0))
    thing.name = "stone"
    modifier = subdivide(thing)

    def notes() -> list[str]:
        return [note for note in read().notes if "limit surface" in note.lower()]

    assert notes() == []
    modifier.use_limit_surface = False
    (note,) = notes()
    assert "'Fine' of 'stone'" in note

    thing.kiriko.surface = "FACETS"
    assert notes() == []
    thing.kiriko.surface = "SMOOTH"
    modifier.subdivision_type = "SIMPLE"

    assert notes() == []
    modifier.subdivision_type = "CATMULL_CLARK"
    modifier.show_viewport = False
    assert notes() == []


@pytest.mark.parametrize(
    ("kind", "options", "is_told"),
    [
        ("REMESH", {"mode": "VOXEL", "voxel_size": 0.2, "use_smooth_shade": True}, True),
        ("DECIMATE", {"decimate_type": "COLLAPSE", "ratio": 0.3}, True),
        ("DECIMATE", {"decimate_type": "UNSUBDIV", "iterations": 1}, False),
        ("WELD", {}, False),
    ],
)
def test_vertices_moved_off_the_surface_are_noted(read, kind, options, is_told) -> None:
    """Remeshed and collapsed: followed as smooth they are further from the true surface.

    Else nothing is said of it.
    """
    thing = ball()
    thing.kiriko.surface = "SMOOTH"
    modifier = thing.modifiers.new("Other", kind)
    for name, value in options.items():
        setattr(modifier, name, value)

    def notes() -> list[str]:
        return [note for note in read().notes if "off the curved surface" in note]

    found = notes()
    assert [("'Other' of" in note, note.endswith("Surface to Automatic.")) for note in found] == [
        (True, True)
    ] * is_told

    for thing.kiriko.surface in ("FACETS", "AUTOMATIC"):
        assert notes() == []


def test_triangles_go_back_to_blender(read: Callable[[], Any], kiriko: ModuleType) -> None:
    """A mesh made of triangles in the world is read as the
    same triangles, normals and shading, in any unit.
    """
    module = importlib.import_module(f"{kiriko.__name__}.core.blender.read.read_mesh")
    making = importlib.import_module(f"{kiriko.__name__}.core.blender.preview.preview_parts")
    thing = ball()
    thing.location = (100.0, 20.0, 3.0)
    thing.scale = (1.0, -2.0, 0.5)
    thing.data.polygons.foreach_set("use_smooth", np.arange(len(thing.data.polygons)) % 3 > 0)
    drawn = read().rig.glasses[0].mesh
    face = np.cross(*(drawn.corners[:, k] - drawn.corners[:, 0] for k in (1, 2)))
    face /= np.linalg.norm(face, axis=1, keepdims=True)
    normals = np.where(drawn.is_smooth[:, None, None], drawn.corner_normals, face[:, None])
    drawn = replace(drawn, corner_normals=normals)

    for metres in (1.0, 0.001):
        made, matrix = making.mesh_from_triangles("made", drawn, metres)
        to_metres = np.diag([metres, metres, metres, 1.0]) @ np.array(matrix, dtype=float)
        found, n_dropped = module.in_world(module.read_local(made, has_normals=True), to_metres)
        assert n_dropped == 0
        # the place is stored in float32
        assert np.abs(found.corners - drawn.corners).max() < 100 * 2.0**-23
        assert np.array_equal(found.is_smooth, drawn.is_smooth)
        assert np.abs(found.corner_normals - normals).max() < (1e-6 if HAS_FLOAT_NORMALS else 1e-4)
