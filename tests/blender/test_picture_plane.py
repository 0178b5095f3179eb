"""The picture's plane: it shows the solved picture, in the shape of its image."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from small_rigs import new_object, primitive, small_rig

SINGLE = 2e-6  # share: float32's rounding of sides and areas


def image(
    width: int, height: int, colour: tuple[float, ...] = (1.0, 0.0, 0.0, 1.0), name: str = "art"
) -> Any:
    """A float image of one colour."""
    made = bpy.data.images.new(name, width, height, alpha=True, float_buffer=True)
    made.pixels.foreach_set(np.tile(np.array(colour, np.float32), width * height))
    return made


def file(folder: Path, width: int, height: int, name: str = "art.png") -> str:
    made = bpy.data.images.new("writing", width, height)
    made.filepath_raw = str(folder / name)
    made.file_format = "PNG"
    made.save()
    bpy.data.images.remove(made)
    return str(folder / name)


def activate(thing: bpy.types.Object) -> bpy.types.Object:
    bpy.context.view_layer.objects.active = thing
    bpy.context.view_layer.update()
    return thing


def choose(chosen: bpy.types.Image, **options: object) -> set[str]:
    return bpy.ops.kiriko.choose_picture(image=chosen.name, **options)


def picture_plane(width: float = 0.03, height: float = 0.03, **options: object) -> bpy.types.Object:
    """The active object: a plane of the user's own with the role Picture, somewhere."""
    mesh = primitive("grid", x_segments=3, y_segments=2, size=0.5)
    for vertex in mesh.vertices:
        vertex.co.x, vertex.co.y = width * vertex.co.x, height * vertex.co.y
    layer = mesh.uv_layers.new(name="UVMap")
    for loop in mesh.loops:
        x, y, _ = mesh.vertices[loop.vertex_index].co
        layer.uv[loop.index].vector = (0.5 + x / width, 0.5 + y / height)

    thing = new_object(mesh, "PICTURE")
    thing.location = (0.1, 0.2, -0.3)
    thing.rotation_euler = (0.7, 0.1, 0.2)
    for name, value in options.items():
        setattr(thing, name, value)
    return activate(thing)


def placed(thing: bpy.types.Object) -> tuple[np.ndarray, np.ndarray]:
    """World corners (n, 3) and UV (n, 2) of a plane as shown."""
    bpy.context.view_layer.update()
    shown = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = shown.data
    layer = shown.data.uv_layers.active
    corners = [shown.matrix_world @ mesh.vertices[loop.vertex_index].co for loop in mesh.loops]
    return np.array(corners, float), np.array(
        [layer.uv[k].vector for k in range(len(mesh.loops))], float
    )


def aspect(thing: bpy.types.Object) -> float:
    """Width of the whole image over its height, as the plane lays it out."""
    points, uv = placed(thing)
    axes = np.linalg.lstsq(uv - uv.mean(axis=0), points - points.mean(axis=0), rcond=None)[0]
    width, height = np.linalg.norm(axes, axis=1)
    return width / height


def extent(thing: bpy.types.Object) -> tuple[float, np.ndarray, np.ndarray]:
    """Area, middle and direction of the normal of a plane as shown."""
    points, _ = placed(thing)
    shown = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
    shown.data.calc_loop_triangles()
    places = [shown.matrix_world @ vertex.co for vertex in shown.data.vertices]
    triangles = [[places[k] for k in t.vertices] for t in shown.data.loop_triangles]
    across = np.array([np.cross(b - a, c - a) for a, b, c in np.array(triangles, float)])
    normal = across.sum(axis=0)
    return (
        np.linalg.norm(across, axis=1).sum() / 2,
        points.mean(axis=0),
        normal / np.linalg.norm(normal),
    )


def texture_of(thing: bpy.types.Object) -> Any:
    """The image texture node of a plane's material."""
    return next(
        n for n in thing.material_slots[0].material.node_tree.nodes if n.type == "TEX_IMAGE"
    )


def is_solved(read: Callable[[], Any], chosen: bpy.types.Image) -> bool:
    """Is the reading's picture the image of one colour?"""
    found = read().rig.picture.image
    return found.shape[1::-1] == tuple(chosen.size) and bool(
        (found == np.array(chosen.pixels[:4], np.float32)).all()
    )


