from pathlib import Path

import bpy
import numpy as np
import pytest

from small_rigs import cube, inventory, new_object, primitive, small_rig

ROOT = Path(__file__).resolve().parent.parent.parent
BLEND = ROOT / "assets" / "kiriko_plate.blend"
NAMES = {"crossed": "Kiriko Plate", "holes": "Kiriko Plate DCRA", "radial": "Kiriko Plate Radial"}


def plane(name: str = "Mine", size: float = 0.5) -> bpy.types.Object:
    """A flat mesh, active and selected."""
    thing = new_object(primitive("grid", x_segments=2, y_segments=2, size=size))
    thing.name = name
    thing.select_set(True)
    bpy.context.view_layer.objects.active = thing
    return thing


def group_of(material: bpy.types.Material) -> bpy.types.Node:
    (group,) = (node for node in material.node_tree.nodes if node.type == "GROUP")
    return group


def test_assets_open_with_pictures(scene):
    """Every Blender finds three materials marked as assets, each
    described, in the catalogue, with a picture.
    """
    with bpy.data.libraries.load(str(BLEND), assets_only=True) as (found, wanted):
        assert set(found.materials) == set(NAMES.values())
        wanted.materials = list(found.materials)

    catalogue = (BLEND.parent / "blender_assets.cats.txt").read_text(encoding="utf-8")
    for material in wanted.materials:
        asset = material.asset_data
        assert f"{asset.catalog_id}:" in catalogue
        assert len(asset.description) > 40
        assert "Kiriko" in asset.tags
        picture = np.empty((128 * 128, 4), np.float32)
        assert tuple(material.preview.image_size) == (128, 128)
        material.preview.image_pixels_float.foreach_get(picture.ravel())
        assert picture[:, :3].max() > 0.6  # the mid-air image
        assert np.ptp(picture[:, :3].max(axis=1) - picture[:, :3].min(axis=1)) > 0.5  # in colours


def test_assets_are_what_the_code_makes(scene):
    """The groups in the file have the nodes and inputs that `plate_material.py` builds."""
    from kiriko.core.blender.materials.plate_material import plate_group

    with bpy.data.libraries.load(str(BLEND)) as (_, wanted):
        wanted.materials = list(NAMES.values())
    for layout, material in zip(NAMES, wanted.materials, strict=True):
        stored = group_of(material).node_tree
        made = plate_group(layout)
        for tree in (stored, made):
            tree.name = layout  # Blender adds a number to one of them
        assert described(stored) == described(made)


def described(tree: bpy.types.NodeTree) -> tuple[list[object], ...]:
    """The contents of a node group: inputs with their
    ranges and words, nodes with their numbers, links.
    """
    sockets = [
        item
        for item in tree.interface.items_tree
        if item.item_type == "SOCKET" and item.in_out == "INPUT"
    ]
    order = {node: n for n, node in enumerate(tree.nodes)}
    numbers = [
        (
            node.bl_idname,
            getattr(node, "operation", ""),
            *(plain(s.default_value) for s in node.inputs if s.type in KINDS),
        )
        for node in tree.nodes
    ]
    links = [
        (order[x.from_node], x.from_socket.name, order[x.to_node], x.to_socket.identifier)
        for x in tree.links
    ]

    return (
        [
            (s.name, s.subtype, s.default_value, s.min_value, s.max_value, s.description)
            for s in sockets
        ],
        numbers,
        sorted(links),
    )


KINDS = {"VALUE", "VECTOR"}


def plain(value: object) -> object:
    return value if isinstance(value, float) else tuple(value)


@pytest.mark.every_blender
@pytest.mark.parametrize("layout", NAMES)
def test_active_mesh_gets_the_material(scene, layout):
    """It takes the active slot of the selected mesh, once
    appended is used again, and is no asset of this file.
    """
    first = plane("First")
    second = plane("Second")
    other = bpy.data.materials.new("Other")
    second.data.materials.append(other)
    second.data.materials.append(other)
    second.active_material_index = 1
    for thing in (first, second):
        bpy.context.view_layer.objects.active = thing
        assert bpy.ops.kiriko.add_plate_material(layout=layout) == {"FINISHED"}

    material = first.active_material
    assert material.name == NAMES[layout]
    assert [slot.material for slot in first.material_slots] == [material]
    assert [slot.material for slot in second.material_slots] == [other, material]
    assert material.asset_data is None
    assert not material.use_fake_user
    assert len(bpy.data.node_groups) == 1
    assert not bpy.data.libraries or not any(block.library for block in bpy.data.materials)


