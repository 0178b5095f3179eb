"""Glass as people download it: triangles that are not merged, some flipped, flat, in four formats.

Blender's own exporters write the files and its importers read them, so that custom normals, split
vertices and merged ones come as they do in practice.
"""

from itertools import pairwise
from pathlib import Path

import bmesh
import bpy
import numpy as np
import pytest

from extension import loaded
from small_rigs import pixels, primitive
from test_checklist import press

N = 48  # columns
FLIPPED = 0.06
BUTTON = "Merge and Shade Smooth"
# (radius, height), m
GOBLET = [
    (0.0, 0.0), (0.02, 0.0), (0.034, 0.002), (0.030, 0.004), (0.008, 0.010), (0.004, 0.03),
    (0.004, 0.07), (0.008, 0.09), (0.025, 0.105), (0.036, 0.13), (0.038, 0.15), (0.034, 0.18),
    (0.032, 0.20), (0.030, 0.20), (0.032, 0.18), (0.036, 0.15), (0.034, 0.13), (0.023, 0.107),
    (0.006, 0.093), (0.0, 0.092),
]  # fmt: skip
BOTTLE = [
    (0.0, 0.0), (0.056, 0.0), (0.06, 0.006), (0.06, 0.11), (0.054, 0.13), (0.02, 0.15),
    (0.02, 0.2), (0.014, 0.2), (0.014, 0.15), (0.048, 0.13), (0.054, 0.11), (0.054, 0.012),
    (0.0, 0.01),
]  # fmt: skip
PROFILES = {"goblet": GOBLET, "bottle": BOTTLE}
WRITE = {
    "obj": lambda path: bpy.ops.wm.obj_export(filepath=path, export_materials=False),
    "stl": lambda path: bpy.ops.wm.stl_export(filepath=path),
    "ply": lambda path: bpy.ops.wm.ply_export(filepath=path),
    "glb": lambda path: bpy.ops.export_scene.gltf(filepath=path),
}
READ = {
    "obj": lambda path: bpy.ops.wm.obj_import(filepath=path),
    "stl": lambda path: bpy.ops.wm.stl_import(filepath=path),
    "ply": lambda path: bpy.ops.wm.ply_import(filepath=path),
    "glb": lambda path: bpy.ops.import_scene.gltf(filepath=path),
}


def turned(profile: list[tuple[float, float]]) -> bmesh.types.BMesh:
    """A profile turned about the upright axis, in quads, its faces outwards."""
    shape = bmesh.new()
    around = np.arange(N) * 2 * np.pi / N
    rings = [
        [shape.verts.new((r * np.cos(a), r * np.sin(a), z)) for a in around]
        if r
        else [shape.verts.new((0.0, 0.0, z))] * N
        for r, z in profile
    ]
    for low, high in pairwise(rings):
        for k in range(N):
            corners = low[k], low[k - N + 1], high[k - N + 1], high[k]
            shape.faces.new(list(dict.fromkeys(corners)))
    return shape