@pytest.mark.parametrize("size", [(900, 600), (90, 30), (30, 90), (64, 64)])
def test_the_plane_gets_the_shape_of_a_chosen_image(scene, size):
    """Its area, middle and direction stay; nothing is noted; undo
    and redo bring shape and image back and again.
    """
    picture = activate(small_rig()["PICTURE"])
    chosen = image(*size)
    bpy.ops.ed.undo_push(message="rig")
    before = extent(picture)

    assert choose(chosen) == {"FINISHED"}
    assert aspect(picture) == pytest.approx(size[0] / size[1], rel=SINGLE)
    for now, then in zip(extent(picture), before, strict=True):
        assert now == pytest.approx(then, rel=SINGLE, abs=1e-8)
    bpy.ops.kiriko.solve()

    assert "squeezed" not in bpy.context.scene.kiriko.result.notes
    bpy.ops.ed.undo_push(message="choose")

    bpy.ops.ed.undo()
    picture = bpy.data.objects["Kiriko Picture"]
    assert aspect(picture) == pytest.approx(1, rel=SINGLE)
    assert texture_of(picture).image.name == "Kiriko Lattice"

    bpy.ops.ed.redo()
    picture = bpy.data.objects["Kiriko Picture"]
    assert aspect(picture) == pytest.approx(size[0] / size[1], rel=SINGLE)
    assert texture_of(picture).image.name == "art"


@pytest.mark.parametrize(
    "way",
    [
        "scaled",
        "mirrored",
        "parent",
        "modifier",
        "part",
        "turned UV",
        "tilted mesh",
        "off centre",
        "other user",
        "no z",
    ],
)
def test_any_plane_gets_it(scene, way):  # noqa: C901 - a case each way
    """However it came to its shape: of its image the
    proportions are the image's, its area and middle stay.
    """
    thing = picture_plane()
    other = None
    if way == "scaled":
        thing.scale = (0.7, 1.9, 1.0)
    elif way == "mirrored":
        thing.scale = (-2.0, 1.0, 1.0)
    elif way == "parent":
        parent = new_object(None)
        parent.scale = (2.0, 2.0, 2.0)
        parent.rotation_euler = (0.3, 0.2, 0.1)
        parent.location = (1.0, 0.0, 0.5)
        thing.parent = parent
        thing.matrix_parent_inverse = Matrix.Translation((0.1, 0.0, 0.0))
    elif way == "modifier":
        thing.modifiers.new("more", "SUBSURF").subdivision_type = "SIMPLE"
    elif way == "part":
        for k in range(len(thing.data.loops)):
            u, v = thing.data.uv_layers[0].uv[k].vector
            thing.data.uv_layers[0].uv[k].vector = (0.25 + 0.5 * u, 0.1 + 0.25 * v)
    elif way == "turned UV":
        for k in range(len(thing.data.loops)):
            u, v = thing.data.uv_layers[0].uv[k].vector
            thing.data.uv_layers[0].uv[k].vector = (1 - v, u)
    elif way == "tilted mesh":
        thing.data.transform(Matrix.Rotation(0.5, 4, "X"))
    elif way == "off centre":
        thing.data.transform(Matrix.Translation((1.0, 0.5, 0.0)))
    elif way == "other user":
        other = new_object(thing.data)
    elif way == "no z":
        thing.scale.z = 0.0

    before = extent(thing)
    beside = None if other is None else placed(other)[0]
    chosen = image(90, 30)
    choose(chosen)

    assert aspect(thing) == pytest.approx(3, rel=1e-5)
    for now, then in zip(extent(thing), before, strict=True):
        assert now == pytest.approx(then, rel=1e-5, abs=1e-7)
    if other is not None:
        assert np.array_equal(placed(other)[0], beside)


def test_what_hangs_on_the_plane_stays(scene):
    """A child is neither moved nor scaled."""
    thing = picture_plane()
    child = new_object(primitive("cube", size=0.01))
    child.parent = thing
    child.location = (0.02, 0.01, 0.0)
    bpy.context.view_layer.update()
    before = np.array(child.matrix_world)
    choose(image(90, 30))
    assert np.array(child.matrix_world) == pytest.approx(before, abs=1e-7)


@pytest.mark.parametrize(
    ("way", "reason"),
    [
        ("animated", "it is animated"),
        ("locked", "its transform is locked"),
        ("turned", "its mesh is rotated in the object (scale it in Edit Mode)"),
        ("bent", "its UV map is not one rectangle"),
        ("no UV", "it has no UV map"),
        ("constraint", "a constraint or a driver holds it"),
    ],
)
def test_a_plane_that_cannot_be_fitted_says_why(scene, capfd, way, reason):
    """The image is chosen all the same, the plane is as it was,
    and Fit to Image is refused with the same reason.
    """
    thing = picture_plane()
    if way == "animated":
        thing.keyframe_insert("scale", frame=1)
    elif way == "locked":
        thing.lock_scale = (True, False, False)
    elif way == "turned":
        thing.data.transform(Matrix.Rotation(0.5, 4, "X") @ Matrix.Rotation(0.5, 4, "Z"))
    elif way == "bent":
        thing.data.vertices[0].co.z += 0.01
    elif way == "no UV":
        thing.data.uv_layers.remove(thing.data.uv_layers[0])
    elif way == "constraint":
        thing.constraints.new("LIMIT_SCALE").use_max_x = True
        thing.constraints[0].max_x = 1.0

    bpy.context.view_layer.update()
    before = np.array(thing.matrix_world)
    capfd.readouterr()
    assert choose(image(90, 30)) == {"FINISHED"}
    assert f"'thing' keeps its size: {reason}." in capfd.readouterr().out
    assert texture_of(thing).image.name == "art"
    assert np.array_equal(np.array(thing.matrix_world), before)

    with pytest.raises(RuntimeError, match=re.escape(f"'thing' keeps its size: {reason}")):
        bpy.ops.kiriko.fit_picture()


