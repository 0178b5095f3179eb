"""Products of the catalogue on objects: given by operators, told by values."""

import re

import bpy
import numpy as np
import pytest

from extension import loaded
from kiriko.core.rig.dispersion import WAVELENGTH
from small_rigs import small_rig
from test_ugly_glass import scatter

SINGLE = 1e-6  # m: float32's rounding of places and sizes
PHONE = (25.4 * np.array([2556, 1179]) / 460 / 1e3).tolist()  # m, by 460 pixels to the inch


def activate(thing: bpy.types.Object) -> bpy.types.Object:
    bpy.context.view_layer.objects.active = thing
    bpy.context.view_layer.update()
    return thing


def corners(thing: bpy.types.Object) -> np.ndarray:
    """Vertices (n, 3) in the world."""
    bpy.context.view_layer.update()
    return np.array([thing.matrix_world @ vertex.co for vertex in thing.data.vertices])


@pytest.mark.parametrize("is_upright", [False, True])
@pytest.mark.parametrize("unit", [1.0, 0.001])
def test_a_display_becomes_a_phone_in_its_place(scene, read, unit, is_upright):
    """Its middle stays, its sides and pixels are the phone's, lying or upright."""
    scene.unit_settings.scale_length = unit
    display = activate(small_rig()["DISPLAY"])
    middle = corners(display).mean(axis=0)
    assert bpy.ops.kiriko.display_preset(preset="iPhone 15", is_upright=is_upright) == {"FINISHED"}

    turn = -1 if is_upright else 1
    reading = read()
    assert reading.display_size == pytest.approx(PHONE[::turn], rel=1e-5)
    shown = reading.rig.display
    assert (shown.width, shown.height) == (2556, 1179)[::turn]
    assert corners(display).mean(axis=0) == pytest.approx(middle, abs=SINGLE / unit)


def test_what_add_rig_told_of_another_display_is_told_no_more(scene, capfd):
    """A result that was solved is told to be old instead, and stays."""
    bpy.ops.kiriko.add_rig(viewer_resolution=64, display_resolution=(64, 64))
    display = next(thing for thing in scene.objects if thing.kiriko.role == "DISPLAY")
    activate(display)
    assert "whole picture fits" in scene.kiriko.result.summary
    assert bpy.ops.kiriko.display_preset(preset="iPhone 15") == {"FINISHED"}
    assert re.search(r"is now iPhone 15 \([^)]*, 2556 x 1179 px\)\.", capfd.readouterr().out)
    assert scene.kiriko.result.summary == ""

    display.kiriko.resolution = (64, 64)
    assert bpy.ops.kiriko.solve() == {"FINISHED"}
    solved = scene.kiriko.result.summary
    assert solved
    assert bpy.ops.kiriko.display_preset(preset="iPhone 15 Plus") == {"FINISHED"}
    assert scene.kiriko.result.summary == solved


def test_an_object_shows_the_product_that_it_is(scene, drawn):
    """The menu's name is the product while all values are its own, and Custom after a change."""
    parts = small_rig()

    def shown(role: str) -> str:
        texts = drawn("object", "OBJECT_PT_kiriko", activate(parts[role])).labels
        return next(text for text in texts if text)

    activate(parts["PLATE"])
    bpy.ops.kiriko.plate_preset(preset="ASKA3D-200")
    assert shown("PLATE") == "ASKA3D-200"
    parts["PLATE"].scale *= 1.01
    assert shown("PLATE") == "Custom"

    activate(parts["DISPLAY"])
    bpy.ops.kiriko.display_preset(preset="iPad (2022)")
    assert shown("DISPLAY") == "iPad (2022)"
    parts["DISPLAY"].kiriko.resolution[0] -= 1
    assert shown("DISPLAY") == "Custom"

    activate(parts["GLASS"])
    bpy.ops.kiriko.glass_preset(preset="Water")
    assert shown("GLASS") == "Water"
    parts["GLASS"].kiriko.ior = 1.34
    assert shown("GLASS") == "Custom"


