"""The plate's node group in Cycles against the tracer: the same rays, class by class."""

from dataclasses import replace
from types import ModuleType
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix, Vector

from small_rigs import inventory, small_rig

SIDE = 0.488  # m, of the plate
WIDE = 4.0  # m, of a display that catches all light of a class
PIXELS = 192
POSES = {  # of the plate, and the side of it that the viewer is on
    "front": (Matrix.LocRotScale(None, None, (0.5 * SIDE, 0.5 * SIDE, 1.0)), 1),
    "back": (Matrix.LocRotScale(None, None, (0.5 * SIDE, 0.45 * SIDE, 1.0)), -1),
    "turned": (
        Matrix.LocRotScale(
            (0.3, -0.2, 0.4), Euler((0.5, -0.7, 2.0)), (0.45 * SIDE, 0.5 * SIDE, 2.0)
        ),
        1,
    ),
    "mirrored": (
        Matrix.LocRotScale(
            (-0.2, 0.1, 0.2), Euler((0.3, 0.4, 0.5)), (-0.5 * SIDE, 0.5 * SIDE, 1.0)
        ),
        -1,
    ),
}
LIGHT = {
    "IMAGED": "Image",
    "STRAY_1": "Stray 1",
    "STRAY_2": "Stray 2",
    "THROUGH": "Through",
    "REFLECTED": "Reflected",
}
LAYOUTS = {  # values that differ from the defaults, and from one another
    "crossed": {"phase": (0.3, -1.2), "crossing_error": 0.01, "reflectance": 0.8, "ior": 1.6},
    "holes": {"phase": (0.1, 0.2), "pitch": 0.4e-3, "height": 0.9e-3},
    "radial": {"phase": (-0.4, 0.7), "has_fresnel": False},
}
# float32: u and v, 0..1 over 4 m, are off by 0.24 um,
# directions by a few times 2^-24 over up to 2 m
SINGLE = 3e-6  # m
# a place rounded to float32 may be on the other side of a
# mirror: 3e-8 m of 5e-4 m, four times a ray
AGREE = 0.999


def plane(role: str, matrix: Matrix) -> bpy.types.Object:
    """A plane of 2 m with UV, in its place."""
    bpy.ops.mesh.primitive_plane_add(size=2)
    thing = bpy.context.object
    thing.matrix_world, thing.kiriko.role = matrix, role
    return thing


def facing(position: Vector, target: Vector, half: float = 1.0) -> Matrix:
    """Where a thing stands whose z axis shows away from a target."""
    turn = (position - target).to_track_quat("Z", "Y")
    return Matrix.LocRotScale(position, turn, (half, half, 1.0))


def bench(pose: str, display_is_behind: bool = True) -> bpy.types.Object:
    """A plate, a viewer that looks at it askew, and a
    display that faces it from behind or in front.
    """
    matrix, side = POSES[pose]
    scene = bpy.context.scene
    plate = plane("PLATE", matrix)
    centre, turn, _ = matrix.decompose()
    eye = centre + turn @ Vector((0.35, -0.6, 0.7 * side))
    across = turn @ Vector((0.0, 0.0, 0.3 if display_is_behind else -1.2)) * side
    plane("DISPLAY", facing(centre - across, centre - 2 * across, 0.5 * WIDE))
    scene.camera = viewer = bpy.data.objects.new("Viewer", bpy.data.cameras.new("Viewer"))
    scene.collection.objects.link(viewer)
    viewer.matrix_world = facing(eye, centre)
    viewer.data.angle = 0.2
    scene.render.resolution_x = scene.render.resolution_y = PIXELS
    scene.render.resolution_percentage = 100

    return plate