@pytest.mark.parametrize(
    ("size", "words"), [((90, 30), "33 % of its width"), ((60, 90), "67 % of its height")]
)
def test_a_script_keeps_the_shape_it_gave_and_solve_says_by_how_much(scene, size, words):
    """An image that a script sets leaves the plane alone; Solve
    names it, and Fit to Image puts it right.
    """
    picture = activate(small_rig()["PICTURE"])
    before = np.array(picture.matrix_world)
    picture.kiriko.image = image(*size)
    assert np.array_equal(np.array(picture.matrix_world), before)

    bpy.ops.kiriko.solve()
    note = (
        f"The image 'art' is squeezed to {words} on 'Kiriko Picture': press Fit to Image in the"
        f" Kiriko tab."
    )

    assert note in scene.kiriko.result.notes.splitlines()
    assert np.array_equal(np.array(picture.matrix_world), before)
    assert bpy.ops.kiriko.fit_picture() == {"FINISHED"}
    assert aspect(picture) == pytest.approx(size[0] / size[1], rel=SINGLE)

    bpy.ops.kiriko.solve()
    assert "squeezed" not in scene.kiriko.result.notes
    assert not bpy.ops.kiriko.fit_picture.poll()


def test_an_image_is_opened_from_its_file(scene, tmp_path):
    """It is chosen, shown and fitted; opened again it is the
    same image; a file that is no image leaves nothing behind.
    """
    picture = activate(small_rig()["PICTURE"])
    path = file(tmp_path, 90, 30)
    assert bpy.ops.kiriko.open_picture(filepath=path) == {"FINISHED"}
    assert aspect(picture) == pytest.approx(3, rel=SINGLE)
    assert texture_of(picture).image.name == "art.png"

    n = len(bpy.data.images)
    bpy.ops.kiriko.open_picture(filepath=path)
    assert len(bpy.data.images) == n
    (tmp_path / "notes.txt").write_text("no image")

    for name, words in (
        ("notes.txt", "missing or broken"),
        ("none.png", "There is no file"),
        ("", "No file is chosen"),
    ):
        with pytest.raises(RuntimeError, match=words):
            bpy.ops.kiriko.open_picture(filepath=str(tmp_path / name) if name else "")

    assert len(bpy.data.images) == n
    assert texture_of(picture).image.name == "art.png"


def test_the_open_file_itself_is_no_choice(scene, tmp_path):
    """Blender's file browser names it until another file is clicked."""
    activate(small_rig()["PICTURE"])
    path = str(tmp_path / "rig.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    for verb in (bpy.ops.kiriko.open_picture, bpy.ops.kiriko.open_pictures):
        for named in (path, "//rig.blend"):
            with pytest.raises(RuntimeError, match="No file is chosen"):
                verb(filepath=named)


def test_buttons_say_which_picture_they_need(scene):
    """The active picture, or the only one.

    With none, or two of which none is active, they are grey.
    """
    chosen = image(90, 30)
    with pytest.raises(RuntimeError, match="Select an object with the role Picture"):
        choose(chosen)
    first = picture_plane()
    with pytest.raises(RuntimeError, match="The file has no image 'none': open it"):
        bpy.ops.kiriko.choose_picture(image="none")
    bpy.context.view_layer.objects.active = None
    choose(chosen)

    assert texture_of(first).image == chosen
    second = picture_plane()
    choose(image(30, 30, name="other"))
    assert texture_of(first).image == chosen
    assert texture_of(second).image.name == "other"

    bpy.context.view_layer.objects.active = None
    assert not bpy.ops.kiriko.choose_picture.poll()
    activate(second)
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match="Leave Edit Mode first"):
        choose(chosen)