def test_light_is_set_and_told_in_the_panels(scene, drawn):
    """Picture and display have their settings; Details tell the luminance of white as seen."""
    parts = small_rig()
    tone = {"brightness", "gamma", "black_level"}
    shown = drawn("object", "OBJECT_PT_kiriko", activate(parts["PICTURE"])).props
    assert tone <= set(shown)

    display = activate(parts["DISPLAY"])
    assert "gamma" not in drawn("object", "OBJECT_PT_kiriko", display).props
    display.kiriko.display.encoding = "POWER"
    shown = drawn("object", "OBJECT_PT_kiriko", display).props
    assert {"white", "black_level", "encoding", "gamma"} <= set(shown)

    bpy.ops.kiriko.display_preset(preset="Dell U2723QE")
    display.kiriko.resolution = (64, 64)
    bpy.ops.kiriko.solve()
    shown = drawn("result_panel", "VIEW3D_PT_kiriko_details").texts
    assert "White is seen at about 400 cd/m\N{SUPERSCRIPT TWO}" in " ".join(shown)


def test_glass_of_its_own_gets_the_index_in_its_material(scene, read, capfd):
    """Then renders in Cycles have it, too; the override stays off."""
    glass = small_rig()["GLASS"]
    glass.kiriko.use_ior = False
    activate(glass)
    bpy.ops.kiriko.make_glass()
    bpy.ops.kiriko.glass_preset(preset="Lead Crystal (24 % PbO)")
    reading = read()
    assert reading.rig.glasses[0].ior.at(WAVELENGTH) == pytest.approx(1.545, abs=1e-6)
    assert [m.source for m in reading.materials] == ["Glass BSDF"]
    assert not glass.kiriko.use_ior
    assert "is now Lead Crystal (24 % PbO) (IOR 1.545)." in capfd.readouterr().out


def test_make_it_glass_makes_the_product_that_is_chosen(scene, read, capfd):
    """Its index is in the material; the button and the report name it. Without a choice it is the
    product whose index the glass was solved with before, so that no result changes.
    """
    operator = bpy.ops.kiriko.make_glass.get_rna_type()
    products = loaded("core.rig.catalogue").GLASSES
    assert [item.identifier for item in operator.properties["product"].enum_items] == list(products)
    default = products[operator.properties["product"].default]

    glass = small_rig()["GLASS"]
    glass.kiriko.use_ior = False
    assert read().rig.glasses[0].ior.at(WAVELENGTH) == default.ior
    activate(glass)
    bpy.ops.kiriko.make_glass(product="Soda-Lime Glass")
    assert read().rig.glasses[0].ior.at(WAVELENGTH) == pytest.approx(1.5233, abs=1e-6)
    assert "Soda-Lime Glass" in capfd.readouterr().out

    findings = loaded("core.blender.checks.findings")
    named = loaded("core.blender.checks.to_do").Named("Cube")
    label = findings.make_glass(loaded("core.blender.checks.to_do").Thing(named, "GLASS")).label
    assert str(label) == f"Make It Glass ({default.name})"


def instances_by_nodes(glass: bpy.types.Object) -> bpy.types.Object:
    """An object that shows a glass at its one vertex."""
    mesh = bpy.data.meshes.new("point")
    mesh.from_pydata([(0.0, 0.0, 0.0)], [], [])
    thing = bpy.data.objects.new("Nodes", mesh)
    scatter(thing, glass, as_instance=True)
    return thing


def instance_of(glass: bpy.types.Object) -> bpy.types.Object:
    """An instance of a collection that has a glass in another one within it."""
    group, inner = (bpy.data.collections.new(name) for name in ("Group", "Inner"))
    group.children.link(inner)
    inner.objects.link(glass)
    thing = bpy.data.objects.new("Instance", None)
    thing.instance_type, thing.instance_collection = "COLLECTION", group
    return thing


@pytest.mark.parametrize(("make", "name"), [(instance_of, "Water"), (instances_by_nodes, None)])
def test_glass_that_shows_other_objects_is_the_product_that_these_are(
    scene, read, capfd, make, name
):
    """Not acrylic, whose index is taken where no material refracts; what geometry nodes show may
    have many.
    """
    own = activate(small_rig()["GLASS"])
    own.kiriko.use_ior = False
    bpy.ops.kiriko.make_glass()
    bpy.ops.kiriko.glass_preset(preset="Water")
    own.kiriko.role = "NONE"
    glass = make(own)
    scene.collection.objects.link(glass)
    glass.kiriko.role = "GLASS"
    activate(glass)
    chosen = loaded("core.blender.checks.chosen_product")
    found = chosen.glass_product(glass)
    assert (found and found.name) == name
    assert read().rig.glasses[0].ior.at(WAVELENGTH) == pytest.approx(1.3333, abs=1e-6)

    bpy.ops.kiriko.glass_preset(preset="Acrylic")
    assert "(Override IOR 1.49: " in capfd.readouterr().out
    assert chosen.glass_product(glass).name == "Acrylic"


