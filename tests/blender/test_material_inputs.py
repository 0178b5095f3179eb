"""Every input of a shader that changes light through clear glass is read, or told not to be."""

from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
import pytest

from extension import loaded
from small_rigs import new_object, pixels, primitive, small_rig
from test_scene_materials import glass_shader, new_material

SHADERS = ("Principled", "Glass", "Refraction")
OTHER = {  # another value of an input than clear glass has, where half of that is none
    "RGBA": (0.2, 0.5, 0.9, 1.0),
    "VALUE": 0.3,
    "BOOLEAN": True,
    "IOR": 1.3,
    "Thin Film Thickness": 400.0,
}
ROUNDING = 1e-5  # of single precision: with the same seed nothing else differs


@pytest.fixture
def bench(scene, tmp_path) -> Callable[[bpy.types.Material], np.ndarray]:
    """Renders a wedge of a material before a screen in Cycles: light tells by red where it came
    from, by green, a fine pattern, how sharp it is, and by blue how much it is.
    """
    camera = new_object(bpy.data.cameras.new("camera"))
    camera.location.z, camera.data.type, camera.data.ortho_scale = 5, "ORTHO", 0.2
    wedge = new_object(primitive("cube", size=1))
    for vertex in wedge.data.vertices:
        vertex.co.z += 0.4 * vertex.co.x * (vertex.co.z > 0)
    screen = new_object(primitive("grid", size=4))
    screen.location.z = -1
    material, tree, output = new_material("screen")
    place, light, comb = (
        tree.nodes.new(f"ShaderNode{kind}") for kind in ("NewGeometry", "Emission", "TexChecker")
    )
    comb.inputs["Scale"].default_value = 40
    tree.links.new(place.outputs["Position"], comb.inputs["Vector"])
    split, join = (tree.nodes.new(f"ShaderNode{kind}XYZ") for kind in ("Separate", "Combine"))
    raised = tree.nodes.new("ShaderNodeVectorMath")
    raised.operation, raised.inputs[1].default_value = "ADD", (1, 1, 0)
    tree.links.new(place.outputs["Position"], raised.inputs[0])
    tree.links.new(raised.outputs[0], split.inputs[0])
    tree.links.new(split.outputs[0], join.inputs[0])
    tree.links.new(comb.outputs["Fac"], join.inputs[1])
    join.inputs[2].default_value = 1
    tree.links.new(join.outputs[0], light.inputs["Color"])
    tree.links.new(light.outputs[0], output.inputs["Surface"])
    screen.data.materials.append(material)

    render, scene.camera = scene.render, camera
    render.engine, render.resolution_x, render.resolution_y = "CYCLES", 4, 4
    scene.cycles.samples, scene.cycles.use_denoising = 64, False
    scene.cycles.use_adaptive_sampling, scene.cycles.blur_glossy = False, 0
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "GAUSSIAN", 0.01
    if bpy.app.version >= (5, 0, 0):
        render.image_settings.media_type = "IMAGE"
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
    render.filepath = str(tmp_path / "seen.exr")

    def seen(material: bpy.types.Material) -> np.ndarray:
        wedge.data.materials.clear()
        wedge.data.materials.append(material)
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(render.filepath, check_existing=False)
        found = pixels(image)[..., :3]
        bpy.data.images.remove(image)
        return found

    return seen


def clear(kind: str) -> tuple[bpy.types.Material, Any, Any]:
    """A material of a clear shader, its tree and the shader."""
    material, tree, output = new_material()
    shader = glass_shader(tree, kind, 1.5)
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return material, tree, shader


def changed(kind: str, name: str) -> bpy.types.Material:
    """The same with another value of one input; normals and tangents come from a node."""
    material, tree, shader = clear(kind)
    socket = shader.inputs[name]
    if socket.type == "VECTOR" and socket.hide_value:
        vector = tree.nodes.new("ShaderNodeCombineXYZ")
        for k, value in enumerate((0.3, 0.1, 0.95)):
            vector.inputs[k].default_value = value
        tree.links.new(vector.outputs[0], socket)
    elif socket.type == "VECTOR":
        socket.default_value = (0.3, 0.7, 0.9)
    else:
        socket.default_value = OTHER.get(name, OTHER[socket.type])
    return material


