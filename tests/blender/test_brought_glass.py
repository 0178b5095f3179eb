"""Glass as artists bring it: welded while it is read, solved, and judged by Cycles."""

from collections.abc import Callable

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from fuzz.shapes import BROUGHT, fitting, shown_points
from panel_layout import Layout

CLOSED = [
    *("text", "bevelled text", "rod", "splines", "metaballs", "unwelded", "engraved", "array"),
    *("bottle", "vase", "bauble", "gem", "cut cylinder"),
]


@pytest.fixture
def brought(scene):
    """Put a shape, 50 mm wide, into the scene as glass."""

    def make(name: str) -> bpy.types.Object:
        thing = BROUGHT[name](np.random.default_rng(2))
        thing.matrix_world = Matrix.Scale(0.05, 4) @ fitting(thing)
        thing.kiriko.use_ior, thing.kiriko.ior = True, 1.49
        for other in scene.objects:
            other.select_set(other == thing)
        return thing

    return make


def read(scene):
    from kiriko.core.blender.read import scene as blender_scene

    bpy.context.view_layer.update()
    return blender_scene.read(bpy.context.evaluated_depsgraph_get(), scene)


def test_each_glass_of_metaballs_is_one_of_its_own(brought):
    """A second one has as many points beside the first, which is a twentieth as large, as alone."""
    alone = len(shown_points(brought("metaballs")))
    assert len(shown_points(BROUGHT["metaballs"](np.random.default_rng(2)))) == alone > 100


@pytest.mark.parametrize("name", [*CLOSED, "displaced ball"])
def test_what_encloses_a_volume_is_read_as_closed(brought, scene, name):
    """No shell of it has an open edge, whichever vertices its faces share."""
    from kiriko.core.glass.solids import solids_from_mesh

    brought(name).kiriko.role = "GLASS"
    reading = read(scene)
    assert reading.rig.glasses
    for glass in reading.rig.glasses:
        assert not any(solid.n_open for solid in solids_from_mesh(glass.mesh.flat()))
    assert not any("without area" in note for note in reading.notes)


@pytest.mark.parametrize("name", ["text", "rod"])
def test_normals_stay_sharp_where_shells_are_joined(brought, scene, name):
    """Where a cap meets its side the two faces keep their own
    normals, as before they had a vertex together.
    """
    from kiriko.core.glass.meshes import edge_corners, find_edges, geometric_normals

    thing = brought(name)
    thing.kiriko.role = "GLASS"
    (glass,) = read(scene).rig.glasses
    mesh = glass.mesh
    edges = find_edges(glass.mesh.triangles)
    own = np.repeat(geometric_normals(mesh.corners)[:, None], 3, axis=1)
    normals = (
        own
        if mesh.corner_normals is None
        else np.where(mesh.is_smooth[:, None, None], mesh.corner_normals, own)
    )
    first, second = edge_corners(normals, edges)
    turn = (own[edges.first, 0] * own[edges.second, 0]).sum(axis=1)
    is_rim = turn < np.cos(np.radians(70))  # caps stand upright on sides
    if name == "text":  # its outline has such corners, too, which are shaded smooth
        is_rim &= mesh.is_smooth[edges.first] != mesh.is_smooth[edges.second]

    assert is_rim.sum() > 8
    assert (np.linalg.norm(first - second, axis=2)[is_rim] > 0.5).all()


@pytest.mark.parametrize("name", CLOSED)
def test_cycles_follows_the_same_light(brought, scene, name):
    """Landings of the viewer's pixels agree with Cycles, which
    knows nothing of vertices that faces share.

    To single precision, in which Cycles works. It turns normals that contradict their face, as
    those of a text's sides do, which are shaded smooth around corners: light that meets such is
    told, and goes another way there.
    """
    from fuzz.run import compared, how_far
    from kiriko.core.base.steps import run_steps
    from kiriko.core.solve.session import Session

    glass = brought(name)
    glass.kiriko.surface = "FACETS"
    # Cycles is off by a length, whatever a pixel is
    sizes = {"viewer_resolution": 96, "display_resolution": (512, 512), "display_size": 0.03}
    assert bpy.ops.kiriko.add_rig(**sizes) == {"FINISHED"}

    reading = read(scene)
    light = compared(scene, reading)
    agrees = ~light.by_odd_normal
    found = how_far(light.is_ours & agrees, light.is_theirs & agrees, light.off)
    assert found["median"] < 5e-3
    assert found["most"] < 0.02
    assert found["only_theirs"] < 2e-3
    assert found["apart"] < 5e-3
    assert found["both"] > 0.98

    solution = run_steps(Session().solve(reading.rig))
    assert solution.picture_coverage + sum(solution.misses.values()) == pytest.approx(1, abs=1e-9)
    assert not any("gaps" in warning for warning in solution.warnings)