def drawn(name: str, is_smooth: bool) -> bpy.types.Mesh:
    """A closed mesh of triangles, some flipped; a flat one is not merged."""
    if name == "ball":
        shape = bmesh.new()
        bmesh.ops.create_uvsphere(shape, u_segments=N, v_segments=N // 2, radius=0.03)
    else:
        shape = turned(PROFILES[name])
    bmesh.ops.triangulate(shape, faces=shape.faces[:])
    if not is_smooth:
        bmesh.ops.split_edges(shape, edges=shape.edges[:])
    shape.faces.ensure_lookup_table()
    flipped = np.random.default_rng(1).random(len(shape.faces)) < FLIPPED
    bmesh.ops.reverse_faces(shape, faces=[shape.faces[k] for k in np.flatnonzero(flipped)])
    mesh = bpy.data.meshes.new(name)
    shape.to_mesh(mesh)
    shape.free()
    mesh.shade_smooth() if is_smooth else mesh.shade_flat()
    return mesh


def downloaded(name: str, form: str, folder: Path, is_smooth: bool = False) -> bpy.types.Object:
    """The glass of a small rig, as a file of this format brings it."""
    thing = bpy.data.objects.new(name, drawn(name, is_smooth))
    bpy.context.scene.collection.objects.link(thing)
    path = str(folder / f"glass.{form}")
    WRITE[form](path)
    bpy.data.objects.remove(thing)
    READ[form](path)
    (glass,) = bpy.context.scene.objects
    glass.kiriko.use_ior, glass.kiriko.ior = True, 1.5
    glass.select_set(True)
    bpy.context.view_layer.objects.active = glass
    bpy.context.view_layer.update()
    bpy.ops.kiriko.add_rig(viewer_resolution=32, display_resolution=(64, 64))
    return glass


def volume(mesh: bpy.types.Mesh) -> float:
    """What a closed mesh encloses, by its faces as they are wound."""
    shape = bmesh.new()
    shape.from_mesh(mesh)
    found = shape.calc_volume(signed=True)
    shape.free()
    return found


def is_wound_one_way(mesh: bpy.types.Mesh) -> bool:
    """Does each edge have two faces, which run along it in both directions?"""
    shape = bmesh.new()
    shape.from_mesh(mesh)
    found = all(edge.is_contiguous for edge in shape.edges)
    shape.free()
    return found


@pytest.mark.parametrize("form", WRITE)
@pytest.mark.parametrize("name", ["ball", *PROFILES])
def test_one_button_mends_what_is_downloaded(look, no_remedies, tmp_path, name, form):
    """The checklist names flat and flipped faces; after its button the mesh is merged, wound one
    way and smooth, the checklist is empty, and all of the picture is seen.
    """
    glass = downloaded(name, form, tmp_path)
    (entry,) = look()
    assert entry.icon == "ERROR"
    assert "looks curved, but its" in entry.text
    assert [str(button.label) for button in entry.buttons] == [BUTTON]
    press([entry], "looks curved")

    assert look() == []
    mesh = glass.data
    n_rings = N // 2 - 1 if name == "ball" else len(PROFILES[name]) - 2
    assert len(mesh.vertices) == N * n_rings + 2
    assert is_wound_one_way(mesh)
    assert volume(mesh) > 0
    assert not mesh.has_custom_normals
    if name == "ball":  # its normals are known
        corners = np.array([tuple(one.vector) for one in mesh.corner_normals])
        places = np.array([tuple(mesh.vertices[one.vertex_index].co) for one in mesh.loops])
        assert np.abs(corners - places / 0.03).max() < 0.01

    bpy.ops.kiriko.solve()
    assert "shows 100 % of the picture" in bpy.context.scene.kiriko.result.summary


@pytest.mark.parametrize("form", ["obj", "glb"])
def test_normals_of_a_file_with_flipped_faces_are_not_kept(look, no_remedies, tmp_path, form):
    """A smooth ball's normals beside flipped faces are wrong in the file, too: after the button it
    gives the source image of a ball that was drawn well.
    """
    glass = downloaded("ball", form, tmp_path, is_smooth=True)
    press(look(), "flipped faces")
    assert look() == []
    bpy.ops.kiriko.solve()
    found = pixels(bpy.context.scene.kiriko.result.source)

    shape = bmesh.new()
    bmesh.ops.create_uvsphere(shape, u_segments=N, v_segments=N // 2, radius=0.03)
    bmesh.ops.triangulate(shape, faces=shape.faces[:])
    shape.to_mesh(glass.data)
    shape.free()
    glass.data.shade_smooth()
    bpy.ops.kiriko.solve()
    assert np.abs(pixels(bpy.context.scene.kiriko.result.source) - found).mean() < 0.01


def cut_block() -> bpy.types.Mesh:
    """A cube of 4800 triangles, which lie in six planes."""
    shape = bmesh.new()
    bmesh.ops.create_cube(shape, size=0.05)
    bmesh.ops.subdivide_edges(shape, edges=shape.edges[:], cuts=19, use_grid_fill=True)
    bmesh.ops.triangulate(shape, faces=shape.faces[:])
    mesh = bpy.data.meshes.new("block")
    shape.to_mesh(mesh)
    shape.free()
    return mesh


@pytest.mark.parametrize(
    ("made", "is_smooth", "is_curve"),
    [
        (lambda: drawn("ball", is_smooth=True), True, False),
        (lambda: drawn("ball", is_smooth=True), False, True),
        (cut_block, False, False),
        (lambda: primitive("icosphere", subdivisions=4, radius=0.03), False, True),
        (lambda: primitive("icosphere", subdivisions=3, radius=0.03), False, False),  # 320
    ],
    ids=["smooth", "flat", "block", "icosphere", "few"],
)
def test_facets_are_those_that_look_flat_on_a_curve(scene, made, is_smooth, is_curve):
    """All faces count, or none: coplanar triangles are one facet, wherever they are flipped."""
    faults = loaded("core.blender.checks.faults")
    mesh = made()
    mesh.shade_smooth() if is_smooth else mesh.shade_flat()
    assert faults.counts_of(mesh).n_facets == (len(mesh.polygons) if is_curve else 0)


def test_a_clean_flat_ball_is_offered_shade_smooth_alone(look):
    """There is nothing to merge and no normal to recalculate."""
    mesh = primitive("icosphere", subdivisions=4, radius=0.03)
    glass = bpy.data.objects.new("ball", mesh)
    bpy.context.scene.collection.objects.link(glass)
    glass.kiriko.use_ior = True
    glass.select_set(True)
    bpy.context.view_layer.update()
    bpy.ops.kiriko.add_rig(viewer_resolution=32, display_resolution=(64, 64))
    (entry,) = look()
    assert [str(button.label) for button in entry.buttons] == ["Shade Smooth"]