def test_the_plane_shows_what_is_solved(read):
    """An image that is chosen, by an artist or a script, is in the material.

    One chosen in the material is solved.
    """
    picture = activate(small_rig()["PICTURE"])
    red, green, blue = (
        image(8, 8, c, n)
        for c, n in (((1, 0, 0, 1), "r"), ((0, 1, 0, 1), "g"), ((0, 0, 1, 1), "b"))
    )
    choose(red)

    assert texture_of(picture).image == red
    assert is_solved(read, red)
    picture.kiriko.image = green
    assert texture_of(picture).image == green
    assert is_solved(read, green)

    texture_of(picture).image = blue
    assert is_solved(read, blue)
    choose(green)
    assert texture_of(picture).image == green
    assert is_solved(read, green)
    assert len([m for m in bpy.data.materials if m.name.startswith("Kiriko Picture")]) == 1


@pytest.mark.parametrize("way", ["slot", "mesh", "group", "fake user"])
def test_what_others_show_is_not_changed(read, capfd, way):
    """A material, or node group, that others use is copied first, and the report names the copy."""
    picture = activate(small_rig()["PICTURE"])
    lattice = bpy.data.images["Kiriko Lattice"]
    material = picture.material_slots[0].material
    other = new_object(picture.data if way == "mesh" else primitive("cube", size=1.0))

    if way == "slot":
        other.data.materials.append(material)
    elif way == "fake user":
        material.use_fake_user = True
    elif way == "group":
        material = grouped(picture, lattice)
        other.data.materials.append(bpy.data.materials.new("beside"))
        tree = other.data.materials[0].node_tree or nodes_of(other.data.materials[0])
        tree.nodes.new("ShaderNodeGroup").node_tree = material.node_tree.nodes["group"].node_tree

    shared = texture_in(material)
    capfd.readouterr()
    chosen = image(8, 8)
    choose(chosen)

    assert is_solved(read, chosen)
    if way == "fake user":
        assert picture.material_slots[0].material == material
        return

    assert shared.image == lattice
    if way != "group":
        assert picture.material_slots[0].material != material
        assert other.material_slots[0].material == material
    else:
        assert picture.material_slots[0].material == material
        assert texture_in(material).image == chosen


def nodes_of(material: bpy.types.Material) -> Any:
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    return material.node_tree


def texture_in(material: bpy.types.Material) -> Any:
    """The image texture of a material, in its group if it has one."""
    nodes = material.node_tree.nodes
    if "group" in nodes:
        nodes = nodes["group"].node_tree.nodes
    return next(n for n in nodes if n.type == "TEX_IMAGE")


def grouped(thing: bpy.types.Object, shown: bpy.types.Image, slot: int = 0) -> bpy.types.Material:
    """A new material in a slot of a thing that emits an image by way of a node group."""
    group = bpy.data.node_groups.new("group", "ShaderNodeTree")
    group.interface.new_socket("Color", in_out="OUTPUT", socket_type="NodeSocketColor")
    texture = group.nodes.new("ShaderNodeTexImage")
    texture.image = shown
    group.links.new(texture.outputs["Color"], group.nodes.new("NodeGroupOutput").inputs["Color"])
    material = bpy.data.materials.new("mine")
    tree = nodes_of(material)
    tree.nodes.clear()
    used = tree.nodes.new("ShaderNodeGroup")
    shader = tree.nodes.new("ShaderNodeEmission")
    used.name, used.node_tree = "group", group
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(used.outputs["Color"], shader.inputs["Color"])
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    thing.material_slots[slot].material = material

    return material


@pytest.mark.parametrize("way", ["none", "plain", "empty"])
def test_a_plane_that_showed_nothing_shows_it(read, way):
    """Without material, or with one that has no image, it gets one.

    An empty image texture is filled.
    """
    thing = picture_plane()
    mine = None
    if way != "none":
        mine = bpy.data.materials.new("mine")
        tree = nodes_of(mine)
        if way == "empty":
            shader = next(n for n in tree.nodes if n.type == "BSDF_PRINCIPLED")
            tree.links.new(
                tree.nodes.new("ShaderNodeTexImage").outputs[0], shader.inputs["Base Color"]
            )
        thing.data.materials.append(mine)

    chosen = image(8, 8)
    thing.kiriko.image = chosen
    assert texture_of(thing).image == chosen
    assert (thing.material_slots[0].material == mine) == (way == "empty")

    if way == "plain":
        assert thing.data.materials[0] == mine
        assert mine.use_fake_user

    assert is_solved(read, chosen)


def test_the_lattice_has_the_shape_of_its_plane(scene):
    """Show Lattice on a plane of 3 to 1 draws round dots, and nothing is squeezed."""
    picture = activate(small_rig()["PICTURE"])
    choose(image(90, 30))
    assert bpy.ops.kiriko.lattice_picture() == {"FINISHED"}
    shown = texture_of(picture).image
    assert shown.size[0] / shown.size[1] == pytest.approx(3, rel=1e-2)
    assert aspect(picture) == pytest.approx(3, rel=SINGLE)
    bpy.ops.kiriko.solve()
    assert "squeezed" not in scene.kiriko.result.notes
