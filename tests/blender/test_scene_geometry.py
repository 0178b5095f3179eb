from collections.abc import Callable
from typing import Any

import bmesh
import bpy
import numpy as np
import pytest
from mathutils import Matrix

# Blender stores and composes matrices in float32: relative error of a few roundings
SINGLE = 2.0**-22


def add(data: bpy.types.ID | None, role: str = "NONE", name: str = "thing") -> bpy.types.Object:
    """A new object in the scene, with a role."""
    thing = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(thing)
    thing.kiriko.role = role
    return thing


def shape(make: Callable[..., Any], **sizes: Any) -> bpy.types.Mesh:
    """A mesh of a bmesh primitive."""
    mesh = bpy.data.meshes.new("mesh")
    built = bmesh.new()
    make(built, **sizes)
    built.to_mesh(mesh)
    built.free()
    return mesh


def cube(size: float = 2.0) -> bpy.types.Mesh:
    return shape(bmesh.ops.create_cube, size=size)


def ball(segments: int = 24) -> bpy.types.Mesh:
    mesh = shape(
        bmesh.ops.create_uvsphere, u_segments=segments, v_segments=segments // 2, radius=1.0
    )
    mesh.polygons.foreach_set("use_smooth", np.ones(len(mesh.polygons), bool))
    return mesh


