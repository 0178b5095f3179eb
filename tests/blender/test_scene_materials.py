from typing import Any

import bmesh
import bpy
import numpy as np
import pytest

WHITE = (1.0, 1.0, 1.0, 1.0)


def new_material(name: str = "stuff") -> tuple[bpy.types.Material, Any, Any]:
    """A material with nothing but an output: itself, its tree, and the output node."""
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    material.node_tree.nodes.clear()
    return material, material.node_tree, material.node_tree.nodes.new("ShaderNodeOutputMaterial")


def glass_shader(tree: Any, kind: str = "Glass", ior: float = 1.6) -> Any:
    """A perfectly clear refractive shader."""
    node = tree.nodes.new(
        {"Principled": "ShaderNodeBsdfPrincipled"}.get(kind, f"ShaderNodeBsdf{kind}")
    )
    node.inputs["IOR"].default_value, node.inputs["Roughness"].default_value = ior, 0.0
    node.inputs["Base Color" if kind == "Principled" else "Color"].default_value = WHITE
    if kind == "Principled":
        node.inputs["Transmission Weight"].default_value = 1.0
    return node


def clear_material(ior: float = 1.6, name: str = "stuff") -> bpy.types.Material:
    material, tree, output = new_material(name)
    tree.links.new(glass_shader(tree, ior=ior).outputs[0], output.inputs["Surface"])
    return material


def add_glass(*materials: bpy.types.Material) -> bpy.types.Object:
    """A cube whose faces take the materials in turn."""
    mesh = bpy.data.meshes.new("cube")
    built = bmesh.new()
    bmesh.ops.create_cube(built, size=1.0)
    built.to_mesh(mesh)
    built.free()
    for material in materials:
        mesh.materials.append(material)
    mesh.polygons.foreach_set(
        "material_index", np.arange(6, dtype=np.int32) % max(len(materials), 1)
    )
    stone = bpy.data.objects.new("stone", mesh)
    stone.kiriko.role = "GLASS"
    bpy.context.scene.collection.objects.link(stone)

    return stone


def index(reading: Any) -> float:
    return reading.rig.glasses[0].ior.at(587.6e-9)


@pytest.mark.every_blender
@pytest.mark.parametrize(
    ("kind", "source"),
    [("Glass", "Glass BSDF"), ("Refraction", "Refraction BSDF"), ("Principled", "Principled BSDF")],
)
def test_index_of_a_shader(read, kind, source):
    """The index is that of the material's refractive shader; a clear one leaves nothing out."""
    material, tree, output = new_material()
    tree.links.new(glass_shader(tree, kind, 1.73).outputs[0], output.inputs["Surface"])
    add_glass(material)
    reading = read()
    assert index(reading) == pytest.approx(1.73)
    (found,) = reading.materials
    assert (found.object_name, found.material_name, found.source) == ("stone", "stuff", source)
    assert found.ior == index(reading)
    assert found.ignored == ()
    assert reading.notes == ()


def test_index_through_nodes_that_pass_it_on(read):
    """Groups, reroutes, muted nodes and Value nodes are
    looked through, in and out of nested groups.
    """
    inner = bpy.data.node_groups.new("inner", "ShaderNodeTree")
    inner.interface.new_socket("Index", in_out="INPUT", socket_type="NodeSocketFloat")
    inner.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    shader = glass_shader(inner)
    inner.links.new(inner.nodes.new("NodeGroupInput").outputs["Index"], shader.inputs["IOR"])
    inner.links.new(shader.outputs[0], inner.nodes.new("NodeGroupOutput").inputs["Shader"])
    outer = bpy.data.node_groups.new("outer", "ShaderNodeTree")
    outer.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    used, value, muted = (
        outer.nodes.new(f"ShaderNode{kind}") for kind in ("Group", "Value", "Math")
    )
    used.node_tree = inner
    muted.mute = True
    value.outputs[0].default_value = 1.41
    outer.links.new(value.outputs[0], muted.inputs[0])
    outer.links.new(muted.outputs[0], used.inputs["Index"])
    outer.links.new(used.outputs["Shader"], outer.nodes.new("NodeGroupOutput").inputs["Shader"])
    material, tree, output = new_material()
    group = tree.nodes.new("ShaderNodeGroup")
    reroute = tree.nodes.new("NodeReroute")
    group.node_tree = outer
    tree.links.new(group.outputs["Shader"], reroute.inputs[0])
    tree.links.new(reroute.outputs[0], output.inputs["Surface"])
    add_glass(material)
    reading = read()

    assert index(reading) == pytest.approx(1.41)
    assert reading.notes == ()