PROFILE = 1e-3 * np.array(
    [
        *[(0.1, 0), (30, 0), (32, 1), (31, 2.5), (14, 4), (5, 8), (4, 20), (4, 50), (4, 80)],
        *[(8, 88), (20, 98), (30, 112), (36, 130), (38, 150), (37, 170), (36, 190)],
        *[(34.5, 190), (35.5, 170), (36.3, 150), (34, 130), (18, 104), (0.1, 97)],
    ]
)  # m, radius and height of a goblet
COLUMNS = 48


def downloaded() -> bpy.types.Object:
    """A goblet as an OBJ file has it: loose flat triangles, 6 % of them flipped."""
    turns = 2 * np.pi * np.arange(COLUMNS) / COLUMNS
    radius, height = PROFILE.T[:, :, None]
    rings = np.stack([radius * np.cos(turns), radius * np.sin(turns), height + 0 * turns], axis=2)
    a, b = rings[:-1], np.roll(rings, -1, axis=1)[:-1]
    d, c = rings[1:], np.roll(rings, -1, axis=1)[1:]
    sides = [np.stack(corners, axis=2).reshape(-1, 3, 3) for corners in ((a, b, c), (a, c, d))]
    ends = []
    for ring, order in ((rings[0], [0, 2, 1]), (rings[-1], [0, 1, 2])):
        middle = np.broadcast_to(ring.mean(axis=0), ring.shape)
        ends.append(np.stack([middle, ring, np.roll(ring, -1, axis=0)], axis=1)[:, order])
    triangles = np.concatenate([*sides, *ends])
    is_flipped = np.random.default_rng(0).random(len(triangles)) < 0.06
    triangles[is_flipped] = triangles[is_flipped][:, ::-1]

    mesh = bpy.data.meshes.new("WineGlass")
    faces = np.arange(3 * len(triangles)).reshape(-1, 3).tolist()
    mesh.from_pydata(triangles.reshape(-1, 3).tolist(), [], faces)
    thing = bpy.data.objects.new("WineGlass", mesh)
    bpy.context.scene.collection.objects.link(thing)
    thing.select_set(True)
    return thing


def test_a_downloaded_goblet_is_not_ready_before_it_is_merged_and_smooth(
    scene, look: Callable[[], list], drawn: Callable[..., Layout]
):
    """Triangulated, so that half of each facet's neighbours are coplanar. The panel names both
    faults, and one button merges, recalculates and smooths; then there is nothing left to do.
    """
    glass = downloaded()
    bpy.ops.kiriko.add_rig(viewer_resolution=64, display_resolution=(64, 64))
    bpy.ops.kiriko.make_glass(part=glass.name)
    entries = look()
    (entry,) = (one for one in entries if glass.name in one.text)
    assert entry.icon == "ERROR"
    assert "faces are flat" in entry.text
    assert "flipped" in entry.text
    texts = drawn("main_panel", "VIEW3D_PT_kiriko_main").texts
    assert not [text for text in texts if text.startswith("Ready")]

    (button,) = entry.buttons
    assert button.label == "Merge and Shade Smooth"
    assert bpy.ops.kiriko.shade_smooth(**dict(button.properties)) == {"FINISHED"}
    assert not [one for one in look() if glass.name in one.text]
    assert len(glass.data.vertices) == COLUMNS * len(PROFILE) + 2
    faults = look_at(glass)
    assert (faults.n_turned, faults.n_open, faults.n_facets, faults.n_loose) == (0, 0, 0, 0)
    assert not faults.is_inside_out


def look_at(thing: bpy.types.Object):
    """The faults of a mesh."""
    from kiriko.core.blender.checks.faults import counts_of

    return counts_of(thing.data)