def volume(mesh: Any) -> float:
    a, b, c = np.moveaxis(mesh.corners, 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def plane_normals(mesh: Any) -> np.ndarray:
    a, b, c = np.moveaxis(mesh.corners, 1, 0)
    normals = np.cross(b - a, c - a)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def assert_same_points(found: np.ndarray, wanted: np.ndarray, tolerance: float) -> None:
    """Each point of one set is in the other, however they are ordered."""
    apart = np.linalg.norm(found[:, None] - wanted[None], axis=2)
    assert apart.min(axis=0).max() < tolerance
    assert apart.min(axis=1).max() < tolerance


CORNERS = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T.astype(float)


def node_group(build: Callable[[Any, Any, Any], None]) -> bpy.types.NodeTree:
    """A geometry node group; `build` gets the tree, the
    geometry that comes in and the socket that goes out.
    """
    tree = bpy.data.node_groups.new("nodes", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    build(
        tree,
        tree.nodes.new("NodeGroupInput").outputs[0],
        tree.nodes.new("NodeGroupOutput").inputs[0],
    )
    return tree


def test_modifier_and_mirroring_parent(read):
    """Vertices of an arrayed cube under a parent of scale
    (2, -3, 0.5) are where the formulas put them.
    """
    parent = add(None, name="parent")
    parent.scale = (2.0, -3.0, 0.5)
    parent.location = (10.0, 20.0, 30.0)
    glass = add(cube(), "GLASS")
    glass.parent = parent
    glass.location = (1.0, 0.0, 0.0)
    array = glass.modifiers.new("array", "ARRAY")
    array.count = 3
    array.use_relative_offset = False
    array.use_constant_offset = True
    array.constant_offset_displace = (0.0, 4.0, 0.0)
    mesh = read().rig.glasses[0].mesh
    local = np.concatenate([CORNERS + np.array([1, 4 * k, 0]) for k in range(3)])

    assert len(mesh.triangles) == 36
    assert_same_points(mesh.vertices, local * [2, -3, 0.5] + [10, 20, 30], 64 * SINGLE)
    assert volume(mesh) == pytest.approx(3 * 8 * 3, rel=1e-6)


@pytest.mark.parametrize("signs", CORNERS.astype(int).tolist())
def test_outside_stays_outside(read, signs):
    """Whatever axes are mirrored, triangles and corner normals face out.

    The volume is |det| times the local one.
    """
    glass = add(ball(), "GLASS")
    plain = volume(read().rig.glasses[0].mesh)
    scale = np.array([1.0, 2.0, 0.5]) * signs
    glass.scale = scale
    glass.rotation_euler = (0.3, 0.2, 0.1)
    glass.location = (1.0, 2.0, 3.0)
    mesh = read().rig.glasses[0].mesh
    assert volume(mesh) == pytest.approx(plain, rel=1e-5)  # |1 x 2 x 0.5| = 1; float32 rotation
    assert (np.einsum("tcj,tj->tc", mesh.corner_normals, plane_normals(mesh)) > 0.8).all()


def test_normals_of_a_squeezed_ball(read):
    """Corner normals of a unit ball scaled to an ellipsoid are the gradient of its quadric."""
    glass = add(ball(64), "GLASS")
    glass.scale = radii = np.array([1.0, 3.0, -0.5])
    mesh = read().rig.glasses[0].mesh
    gradient = mesh.corners / radii**2
    gradient /= np.linalg.norm(gradient, axis=2, keepdims=True)
    local = mesh.corners / radii
    # Blender's vertex normals of the coarse ball are off the radius
    # by up to 1e-3; the squeeze magnifies that 6 times
    away_from_poles = (np.abs(local[..., 2]) < 0.9).all(axis=1)
    assert np.abs(mesh.corner_normals - gradient)[away_from_poles].max() < 6e-3
    assert np.allclose(np.linalg.norm(mesh.corner_normals, axis=2), 1.0, atol=1e-14)


@pytest.mark.parametrize("shading", ["smooth", "flat", "sharp edges", "mixed", "custom"])
def test_shading(read, shading):
    """Normals on smooth triangles are Blender's own corner
    normals, carried over by the inverse transpose.
    """
    data = ball(12)
    if shading == "flat":
        data.polygons.foreach_set("use_smooth", np.zeros(len(data.polygons), bool))
    elif shading == "sharp edges":
        data.edges.foreach_set("use_edge_sharp", np.arange(len(data.edges)) % 3 == 0)
    elif shading == "mixed":
        data.polygons.foreach_set("use_smooth", np.arange(len(data.polygons)) % 2 == 0)
    elif shading == "custom":
        rng = np.random.default_rng(5)
        tilted = np.array([v.normal for v in data.vertices]) + 0.2 * rng.standard_normal(
            (len(data.vertices), 3)
        )
        data.normals_split_custom_set_from_vertices(
            tilted / np.linalg.norm(tilted, axis=1, keepdims=True)
        )

    glass = add(data, "GLASS")
    glass.scale = (1.0, 2.0, -3.0)
    glass.rotation_euler = (0.5, 0.6, 0.7)
    mesh = read().rig.glasses[0].mesh

    evaluated = glass.evaluated_get(bpy.context.evaluated_depsgraph_get())
    blender = evaluated.to_mesh()
    blender.calc_loop_triangles()
    carry = evaluated.matrix_world.to_3x3().inverted().transposed()
    is_smooth = np.array(
        [blender.polygons[t.polygon_index].use_smooth for t in blender.loop_triangles]
    )
    normals = np.array(
        [
            [(carry @ blender.corner_normals[k].vector).normalized() for k in t.loops]
            for t in blender.loop_triangles
        ]
    )

    if shading == "flat":
        assert mesh.is_smooth is None
        assert mesh.corner_normals is None
        return

    assert np.array_equal(mesh.is_smooth, is_smooth)
    # the scale is negative: corners run the other way round
    # mathutils works in float32
    assert np.abs(mesh.corner_normals - normals[:, ::-1])[is_smooth].max() < 2e-6


def test_collection_instances(read):
    """Each instance of a collection is a part of its own,
    placed by empty, collection offset and member.
    """
    collection = bpy.data.collections.new("set")
    member = bpy.data.objects.new("stone", cube())
    member.location = (0.0, 0.0, 5.0)
    member.kiriko.role = "GLASS"
    member.kiriko.priority = 3
    collection.objects.link(member)
    collection.instance_offset = (1.0, 0.0, 0.0)

    for k in range(2):
        empty = add(None, name=f"empty {k}")
        empty.instance_type, empty.instance_collection = "COLLECTION", collection
        empty.location = (10.0 * k, 0.0, 0.0)
        empty.scale = (1.0, 1.0, -1.0)

    glasses = read().rig.glasses
    assert [g.name for g in glasses] == ["stone (instance 1)", "stone (instance 2)"]
    assert [g.priority for g in glasses] == [3, 3]
    for k, glass in enumerate(glasses):
        assert_same_points(
            glass.mesh.vertices, CORNERS + np.array([10 * k - 1, 0, -5]), 64 * SINGLE
        )
        assert volume(glass.mesh) == pytest.approx(8.0)


def test_role_of_an_instancing_empty(read):
    """Members without a role take that of the empty that
    instances their collection, nested ones too.
    """
    inner = bpy.data.collections.new("inner")
    outer = bpy.data.collections.new("outer")
    inner.objects.link(bpy.data.objects.new("stone", cube()))
    between = bpy.data.objects.new("between", None)
    between.instance_type = "COLLECTION"
    between.instance_collection = inner
    between.location = (1.0, 2.0, 3.0)
    outer.objects.link(between)
    empty = add(None, "GLASS", "empty")
    empty.instance_type = "COLLECTION"
    empty.instance_collection = outer
    empty.location = (0.0, 0.0, 4.0)
    (glass,) = read().rig.glasses
    assert_same_points(glass.mesh.vertices, CORNERS + np.array([1, 2, 7]), 64 * SINGLE)


def test_instances_of_geometry_nodes(read):
    """Cubes that nodes instance on the points of a glass are
    glass, and its own emptied mesh is no error.
    """

    def build(tree: Any, geometry: Any, out: Any) -> None:
        points = tree.nodes.new("GeometryNodeInstanceOnPoints")
        box = tree.nodes.new("GeometryNodeMeshCube")
        box.inputs["Size"].default_value = (0.5, 0.5, 0.5)
        tree.links.new(geometry, points.inputs["Points"])
        tree.links.new(box.outputs["Mesh"], points.inputs["Instance"])
        tree.links.new(points.outputs["Instances"], out)

    host = add(cube(), "GLASS", "host")
    host.modifiers.new("nodes", "NODES").node_group = node_group(build)
    rig = read().rig
    assert len(rig.glasses) == 8
    assert len({g.name for g in rig.glasses}) == 8

    for glass in rig.glasses:
        glass.mesh.check(glass.name)
    centres = np.array([g.mesh.vertices.mean(axis=0) for g in rig.glasses])
    assert_same_points(centres, CORNERS, 1e-6)


def test_surfaces_that_are_no_meshes(read):
    """A bevelled curve, a text and a family of metaballs are each read once, closed and
    facing out.
    """
    ring = bpy.data.curves.new("ring", "CURVE")
    ring.dimensions = "3D"
    ring.bevel_depth = 0.1
    ring.bevel_resolution = 16
    spline = ring.splines.new("POLY")
    turn = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    spline.points.add(63)
    spline.points.foreach_set(
        "co", np.stack([np.cos(turn), np.sin(turn), 0 * turn, 0 * turn + 1], axis=1).ravel()
    )
    spline.use_cyclic_u = True
    add(ring, "GLASS", "ring")
    text = bpy.data.curves.new("text", "FONT")
    text.body, text.extrude = "I", 0.2
    add(text, "GLASS", "text").scale = (1.0, -1.0, 1.0)
    drop = bpy.data.metaballs.new("drop")
    drop.elements.new().radius = 2.0
    add(drop, "GLASS", "drop")
    add(drop.copy(), "GLASS", "drop.001").location.x = 2.0
    reading = read()

    assert any(
        "The metaball 'drop.001' belongs to another one's family" in note for note in reading.notes
    )
    glasses = {g.name: g.mesh for g in reading.rig.glasses}
    assert sorted(glasses) == ["drop", "ring", "text"]

    # polygons of 64 and 34 corners
    assert volume(glasses["ring"]) == pytest.approx(2 * np.pi**2 * 0.01, rel=0.02)
    assert volume(glasses["text"]) > 0
    assert volume(glasses["drop"]) > 0


def test_unit_scale(read, scene):
    """A file in millimetres is read in metres.

    Without a unit system a unit is a metre, as in Blender.
    """
    add(cube(), "GLASS").location = (5.0, 0.0, 0.0)
    units = scene.unit_settings
    units.system, units.scale_length = "METRIC", 0.001
    assert_same_points(
        read().rig.glasses[0].mesh.vertices, (CORNERS + np.array([5, 0, 0])) * 1e-3, 1e-9
    )
    units.system = "NONE"
    assert_same_points(read().rig.glasses[0].mesh.vertices, CORNERS + np.array([5, 0, 0]), 1e-6)


def test_numbers_are_exact(read):
    """Without a turn, world coordinates are the float32 numbers of
    mesh and matrix added in float64, bit for bit.
    """
    data = ball()
    glass = add(data, "GLASS")
    glass.location = (1000.1, 0.1, -3.7)
    mesh = read().rig.glasses[0].mesh
    local = np.array([v.co for v in data.vertices], dtype=float)
    assert mesh.vertices.dtype == float
    assert np.array_equal(mesh.vertices, local + np.array(glass.location, dtype=float))


def test_driver_and_animation(read, scene):
    """A keyed location and a driven override are read as they are at the current frame."""
    glass = add(cube(), "GLASS")
    for frame, x in ((1, 0.0), (11, 10.0)):
        glass.location.x = x
        glass.keyframe_insert("location", index=0, frame=frame)

    glass.driver_add("location", 1).driver.expression = "frame * 2"
    glass.kiriko.use_ior = True
    glass.driver_add("kiriko.ior").driver.expression = "1.5 + frame / 100"
    for frame in (1, 11):
        scene.frame_set(frame)
        (found,) = read().rig.glasses
        assert found.mesh.vertices.mean(axis=0) == pytest.approx(
            [frame - 1, frame * 2, 0], abs=1e-5
        )
        assert found.ior.at(5e-7) == pytest.approx(1.5 + frame / 100, rel=1e-6)


def test_mesh_in_edit_mode(read):
    """A glass in edit mode is read as it is being edited."""
    glass = add(cube(), "GLASS")
    bpy.context.view_layer.objects.active = glass
    bpy.ops.object.mode_set(mode="EDIT")
    editing = bmesh.from_edit_mesh(glass.data)
    for vertex in editing.verts:
        vertex.co *= 2
    bmesh.update_edit_mesh(glass.data)
    mesh = read().rig.glasses[0].mesh
    bpy.ops.object.mode_set(mode="OBJECT")
    assert volume(mesh) == pytest.approx(64.0)


def test_triangles_without_area(read):
    """Triangles on a line are left out and counted; the others keep their normals and places."""
    data = bpy.data.meshes.new("slivers")
    points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0.5, 0, 0), (0.5, 0.5, 0)]
    data.from_pydata(points, [], [(0, 1, 2), (0, 1, 3), (2, 4, 1)])
    data.polygons.foreach_set("use_smooth", np.ones(3, bool))
    glass = add(data, "GLASS", "shard")
    glass.rotation_euler = (0.1, 0.2, 0.3)
    glass.scale = (0.3, 0.7, 1.3)
    reading = read()
    mesh = reading.rig.glasses[0].mesh

    assert mesh.triangles.tolist() == [[0, 1, 2]]
    assert mesh.corner_normals.shape == (1, 3, 3)
    assert mesh.is_smooth.shape == (1,)
    assert "Kiriko ignores 2 zero-area triangles of 'shard'." in reading.notes


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: bpy.data.meshes.new("m"), "no faces"),
        (lambda: bpy.data.curves.new("c", "CURVE"), "no faces"),
        (ball, "no faces"),
        (lambda: with_vertex(np.nan), "not finite"),
        (lambda: with_vertex(np.inf), "not finite"),
    ],
    ids=["no mesh", "no curve", "scaled to nothing", "NaN", "infinite"],
)
def test_what_is_no_glass_gets_through_to_the_check(read, errors, make, words):
    """Its role and name are there, so that the check can say which it is."""
    thing = add(make(), "GLASS", "hollow")
    if words == "no faces":
        thing.scale = (0.0, 0.0, 0.0)
    (glass,) = read().rig.glasses
    with pytest.raises(errors.MeshError, match=f"'hollow'.*{words}"):
        glass.mesh.check(f"The glass '{glass.name}'")