def test_index_set_on_a_group_node(read):
    """An index that a group offers as an input is the value
    on the group node, not the group's default.
    """
    group = bpy.data.node_groups.new("group", "ShaderNodeTree")
    group.interface.new_socket(
        "Index", in_out="INPUT", socket_type="NodeSocketFloat"
    ).default_value = 9.0
    group.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    shader = glass_shader(group)
    group.links.new(group.nodes.new("NodeGroupInput").outputs["Index"], shader.inputs["IOR"])
    group.links.new(shader.outputs[0], group.nodes.new("NodeGroupOutput").inputs["Shader"])
    material, tree, output = new_material()
    used = tree.nodes.new("ShaderNodeGroup")
    used.node_tree = group
    used.inputs["Index"].default_value = 1.9
    tree.links.new(used.outputs["Shader"], output.inputs["Surface"])
    add_glass(material)

    assert index(read()) == pytest.approx(1.9)


def test_index_driven_by_nodes(read):
    """Where nodes compute the index, the number in the socket is used and a note says so."""
    material, tree, output = new_material()
    shader = glass_shader(tree, ior=1.55)
    tree.links.new(tree.nodes.new("ShaderNodeTexNoise").outputs[0], shader.inputs["IOR"])
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    add_glass(material)
    reading = read()
    assert index(reading) == pytest.approx(1.55)
    assert reading.notes == ("Nodes set the IOR of 'stuff'; Kiriko uses 1.55.",)