def read(core: ModuleType, plate: bpy.types.Object, array: Any, axis: int = 0) -> Any:
    """The scene's rig, with an array of mirrors that stands by one of the plate object's
    own axes.
    """
    bpy.context.view_layer.update()
    reading = core.blender.read.scene.read(bpy.context)
    side, centre = (
        np.array(v, float)
        for v in (plate.matrix_world.col[axis].xyz, plate.matrix_world.translation)
    )
    own = replace(reading.rig.plates[0], array=array, side=side, centre=centre)

    # a rig needs glass and a picture: here far away, and no object of the scene
    shard = core.rig.rig.Mesh(
        100.0 + np.eye(4, 3), np.array([[0, 3, 1], [1, 3, 2], [2, 3, 0], [0, 1, 2]])
    )
    needed = {
        "glasses": (core.rig.rig.Glass("Shard", shard),),
        "pictures": (core.rig.rig.Picture("", np.ones((1, 1, 4))),),
    }
    rig = replace(reading.rig, plates=(own,), **needed)

    return replace(reading, rig=rig, drawn=rig)


def preview(core: ModuleType, reading: Any, **options: Any) -> Any:
    """A preview that shows the display's coordinates, one sample a pixel."""
    options = {"samples": 1, "filter_width": 0.01, **options}
    return core.blender.preview.cycles_preview.Preview(bpy.context.scene, reading, None, **options)


def plate_group(scene: bpy.types.Scene) -> Any:
    """The one node of the scene's materials that is a mirror array."""
    materials = {slot.material for thing in scene.objects for slot in thing.material_slots}
    (found,) = (
        node for material in materials for node in material.node_tree.nodes if node.type == "GROUP"
    )
    return found


def show_only(scene: bpy.types.Scene, *light: str) -> None:
    """Switch off the plate's other light."""
    for name in LIGHT.values():
        plate_group(scene).inputs[name].default_value = float(name in light)