def with_vertex(bad: float) -> bpy.types.Mesh:
    """A cube, the first vertex of which is no number."""
    data = cube()
    places = np.r_[np.full(3, bad), np.zeros(21)].astype(np.float32)
    data.attributes["position"].data.foreach_set("vector", places)
    return data


@pytest.mark.parametrize("way", ["viewport", "eye", "render", "collection", "excluded"])
def test_hidden_parts_are_left_out(read, scene, way):
    """An object hidden in viewport or render is no part of the rig, and a note says so."""
    thing = add(cube(), "BLOCKER", "screen")
    add(cube(), "GLASS", "stone")
    if way == "viewport":
        thing.hide_viewport = True
    elif way == "eye":
        bpy.context.view_layer.update()
        thing.hide_set(True)
    elif way == "render":
        thing.hide_render = True
    else:
        collection = bpy.data.collections.new("drawer")
        scene.collection.children.link(collection)
        scene.collection.objects.unlink(thing)
        collection.objects.link(thing)
        collection.hide_render = way == "collection"
        bpy.context.view_layer.layer_collection.children[0].exclude = way == "excluded"

    reading = read()
    assert not reading.rig.blockers
    assert len(reading.rig.glasses) == 1
    assert len(reading.notes) == 2  # the other is on the glass without material
    assert "'screen' is hidden" in reading.notes[0]