@pytest.mark.parametrize(("share", "ignored"), [(0.5, ("mixed with Transparent BSDF",)), (1.0, ())])
def test_mixed_shaders(read, share, ignored):
    """The refractive one of mixed shaders counts.

    The other is named unless its share is nothing.
    """
    material, tree, output = new_material()
    mix = tree.nodes.new("ShaderNodeMixShader")
    other = tree.nodes.new("ShaderNodeBsdfTransparent")
    mix.inputs[0].default_value = share
    tree.links.new(other.outputs[0], mix.inputs[1])
    tree.links.new(glass_shader(tree, "Refraction", 1.37).outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    add_glass(material)
    reading = read()
    assert index(reading) == pytest.approx(1.37)
    assert reading.materials[0].ignored == ignored


def test_what_is_not_followed_is_named(read):
    """Roughness, tint, thin film, coat, normal map, volume and displacement are listed by name."""
    material, tree, output = new_material()
    shader = glass_shader(tree, "Principled")
    shader.inputs["Roughness"].default_value = 0.2
    shader.inputs["Transmission Weight"].default_value = 0.75
    shader.inputs["Thin Film Thickness"].default_value = 300.0
    shader.inputs["Base Color"].default_value = (1.0, 0.5, 0.5, 1.0)
    tree.links.new(tree.nodes.new("ShaderNodeTexNoise").outputs[0], shader.inputs["Coat Weight"])
    tree.links.new(tree.nodes.new("ShaderNodeBump").outputs[0], shader.inputs["Normal"])
    tree.links.new(tree.nodes.new("ShaderNodeVolumeScatter").outputs[0], output.inputs["Volume"])
    tree.links.new(
        tree.nodes.new("ShaderNodeDisplacement").outputs[0], output.inputs["Displacement"]
    )
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    add_glass(material)

    assert set(read().materials[0].ignored) == {
        "Roughness 0.2",
        "Transmission Weight 0.75",
        "Thin Film Thickness 300",
        "Coat Weight from nodes",
        "Base Color",
        "Normal from nodes",
        "Volume from nodes",
        "Displacement from nodes",
    }


def test_override_wins(read):
    """The object's own index goes before the material's, and
    what the material asks for is still named.
    """
    material = clear_material(1.6)
    material.node_tree.nodes["Glass BSDF"].inputs["Roughness"].default_value = 0.3
    stone = add_glass(material)
    stone.kiriko.use_ior, stone.kiriko.ior = True, 1.333
    reading = read()
    assert index(reading) == pytest.approx(1.333)
    assert (reading.materials[0].source, reading.materials[0].ignored) == (
        "override",
        ("Roughness 0.3",),
    )


@pytest.mark.parametrize("kind", ["none", "opaque", "no nodes"])
def test_glass_without_refraction(read, kind):
    """Without a refractive material the index is that of acrylic, 1.49, and a note says so."""
    if kind == "none":
        add_glass()
    else:
        material, tree, output = new_material()
        if kind == "opaque":
            shader = tree.nodes.new("ShaderNodeBsdfPrincipled")
            tree.links.new(shader.outputs[0], output.inputs["Surface"])
        add_glass(material)

    reading = read()
    assert index(reading) == 1.49
    assert reading.materials[0].source == "default"
    assert reading.notes == ("The material of 'stone' isn't glass; Kiriko uses an IOR of 1.49.",)


def test_materials_of_different_index(read):
    """The material on most faces counts for the whole glass.

    All are listed, and a note names the difference.
    """
    stone = add_glass(
        clear_material(1.5, "few"), clear_material(1.7, "many"), clear_material(1.9, "unused")
    )
    stone.data.polygons.foreach_set("material_index", np.array([0, 0, 1, 1, 1, 1], np.int32))
    reading = read()
    assert index(reading) == pytest.approx(1.7)
    assert [m.material_name for m in reading.materials] == ["many", "few"]
    assert reading.notes == (
        "The materials of 'stone' have different IORs; Kiriko uses 1.7 of 'many', not 1.5.",
    )


def test_faces_that_do_not_refract(read):
    """Faces of an opaque material on a glass are part of it,
    whatever their number, and a note names the material.
    """
    stone = add_glass(new_material("label")[0], clear_material(1.7, "clear"))
    stone.data.polygons.foreach_set("material_index", np.array([0, 0, 0, 0, 0, 1], np.int32))
    reading = read()
    assert index(reading) == pytest.approx(1.7)
    assert reading.notes == (
        "'stone' has faces whose material isn't glass ('label'); they count as glass.",
    )


def test_material_of_the_object(read):
    """A slot that holds the object's own material goes before the mesh's.

    An index beyond the slots is the last one.
    """
    stone = add_glass(clear_material(1.5, "of the mesh"))
    stone.material_slots[0].link = "OBJECT"
    stone.material_slots[0].material = clear_material(1.8, "of the object")
    stone.data.polygons.foreach_set("material_index", np.full(6, 5, np.int32))
    reading = read()
    assert index(reading) == pytest.approx(1.8)
    assert reading.materials[0].material_name == "of the object"


def test_material_set_by_geometry_nodes(read):
    """A material that geometry nodes put on the evaluated mesh is the one that is read."""
    stone = add_glass(clear_material(1.5, "before"))
    tree = bpy.data.node_groups.new("nodes", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    setter = tree.nodes.new("GeometryNodeSetMaterial")
    setter.inputs["Material"].default_value = clear_material(2.0, "after")
    tree.links.new(tree.nodes.new("NodeGroupInput").outputs[0], setter.inputs["Geometry"])
    tree.links.new(setter.outputs[0], tree.nodes.new("NodeGroupOutput").inputs[0])
    stone.modifiers.new("nodes", "NODES").node_group = tree
    reading = read()
    assert index(reading) == pytest.approx(2.0)
    assert reading.materials[0].material_name == "after"


def gltf_output(tree: Any, dispersion: float) -> Any:
    """The group that Blender's importer makes for inputs missing in shaders."""
    group = bpy.data.node_groups.new("glTF Material Output", "ShaderNodeTree")
    group.interface.new_socket("Dispersion", socket_type="NodeSocketFloat")
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree = group
    node.inputs["Dispersion"].default_value = dispersion
    return node


@pytest.mark.every_blender
def test_dispersion_of_an_imported_material(read):
    """glTF's dispersion is 20 / V (KHR_materials_dispersion): 0.4 is an Abbe number of 50, exact
    at the lines F and C; the object's own setting goes first.
    """
    material, tree, output = new_material()
    tree.links.new(glass_shader(tree, ior=1.5).outputs[0], output.inputs["Surface"])
    gltf_output(tree, 0.4)
    stone = add_glass(material)
    reading = read()
    found = reading.rig.glasses[0].ior
    assert found.at(587.6e-9) == 1.5
    assert 0.5 / (found.at(486.1327e-9) - found.at(656.2725e-9)) == pytest.approx(50.0, rel=1e-6)
    assert not reading.materials[0].ignored

    stone.kiriko.dispersion = "NONE"
    assert read().rig.glasses[0].ior.at(464e-9) == 1.5
    stone.kiriko.dispersion, stone.kiriko.abbe = "ABBE", 25.0
    found = read().rig.glasses[0].ior
    assert 0.5 / (found.at(486.1327e-9) - found.at(656.2725e-9)) == pytest.approx(25.0, rel=1e-6)
    stone.kiriko.dispersion = "N-SF11"
    found = read().rig.glasses[0].ior
    assert found.at(587.6e-9) == 1.5
    step = found.at(486.1327e-9) - found.at(656.2725e-9)
    assert step == pytest.approx(0.78472 / 25.68, rel=1e-3)  # SCHOTT's glass code


def test_without_dispersion_an_index_is_one_number(read):
    """glTF's default of 0, and no group at all."""
    material, tree, output = new_material()
    tree.links.new(glass_shader(tree, ior=1.5).outputs[0], output.inputs["Surface"])
    add_glass(material)
    assert read().rig.glasses[0].ior.at(464e-9) == 1.5
    gltf_output(tree, 0.0)
    assert read().rig.glasses[0].ior.at(464e-9) == 1.5


def absorbing(tree: Any, output: Any, colour: tuple[float, float, float], density: float) -> None:
    """Add a Volume Absorption shader."""
    volume = tree.nodes.new("ShaderNodeVolumeAbsorption")
    volume.inputs["Color"].default_value = (*colour, 1.0)
    volume.inputs["Density"].default_value = density
    tree.links.new(volume.outputs[0], output.inputs["Volume"])


@pytest.mark.every_blender
@pytest.mark.parametrize("metres", [1.0, 0.01])
def test_absorption_of_a_volume(read, scene, metres):
    """Cycles' law: density * (1 - colour) per Blender unit; the object's tint goes first, as the
    colour after 1 cm.
    """
    scene.unit_settings.scale_length = metres
    material, tree, output = new_material()
    tree.links.new(glass_shader(tree, ior=1.5).outputs[0], output.inputs["Surface"])
    absorbing(tree, output, (1.0, 0.75, 0.5), 4.0)
    stone = add_glass(material)
    reading = read()
    expected = np.array([0.0, 1.0, 2.0]) / metres
    np.testing.assert_allclose(reading.rig.glasses[0].absorption, expected, rtol=1e-6)
    assert not reading.materials[0].ignored

    stone.kiriko.use_tint, stone.kiriko.tint = True, (1.0, 0.5, 0.25)
    found = np.array(read().rig.glasses[0].absorption)
    np.testing.assert_allclose(np.exp(-0.01 * found), (1.0, 0.5, 0.25), rtol=1e-6)


def test_a_volume_that_is_not_read_is_reported(read):
    """Scattering, and a density from a texture."""
    for kind in ("VolumeScatter", "VolumeAbsorption"):
        material, tree, output = new_material()
        tree.links.new(glass_shader(tree, ior=1.5).outputs[0], output.inputs["Surface"])
        volume = tree.nodes.new(f"ShaderNode{kind}")
        noise = tree.nodes.new("ShaderNodeTexNoise")
        tree.links.new(noise.outputs[0], volume.inputs["Density"])
        tree.links.new(volume.outputs[0], output.inputs["Volume"])
        stone = add_glass(material)
        reading = read()
        assert reading.rig.glasses[0].absorption == (0.0, 0.0, 0.0)
        assert reading.materials[0].ignored == ("Volume from nodes",)
        bpy.data.objects.remove(stone)