def rays(shown: Any, viewer: Any) -> tuple[np.ndarray, np.ndarray]:
    """Origins and directions (n, 3) of the rays of its pixels,
    by where Cycles says that they meet the plate.

    Cycles jitters them within 0.01 px, which is more than
    float32 blurs: the tracer has to take the same rays.
    """
    group = plate_group(shown.scene)
    tree = group.id_data
    (output,) = (node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
    geometry = tree.nodes.new("ShaderNodeNewGeometry")
    emission = tree.nodes.new("ShaderNodeEmission")
    tree.links.new(geometry.outputs["Position"], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    met = shown.render()[..., :3].reshape(-1, 3).astype(float)
    tree.links.new(group.outputs[0], output.inputs["Surface"])
    directions = met - viewer.position
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return np.broadcast_to(viewer.position, met.shape).copy(), directions


def assert_agree(core: ModuleType, reading: Any, light: str) -> None:
    """Each ray is of the same class, lands at the same point and
    is as bright in Cycles as it is for the tracer.
    """
    rig = reading.rig
    with preview(core, reading) as shown:
        origins, directions = rays(shown, rig.viewer)
        plan = core.light.compile_plan.compile_plan(
            rig, core.rig.settings.Settings(only_through_glass=False, brightness=True)
        )
        landings = core.light.trace.trace_all(plan, origins, directions, light=light)
        u, v = (landings.xy / [rig.display.width, rig.display.height]).T
        ours = np.stack([u, 1 - v], axis=1)
        n_arrived = 0
        for path, name in LIGHT.items():
            if (name == "Reflected") != (light == "reflected"):
                continue
            show_only(shown.scene, name)
            carried = shown.render()[..., :3].reshape(-1, 3).astype(float)
            is_seen = carried[:, 2] > 0
            is_ours = landings.has_arrived & (
                landings.plate_path == core.light.plate.PlatePath[path]
            )
            assert (is_seen == is_ours).mean() > AGREE
            both = is_seen & is_ours
            n_arrived += both.sum()
            throughput = carried[both, 2:]
            apart = WIDE * np.abs(carried[both, :2] / throughput - ours[both]).max(axis=1)
            # between two rings the place of the mirrors jumps, near
            # the centre their direction turns fast
            assert (
                np.quantile(apart, 0.998) if rig.plates[0].array.layout == "radial" else apart.max()
            ) < SINGLE
            assert np.abs(throughput[:, 0] / landings.throughput[both] - 1).max() < 1e-5
        assert n_arrived > AGREE * len(origins)


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("layout", LAYOUTS)
def test_light_beyond_the_plate_is_the_tracers(core, layout, pose):
    """Image, stray light and light that goes through: class, landing and
    throughput, on both sides, wherever it stands.
    """
    plate = bench(pose)
    assert_agree(
        core, read(core, plate, core.rig.rig.MirrorArray(layout, **LAYOUTS[layout])), "folded"
    )


@pytest.mark.parametrize("pose", POSES)
def test_reflected_light_is_the_tracers(core, pose):
    """Light that the face reflects comes from the face, half the
    thickness before the plane, with Fresnel's share.
    """
    plate = bench(pose, display_is_behind=False)
    assert_agree(core, read(core, plate, core.rig.rig.MirrorArray()), "reflected")


def test_plate_in_a_plane_across_its_x_axis(core):
    """Where the object's x axis stands upright on the
    plate, mirrors stand at 45 degrees to its y axis.
    """
    plate = bench("front")
    turn = Matrix.Rotation(np.pi / 2, 4, "Y")  # x shows where z did
    plate.data.transform(turn.inverted())
    plate.matrix_world = Matrix.Diagonal((0.5 * SIDE, 0.5 * SIDE, 1, 1)) @ turn
    assert_agree(core, read(core, plate, core.rig.rig.MirrorArray(), axis=1), "folded")


def test_all_light_is_the_sum_of_its_classes(core):
    """With everything on, Cycles' mean over 64 samples is the
    classes' sum, to four times its standard error.
    """
    plate = bench("front")
    bpy.context.scene.render.resolution_x = bpy.context.scene.render.resolution_y = 64
    # a third is reflected, and leaves no light here
    reading = read(core, plate, core.rig.rig.MirrorArray(ior=2.5))

    with preview(core, reading, samples=64) as shown:
        everything = shown.render()[..., 2]
        each = []
        for name in LIGHT.values():
            show_only(shown.scene, name)
            each.append(shown.render()[..., 2])

    whole = np.sum(each, axis=0)
    assert whole.min() > 0.1
    assert not each[-1].any()
    error = everything.mean() - whole.mean()
    scatter = (everything - whole).std() / everything.shape[0]

    assert abs(error) < 4 * scatter + 1e-6
    assert 0 < scatter < 0.01 * whole.mean()


def test_map_of_a_mirror_array_has_its_coordinates_undimmed(core):
    """render_map divides by the throughput: its third channel is 1
    where light arrives, and u, v are within 0..1.
    """
    plate = bench("front")
    found = core.blender.preview.cycles_preview.render_map(
        bpy.context.scene, read(core, plate, core.rig.rig.MirrorArray())
    )
    assert np.abs(found[..., 2] - 1).max() < 1e-6
    assert found[..., :2].min() > 0
    assert np.ptp(found[..., 0]) > 0.1


def test_preview_takes_the_mirrors_of_the_rig_and_leaves_nothing(core, scene):
    """The plate's numbers are in the group's inputs, in Blender units.

    Afterwards the file is as before.
    """
    scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", 0.001
    plate = small_rig()["PLATE"]
    before = inventory()
    array = core.rig.rig.MirrorArray(**LAYOUTS["crossed"])
    with preview(core, read(core, plate, array), fresnel=True) as shown:
        found = {socket.name: socket.default_value for socket in plate_group(shown.scene).inputs}

    assert found == pytest.approx(
        {
            **{
                "Pitch": 0.5,
                "Height": 1.25,
                "IOR": 1.6,
                "Reflectance": 0.8,
                "Crossing Error": 0.01,
                "Fresnel": 1.0,
            },
            **{"Phase 1": 0.3, "Phase 2": -0.2},
            **dict.fromkeys(LIGHT.values(), 1.0),
        }
    )
    assert inventory() == before