def test_own_changes_and_namesakes_are_left_alone(scene):
    """A renamed, edited plate material is used again as it is.

    Another material of its first name is not taken.
    """
    namesake = bpy.data.materials.new("Kiriko Plate")
    bpy.ops.kiriko.add_plate_material()
    material = bpy.context.object.active_material
    assert material != namesake
    material.name = "My Plate"
    group_of(material).inputs["Stray 1"].default_value = 0.0
    thing = plane()
    bpy.ops.kiriko.add_plate_material()
    assert thing.active_material == material
    assert group_of(material).inputs["Stray 1"].default_value == 0.0


@pytest.mark.parametrize("metres", [1.0, 0.001])
def test_without_a_selected_mesh_a_plane_is_made(scene, metres):
    """A plane of 488 mm at the cursor, selected; its pitch is
    0.5 mm whatever the unit; an unselected mesh stays.
    """
    scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", metres
    mine = plane()
    mine.select_set(False)
    scene.cursor.location = (1, 2, 3)

    assert bpy.ops.kiriko.add_plate_material() == {"FINISHED"}
    made = bpy.context.object
    assert made != mine
    assert not mine.material_slots
    assert made.select_get()
    assert tuple(made.location) == (1, 2, 3)
    assert made.dimensions.x * metres == pytest.approx(0.488, rel=1e-6)
    assert group_of(made.active_material).inputs["Pitch"].default_value * metres == pytest.approx(
        0.5e-3, rel=1e-6
    )
    assert group_of(made.active_material).inputs["Height"].default_value * metres == pytest.approx(
        1.25e-3, rel=1e-6
    )


def test_what_is_no_plate_is_refused(scene):
    """A cube and a mesh without faces: one sentence each, and nothing is appended or changed."""
    for thing, words in (
        (cube(), "is not flat"),
        (new_object(bpy.data.meshes.new("Empty")), "has no faces"),
    ):
        thing.select_set(True)
        bpy.context.view_layer.objects.active = thing
        before = inventory()
        with pytest.raises(RuntimeError, match=words):
            bpy.ops.kiriko.add_plate_material()
        assert inventory() == before
        assert not thing.material_slots


def test_missing_file_is_told(scene, kiriko, monkeypatch):
    """Without the extension's own file both buttons say so in one sentence, and nothing is made."""
    monkeypatch.setattr(kiriko.operators.preset, "FILE", Path("/nowhere/plate.blend"))
    before = inventory()
    for button in (bpy.ops.kiriko.add_plate_material, bpy.ops.kiriko.add_asset_library):
        with pytest.raises(RuntimeError, match="install Kiriko again"):
            button()
    assert inventory() == before
    assert "Kiriko" not in bpy.context.preferences.filepaths.asset_libraries


def test_asset_library_is_added_once_and_only_when_asked(scene, kiriko, capfd):
    """It is not there before; the button adds the folder and is
    grey from then on; the folder has the materials.
    """
    libraries = bpy.context.preferences.filepaths.asset_libraries
    assert kiriko.operators.preset.library_path() == ""
    n_before = len(libraries)
    capfd.readouterr()

    assert bpy.ops.kiriko.add_asset_library() == {"FINISHED"}
    page = "Asset Libraries" if bpy.app.version >= (5, 2, 0) else "File Paths"
    assert f"is in Preferences > {page}: " in capfd.readouterr().out
    assert len(libraries) == n_before + 1
    assert Path(libraries["Kiriko"].path).resolve() == BLEND.parent

    with pytest.raises(RuntimeError, match="already"):
        bpy.ops.kiriko.add_asset_library()
    libraries.remove(libraries["Kiriko"])
    assert bpy.ops.kiriko.add_asset_library.poll()


def test_a_plate_of_a_rig_gets_the_mirrors_of_its_settings(scene):
    """Its model, pitch and the rest in a material of its own.

    An ideal plate gets that of the file.
    """
    thing = small_rig()["PLATE"]
    bpy.ops.object.select_all(action="DESELECT")
    thing.select_set(True)
    bpy.context.view_layer.objects.active = thing
    bpy.ops.kiriko.add_plate_material()

    assert thing.active_material.name == "Kiriko Plate"
    ours = thing.kiriko.plate
    ours.model = "CROSSED"
    ours.pitch = 2.0
    ours.height = 3.0
    ours.phase = (0.25, -0.5)
    ours.fresnel = False
    bpy.ops.kiriko.add_plate_material(layout="holes")

    assert thing.active_material != bpy.data.materials["Kiriko Plate"]
    inputs = group_of(thing.active_material).inputs
    found = {
        name: inputs[name].default_value
        for name in ("Pitch", "Height", "Phase 1", "Phase 2", "Fresnel")
    }

    assert found == pytest.approx(
        {"Pitch": 0.002, "Height": 0.006, "Phase 1": 0.25, "Phase 2": -0.5, "Fresnel": 0.0}
    )
    assert "Crossing Error" in inputs  # of crossed layers, whatever the button would have made