def test_render_levels_are_noted(read):
    """A glass that is finer in renders than in the
    viewport is read as in the viewport, with a note.
    """
    glass = add(cube(), "GLASS", "stone")
    modifier = glass.modifiers.new("fine", "SUBSURF")
    modifier.levels, modifier.render_levels = 1, 3
    reading = read()
    assert len(reading.rig.glasses[0].mesh.triangles) == 48
    assert any("'stone' has different modifiers" in note for note in reading.notes)
    modifier.render_levels = 1
    assert not any("different modifiers" in note for note in read().notes)


def test_display_size_and_uv(read, scene):
    """A turned, scaled rectangle has the size of its UV square, a
    skewed or bent one has none; UV keeps to corners.
    """
    data = shape(bmesh.ops.create_grid, x_segments=2, y_segments=3, size=0.5)
    uv = data.uv_layers.new(name="map")
    for loop in data.loops:
        x, y, _ = data.vertices[loop.vertex_index].co
        uv.data[loop.index].uv = (0.25 + x / 2, 0.5 + y)  # half of the UV square's width

    data.uv_layers.new(name="other")
    data.uv_layers.active = data.uv_layers["other"]
    display = add(data, "DISPLAY")
    display.kiriko.resolution = (640, 480)
    display.scale = (0.3, -0.2, 1.0)
    display.rotation_euler = (1.0, 0.5, 0.2)
    display.location = (4.0, 5.0, 6.0)
    reading = read()
    found = reading.rig.display

    assert (found.width, found.height) == (640, 480)
    assert reading.display_size == pytest.approx((0.6, 0.2), rel=1e-6)
    bpy.context.view_layer.update()
    local = (
        np.linalg.inv(np.array(display.matrix_world)) @ np.c_[found.mesh.vertices, np.ones(12)].T
    ).T[:, :2]
    wanted = np.stack([0.25 + local[:, 0] / 2, 0.5 + local[:, 1]], axis=1)[found.mesh.triangles]

    assert np.abs(found.mesh.uv - wanted).max() < 1e-5
    data.vertices[0].co.z = 0.1
    assert read().display_size is None
    data.vertices[0].co.z = 0.0
    for vertex in data.vertices:
        vertex.co.x += 0.2 * vertex.co.y

    assert read().display_size is None