@pytest.mark.parametrize("kind", SHADERS)
def test_every_input_that_changes_light_in_cycles_is_read_or_told(kiriko, bench, kind):
    """And no other is told: whatever version of Blender it is, whatever inputs its shaders have."""
    module = loaded("core.blender.materials.material")
    material, _, shader = clear(kind)
    plain = bench(material)
    names = [socket.name for socket in shader.inputs if socket.enabled]
    assert {"IOR", "Roughness", "Normal"} < set(names)
    matters, told = set(), set()
    for name in names:
        one = changed(kind, name)
        if np.abs(bench(one) - plain).max() > ROUNDING:
            matters.add(name)
        found = module.read_refraction(one)
        if found is None or found.ignored or found.ior != 1.5:
            told.add(name)
    assert told == matters


WEIGHTS = {  # inputs, and others without which they change nothing
    "Emission Strength": {"Emission Color": 0.0},
    "Sheen Weight": {"Sheen Tint": 0.0},
    "Coat Weight": {"Coat IOR": 1.0, "Coat Tint": 1.0},
    "Thin Film Thickness": {"Thin Film IOR": 1.0},
}


@pytest.mark.parametrize("name", WEIGHTS)
def test_an_input_that_changes_nothing_is_not_told(kiriko, bench, name):
    """As the strength of black light: Cycles has the same pixels. One of which a node decides
    it is told.
    """
    module = loaded("core.blender.materials.material")
    plain, material = bench(clear("Principled")[0]), changed("Principled", name)
    assert np.abs(bench(material) - plain).max() > ROUNDING
    assert len(module.read_refraction(material).ignored) == 1

    tree = material.node_tree
    inputs = tree.nodes["Principled BSDF"].inputs
    for other, value in WEIGHTS[name].items():
        is_colour = inputs[other].type == "RGBA"
        inputs[other].default_value = (*[value] * 3, 1.0) if is_colour else value
    assert np.abs(bench(material) - plain).max() <= ROUNDING
    assert module.read_refraction(material).ignored == ()

    tree.links.new(tree.nodes.new("ShaderNodeTexNoise").outputs[0], inputs[other])
    assert len(module.read_refraction(material).ignored) == 1


@pytest.mark.skipif(bpy.app.version < (5, 2, 0), reason="Thin Wall came with Blender 5.2")
def test_a_thin_wall_is_no_glass(scene, bench, look):
    """Cycles sees straight through it, as through glass of index 1. The result names the material;
    Make It Glass, or turning it off, makes it glass.
    """
    thin = changed("Principled", "Thin Wall")
    straight, _, shader = clear("Principled")
    shader.inputs["IOR"].default_value = 1.0
    seen = [bench(one) for one in (thin, straight, clear("Principled")[0])]
    place, expected, bent = (one[..., 0] / one[..., 2] for one in seen)
    np.testing.assert_allclose(place, expected, atol=0.05)
    assert (np.abs(bent - expected) > 0.15).all()

    for thing in list(scene.objects):
        bpy.data.objects.remove(thing)
    glass = small_rig()["GLASS"]
    glass.kiriko.use_ior = False
    glass.data.materials.append(thin)
    bpy.ops.kiriko.solve()
    words = f"straight through the material '{thin.name}'. Turn Thin Wall off"
    assert words in scene.kiriko.result.notes
    (entry,) = look()
    bpy.ops.kiriko.make_glass(**dict(entry.buttons[0].properties))
    assert look() == []
    glass.material_slots[0].material = thin
    thin.node_tree.nodes["Principled BSDF"].inputs["Thin Wall"].default_value = False
    assert look() == []


def test_what_a_node_or_gltf_says_is_told(scene):
    """An input that is linked is told to come from nodes, unless a constant feeds it its neutral
    value; dispersion is read from the group of Blender's glTF importer, beside the shader.
    """
    module = loaded("core.blender.materials.material")
    material, tree, shader = clear("Principled")
    tree.links.new(tree.nodes.new("ShaderNodeTexNoise").outputs[0], shader.inputs["Coat Weight"])
    white = tree.nodes.new("ShaderNodeRGB")
    white.outputs[0].default_value = (1, 1, 1, 1)
    tree.links.new(white.outputs[0], shader.inputs["Base Color"])
    group = tree.nodes.new("ShaderNodeGroup")
    group.node_tree = bpy.data.node_groups.new("glTF Material Output.001", "ShaderNodeTree")
    group.node_tree.interface.new_socket(
        "Dispersion", in_out="INPUT", socket_type="NodeSocketFloat"
    )
    assert module.read_refraction(material).ignored == ("Coat Weight from nodes",)
    group.inputs["Dispersion"].default_value = 0.2
    found = module.read_refraction(material)
    assert found.ignored == ("Coat Weight from nodes",)
    assert found.abbe == pytest.approx(100.0)