@pytest.mark.parametrize(
    ("way", "why"),
    [
        ("shared", "'Kiriko Glass' is shared, linked or driven by nodes"),
        ("nodes", "'Kiriko Glass' is shared, linked or driven by nodes"),
        ("override", ""),
    ],
)
def test_other_glass_gets_it_as_its_override(scene, read, capfd, way, why):
    """Materials that are not its own, or not plain, stay; the report says why."""
    glass = activate(small_rig()["GLASS"])
    glass.kiriko.use_ior = False
    bpy.ops.kiriko.make_glass()
    material = glass.material_slots[0].material
    tree = material.node_tree
    socket = next(n for n in tree.nodes if n.type == "BSDF_GLASS").inputs["IOR"]

    if way == "shared":
        other = glass.copy()
        other.kiriko.role = "NONE"
        scene.collection.objects.link(other)
    elif way == "nodes":
        tree.links.new(tree.nodes.new("ShaderNodeValue").outputs[0], socket)
    elif way == "override":
        glass.kiriko.use_ior = True

    bpy.ops.kiriko.glass_preset(preset="Polycarbonate")
    assert read().rig.glasses[0].ior.at(WAVELENGTH) == pytest.approx(1.5846, abs=1e-6)
    assert glass.kiriko.use_ior
    reason = f": {why}" if why else ""
    assert f"(Override IOR 1.5846{reason})." in capfd.readouterr().out
    assert socket.default_value == pytest.approx(1.49)


def in_grey(thing: bpy.types.Object, grey: bpy.types.Material) -> bpy.types.Object:
    """An object as glass with an opaque material."""
    thing.kiriko.role, thing.kiriko.use_ior = "GLASS", False
    thing.data.materials.append(grey)
    return thing


@pytest.mark.parametrize("is_shared", [True, False])
def test_opaque_glass_gets_the_material_of_the_product(scene, read, look, drawn, capfd, is_shared):
    """As Make It Glass does: before, the menu shows no product; Remove Rig restores the material.
    Two objects get one material only if they had one.
    """
    first = small_rig()["GLASS"]
    second = first.copy()
    second.data = first.data.copy()
    scene.collection.objects.link(second)
    second.location.x = 0.2
    greys = [bpy.data.materials.new("Grey") for _ in range(2)]
    in_grey(first, greys[0])
    in_grey(second, greys[0 if is_shared else 1])
    second.select_set(True)
    activate(first).select_set(True)
    assert "Custom" in drawn("object", "OBJECT_PT_kiriko", first).labels
    assert "The material of" in " ".join(entry.text for entry in look())

    assert bpy.ops.kiriko.glass_preset(preset="Polycarbonate") == {"FINISHED"}
    assert "material 'Kiriko Glass'" in capfd.readouterr().out
    assert "The material of" not in " ".join(entry.text for entry in look())
    assert [one.ior.at(WAVELENGTH) for one in read().rig.glasses] == pytest.approx(
        [1.5846] * 2, abs=1e-6
    )
    assert not any(thing.kiriko.use_ior for thing in (first, second))
    assert "Polycarbonate" in drawn("object", "OBJECT_PT_kiriko", first).labels
    made = [thing.material_slots[0].material for thing in (first, second)]
    assert (made[0] == made[1]) is is_shared

    bpy.ops.kiriko.remove_rig()
    assert first.material_slots[0].material == greys[0]


def test_a_display_that_is_held_keeps_its_size(scene, capfd):
    """It gets the pixels, and a warning with the reason; undo is one step."""
    display = activate(small_rig()["DISPLAY"])
    display.lock_scale[0] = True
    before = corners(display)
    bpy.ops.kiriko.display_preset(preset="Dell P2422H")
    assert np.array_equal(corners(display), before)
    assert tuple(display.kiriko.resolution) == (1920, 1080)
    said = "is now Dell P2422H (1920 x 1080 px), but could not be resized to 0.527 m x 0.296 m: "
    assert said in capfd.readouterr().out