def test_roles_in_their_places(read):
    """Each role fills its own tuple of the rig.

    Only glass and mirrors carry normals, only displays carry UV.
    """
    for role in ("GLASS", "PLATE", "MIRROR", "DISPLAY", "BLOCKER", "NONE"):
        data = ball()
        data.uv_layers.new(name="map")
        add(data, role, role.lower())

    rig = read().rig
    groups = (rig.glasses, rig.plates, rig.mirrors, rig.displays, rig.blockers)
    assert [[part.name for part in group] for group in groups] == [
        ["glass"],
        ["plate"],
        ["mirror"],
        ["display"],
        ["blocker"],
    ]
    assert [group[0].mesh.corner_normals is not None for group in groups] == [
        True,
        False,
        True,
        False,
        False,
    ]
    assert [group[0].mesh.uv is not None for group in groups] == [False, False, False, True, False]


def test_reading_leaves_nothing_behind(read):
    """Reading makes no datablocks and gives the same numbers again."""
    add(ball(), "GLASS").matrix_world = Matrix.Rotation(0.3, 4, "X")
    first = read()
    before = {
        name: len(getattr(bpy.data, name)) for name in ("meshes", "objects", "materials", "images")
    }
    second = read()
    assert before == {name: len(getattr(bpy.data, name)) for name in before}
    for name in ("vertices", "triangles", "corner_normals", "is_smooth"):
        assert np.array_equal(
            getattr(first.rig.glasses[0].mesh, name), getattr(second.rig.glasses[0].mesh, name)
        )
