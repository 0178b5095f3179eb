from contextlib import nullcontext
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from extension import loaded
from small_rigs import small_rig

SIZE = (24, 16)  # pixels of the pictures here


def new_material(name: str = "paper") -> tuple[bpy.types.Material, Any, Any]:
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    material.node_tree.nodes.clear()
    return material, material.node_tree, material.node_tree.nodes.new("ShaderNodeOutputMaterial")


def texture_material(image: bpy.types.Image | None) -> bpy.types.Material:
    """A material that emits an image."""
    material, tree, output = new_material()
    texture = tree.nodes.new("ShaderNodeTexImage")
    emission = tree.nodes.new("ShaderNodeEmission")
    texture.image, texture.interpolation = image, "Closest"
    tree.links.new(texture.outputs["Color"], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    return material


def add_plane(material: bpy.types.Material | None, name: str = "poster") -> bpy.types.Object:
    """A picture plane of the pictures' shape, in the xy plane, seen upright from above."""
    mesh = bpy.data.meshes.new("plane")
    width = SIZE[0] / 2
    height = SIZE[1] / 2
    mesh.from_pydata(
        [(-width, -height, 0), (width, -height, 0), (width, height, 0), (-width, height, 0)],
        [],
        [range(4)],
    )
    mesh.uv_layers.new(name="first").uv.foreach_set(
        "vector", np.array([0, 0, 1, 0, 1, 1, 0, 1], np.float32)
    )
    if material is not None:
        mesh.materials.append(material)
    plane = bpy.data.objects.new(name, mesh)
    plane.kiriko.role = "PICTURE"
    bpy.context.scene.collection.objects.link(plane)

    return plane


def random_pixels() -> np.ndarray:
    """(h, w, 4) numbers 0..1, row 0 at the bottom as Blender has it; alpha from 0 to 1."""
    return np.random.default_rng(3).random((SIZE[1], SIZE[0], 4)).astype(np.float32)


def generated(name: str = "art", *, is_float: bool = False) -> bpy.types.Image:
    image = bpy.data.images.new(name, *SIZE, alpha=True, float_buffer=is_float)
    image.pixels.foreach_set(random_pixels().ravel())
    return image


def write(pixels: np.ndarray, path: Path) -> None:
    """Write numbers as they are with OpenImageIO, row 0 of the array at the bottom."""
    oiio = pytest.importorskip("OpenImageIO")
    kind = {".png": "uint8", ".tif": "uint16", ".exr": "float"}[path.suffix]
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], kind)
    spec["oiio:UnassociatedAlpha"] = 1  # no arithmetic on the way to the file
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec)
    output.write_image(np.ascontiguousarray(pixels[::-1]))
    output.close()


def linear_from_srgb(encoded: np.ndarray) -> np.ndarray:
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def render(scene: bpy.types.Scene, folder: Path) -> np.ndarray:
    """Linear RGB (h, w, 3) of the plane in Cycles, one pixel
    for each of the picture's, row 0 at the top.
    """
    camera = bpy.data.objects.new("eye", bpy.data.cameras.new("lens"))
    camera.location = (0.0, 0.0, 5.0)
    camera.data.type = "ORTHO"
    camera.data.ortho_scale = float(SIZE[0])
    scene.collection.objects.link(camera)
    scene.camera = camera
    settings = scene.render
    settings.engine, scene.view_settings.view_transform = "CYCLES", "Raw"
    settings.resolution_x, settings.resolution_y = SIZE
    scene.cycles.samples = 1
    scene.cycles.use_denoising = False
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 0.01
    settings.image_settings.file_format, settings.image_settings.color_depth = "OPEN_EXR", "32"
    settings.filepath = str(folder / "render.exr")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(settings.filepath)
    pixels = np.empty(SIZE[0] * SIZE[1] * 4, np.float32)
    image.pixels.foreach_get(pixels)

    return pixels.reshape(SIZE[1], SIZE[0], 4)[::-1, :, :3]


def load(path: Path, space: str, alpha: str) -> bpy.types.Image:
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name, image.alpha_mode = space, alpha
    return image


FILES = [
    (".png", "sRGB"),
    (".png", "Non-Color"),
    (".png", "Linear Rec.709"),
    (".tif", "sRGB"),
    (".tif", "Non-Color"),
    (".exr", "Linear Rec.709"),
]


@pytest.mark.parametrize(
    ("ending", "space", "alpha"),
    [
        (*file, alpha)
        for file in FILES
        for alpha in ("CHANNEL_PACKED", "NONE", "STRAIGHT")
        if alpha != "STRAIGHT" or file[1] == "Non-Color"  # elsewhere straight alpha is coverage
    ],
)
def test_opaque_pixels_are_the_light_that_cycles_sends(read, scene, tmp_path, ending, space, alpha):
    """Where alpha is no coverage, colours are those that Cycles
    renders from the texture, and the picture is opaque.
    """
    path = tmp_path / f"art{ending}"
    write(random_pixels(), path)
    add_plane(texture_material(load(path, space, alpha)))
    found = read().rig.picture.image
    assert found.dtype == np.float32
    assert found.shape == (SIZE[1], SIZE[0], 4)
    assert (found[..., 3] == 1).all()
    # 16-bit files become half floats in Cycles and go through a
    # table in Blender; the others agree to 1e-6
    assert np.abs(found[..., :3] - render(scene, tmp_path)).max() < (
        1e-4 if ending == ".tif" else 1e-6
    )


@pytest.mark.parametrize(
    ("ending", "space", "alpha", "tolerance"),
    [
        # Cycles keeps the product of colour and alpha in 8 bits,
        # of which the curve makes up to 2.3 as much
        (".png", "sRGB", "STRAIGHT", 2.5 / 255),
        (".png", "Linear Rec.709", "STRAIGHT", 1.0 / 255),
        (".tif", "sRGB", "STRAIGHT", 1e-4),
        (".exr", "Linear Rec.709", "PREMUL", 1e-6),
    ],
)
def test_transparent_pixels_are_the_light_that_cycles_sends(
    read, scene, tmp_path, ending, space, alpha, tolerance
):
    """Premultiplied colours are those that Cycles renders over
    black where alpha makes the plane transparent.
    """
    path = tmp_path / f"art{ending}"
    write(random_pixels(), path)
    material = texture_material(load(path, space, alpha))
    nodes = {node.type: node for node in material.node_tree.nodes}
    mix, clear = (
        material.node_tree.nodes.new(f"ShaderNode{kind}")
        for kind in ("MixShader", "BsdfTransparent")
    )

    for start, end in (
        (nodes["TEX_IMAGE"].outputs["Alpha"], mix.inputs[0]),
        (clear.outputs[0], mix.inputs[1]),
        (nodes["EMISSION"].outputs[0], mix.inputs[2]),
        (mix.outputs[0], nodes["OUTPUT_MATERIAL"].inputs["Surface"]),
    ):
        material.node_tree.links.new(start, end)

    add_plane(material)
    found = read().rig.picture.image
    assert np.abs(found[..., 3] - random_pixels()[::-1, :, 3]).max() < (
        0.6 / 255 if ending == ".png" else 1e-4
    )
    assert np.abs(found[..., :3] - render(scene, tmp_path)).max() < tolerance


@pytest.mark.parametrize(
    ("ending", "space", "alpha", "tolerance"),
    [(".png", "sRGB", "STRAIGHT", 2.5 / 255), (".exr", "Linear Rec.709", "PREMUL", 1e-6)],
)
def test_the_planes_own_material_shows_the_light_that_is_solved(
    read, kiriko, scene, tmp_path, ending, space, alpha, tolerance
):
    """The material that Add Rig gives to the picture is see-through where the image is."""
    path = tmp_path / f"art{ending}"
    write(random_pixels(), path)
    material = new_material()[0]
    kiriko.core.blender.materials.shaders.show_picture(material, load(path, space, alpha))
    next(n for n in material.node_tree.nodes if n.type == "TEX_IMAGE").interpolation = "Closest"
    add_plane(material)
    found = read().rig.picture.image
    assert np.abs(found[..., :3] - render(scene, tmp_path)).max() < tolerance


@pytest.mark.parametrize("mode", ["STRAIGHT", "PREMUL", "CHANNEL_PACKED", "NONE"])
def test_transparent_is_dark(scene, mode):
    """A gradient of alpha is solved as the opaque image of the same light over black is.

    Where the mode says that alpha is no coverage, it is solved as the colours alone.
    Coverage, which is the outline's, does not depend on alpha.
    """
    along = np.linspace(0, 1, 64, dtype=np.float32)
    colours = np.full((64, 64, 4), (0.8, 0.4, 0.2, 1.0), np.float32)
    stored = colours.copy()
    stored[..., 3] = along
    if mode == "PREMUL":
        stored[..., :3] *= stored[..., 3:]
    light = colours.copy()
    if mode in {"STRAIGHT", "PREMUL"}:
        light[..., :3] *= along[:, None]

    parts = small_rig(ior=1.2)
    solved = []
    for pixels, alpha in ((stored, mode), (light, "NONE")):
        # Blender keeps the pixels of float images premultiplied, whatever the mode of the file
        image = bpy.data.images.new("gradient", 64, 64, alpha=True, float_buffer=True)
        image.alpha_mode = alpha
        kept = pixels.copy()
        if alpha == "STRAIGHT":
            kept[..., :3] *= kept[..., 3:]
        image.pixels.foreach_set(kept.ravel())
        parts["PICTURE"].kiriko.image = image
        assert bpy.ops.kiriko.solve() == {"FINISHED"}
        result = scene.kiriko.result
        solved.append((np.array(result.source.pixels), result.coverage))

    (source, coverage), (wanted, wanted_coverage) = solved
    assert np.abs(source - wanted).max() < 1e-6
    assert wanted.max() > 0.5
    assert coverage == wanted_coverage


def test_premultiplied_bytes(read, tmp_path):
    """An 8-bit file of encoded colours times alpha gives
    linear colours times alpha, to the file's 8 bits.
    """
    pixels = random_pixels().astype(float)
    pixels[..., 3] = 0.5 + 0.5 * pixels[..., 3]
    stored = pixels.copy()
    stored[..., :3] *= stored[..., 3:]
    write(stored.astype(np.float32), tmp_path / "art.png")
    add_plane(texture_material(load(tmp_path / "art.png", "sRGB", "PREMUL")))
    wanted = (linear_from_srgb(pixels[..., :3]) * pixels[..., 3:])[::-1]
    # the file's half step doubles in the division by alpha,
    # Blender rounds it to bytes again, and the slope is 2.3
    assert np.abs(read().rig.picture.image[..., :3] - wanted).max() < 2.3 * 1.5 / 255


@pytest.mark.parametrize("space", ["sRGB", "Non-Color"])
@pytest.mark.parametrize("alpha", ["STRAIGHT", "NONE"])
@pytest.mark.parametrize("is_float", [False, True])
def test_the_kernel_decodes_as_numpy_does(kiriko, errors, is_float, alpha, space):
    """Bit for bit; a number that is none is refused by both."""
    picture = loaded("core.blender.read.scene_picture")
    loading = loaded("core.native.loading")
    image = bpy.data.images.new("p", *SIZE, alpha=True, float_buffer=is_float)
    image.colorspace_settings.name = space
    image.alpha_mode = alpha
    image.pixels.foreach_set(np.random.default_rng(3).random(4 * SIZE[0] * SIZE[1], np.float32))
    with loading.off():
        expected = picture.read_pixels(image, "the picture")
    assert np.array_equal(picture.read_pixels(image, "the picture"), expected)

    stored = picture.stored_pixels(image, "the picture")
    for wild in (np.nan, np.inf):
        broken = stored.copy()
        broken[3, 5, 1] = wild
        for off in (False, True):
            with loading.off() if off else nullcontext(), pytest.raises(errors.ImageError):
                picture.decoded(image, broken, "the picture")


@pytest.mark.every_blender
@pytest.mark.parametrize("channels", [1, 3])
def test_pictures_with_fewer_channels(read, tmp_path, channels):
    """A grey picture has three equal channels, one without alpha is opaque."""
    pixels = random_pixels()[..., :channels]
    write(pixels, tmp_path / "art.exr")
    add_plane(texture_material(bpy.data.images.load(str(tmp_path / "art.exr"))))
    found = read().rig.picture.image
    assert np.array_equal(found[..., :3], np.broadcast_to(pixels[::-1], (SIZE[1], SIZE[0], 3)))
    assert (found[..., 3] == 1).all()


@pytest.mark.every_blender
def test_generated_and_packed_pictures(read, tmp_path):
    """Generated pictures are read from memory, a packed one when its file is gone."""
    plane = add_plane(None)
    pixels = random_pixels()[::-1]
    plane.kiriko.image = generated("floats", is_float=True)
    assert np.array_equal(read().rig.picture.image, pixels)

    plane.kiriko.image = generated("bytes")
    bytes_ = np.rint(pixels.astype(float) * 255) / 255
    wanted = linear_from_srgb(bytes_[..., :3]) * bytes_[..., 3:]

    # three roundings to float32
    assert np.abs(read().rig.picture.image[..., :3] - wanted).max() < 2e-7
    write(random_pixels(), tmp_path / "art.exr")
    packed = bpy.data.images.load(str(tmp_path / "art.exr"))
    packed.pack()
    (tmp_path / "art.exr").unlink()
    packed.reload()
    plane.kiriko.image = packed

    assert read().rig.picture.image.shape == (SIZE[1], SIZE[0], 4)


def test_image_of_the_object_goes_before_the_material(read):
    """An image chosen on the object is the picture, whatever its material shows."""
    plane = add_plane(texture_material(generated("material")))
    own = generated("own", is_float=True)
    own.pixels.foreach_set(np.full(SIZE[0] * SIZE[1] * 4, 0.25, np.float32))
    plane.kiriko.image = own
    assert (read().rig.picture.image == 0.25).all()


def test_texture_behind_simple_nodes(read):
    """The texture is found behind colour nodes, in a group, in a Principled shader.

    A note names the colour nodes.
    """
    group = bpy.data.node_groups.new("group", "ShaderNodeTree")
    group.interface.new_socket("Color", in_out="OUTPUT", socket_type="NodeSocketColor")
    texture = group.nodes.new("ShaderNodeTexImage")
    gamma = group.nodes.new("ShaderNodeGamma")
    texture.image = generated()
    group.links.new(texture.outputs["Color"], gamma.inputs["Color"])
    group.links.new(gamma.outputs[0], group.nodes.new("NodeGroupOutput").inputs["Color"])
    material, tree, output = new_material()
    used = tree.nodes.new("ShaderNodeGroup")
    shader = tree.nodes.new("ShaderNodeBsdfPrincipled")
    used.node_tree = group
    tree.links.new(used.outputs["Color"], shader.inputs["Base Color"])
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    add_plane(material)
    reading = read()

    assert reading.rig.picture.image.shape == (SIZE[1], SIZE[0], 4)
    assert reading.notes == (
        "The material 'paper' changes the colours of 'art'; Kiriko uses the plain image.",
    )


@pytest.mark.parametrize("way", ["named", "used in renders", "moved"])
def test_uv_map_of_the_texture(read, way):
    """The picture's UV is the map its texture asks for, else the one used in renders.

    A Mapping node is noted.
    """
    material = texture_material(generated())
    tree = material.node_tree
    texture = next(n for n in tree.nodes if n.type == "TEX_IMAGE")
    plane = add_plane(material)
    second = plane.data.uv_layers.new(name="second")
    numbers = np.array([1, 0, 1, 1, 0, 1, 0, 0], np.float32)  # turned by a quarter
    second.uv.foreach_set("vector", numbers)

    if way == "named":
        node = tree.nodes.new("ShaderNodeUVMap")
        node.uv_map = "second"
        tree.links.new(node.outputs[0], texture.inputs["Vector"])
    elif way == "used in renders":
        plane.data.uv_layers["second"].active_render = True
    else:
        tree.links.new(tree.nodes.new("ShaderNodeMapping").outputs[0], texture.inputs["Vector"])

    reading = read()
    mesh = reading.rig.picture.mesh
    plain = mesh.vertices[:, :2] / SIZE + 0.5
    if way == "moved":
        assert np.array_equal(mesh.uv, plain[mesh.triangles])
        assert reading.notes == (
            "Nodes of the material 'paper' place 'art'; Kiriko uses the plane's UV map.",
        )
    else:
        corners = {(-1, -1): (1, 0), (1, -1): (1, 1), (1, 1): (0, 1), (-1, 1): (0, 0)}
        wanted = np.array(
            [corners[tuple(np.sign(v[:2]).astype(int))] for v in mesh.vertices], float
        )
        assert np.array_equal(mesh.uv, wanted[mesh.triangles])
        assert ["squeezed to 44 % of its width" in note for note in reading.notes] == [True]


def test_picture_in_the_viewers_pixels(read, scene):
    """An image chosen for the scene is the picture, without a plane.

    An unused plane and another shape are noted.
    """
    add_plane(texture_material(generated("unused")))
    camera = bpy.data.objects.new("eye", bpy.data.cameras.new("lens"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.render.resolution_x, scene.render.resolution_y = 48, 32
    scene.kiriko.picture_source = "IMAGE"

    assert read().rig.pictures == ()
    scene.kiriko.picture_image = generated("render")
    reading = read()
    assert reading.rig.picture.mesh is None
    assert reading.rig.picture.name == "render"
    assert reading.notes == (
        "The picture plane 'poster' is ignored, because the viewers have their own images.",
    )

    scene.render.resolution_y = 64
    assert any("'render' (24 x 16 pixels) is stretched" in note for note in read().notes)


def test_picture_without_an_image(read, errors):
    """A plane without material, without texture or with an empty texture is named, with
    what to do.
    """
    plane = add_plane(None)
    for material in (None, new_material()[0], texture_material(None)):
        plane.data.materials.clear()
        if material is not None:
            plane.data.materials.append(material)
        with pytest.raises(errors.RigError, match="'poster' shows no image"):
            read()


@pytest.mark.parametrize("how", ["missing", "broken"])
def test_picture_file_that_cannot_be_read(read, errors, tmp_path, how):
    """A missing or broken file is named together with its object."""
    path = tmp_path / "art.png"
    if how == "broken":
        path.write_bytes(b"\x89PNG\r\n\x1a\n and then nonsense")
    image = bpy.data.images.new("art", 1, 1)
    image.source = "FILE"
    image.filepath = str(path)
    add_plane(texture_material(image))

    with pytest.raises(
        errors.ImageError,
        match=r"'art' of the picture 'poster' cannot be read: .*art\.png",
    ):
        read()


def test_pictures_without_pixels(read, scene, errors, tmp_path):
    """A render result and numbers that are not finite are refused with a remedy."""
    plane = add_plane(None)
    render(scene, tmp_path)
    plane.kiriko.image = bpy.data.images["Render Result"]
    words = r"'Render Result' .* exists only in .* Save it there \(Image > Save As\) and choose"
    with pytest.raises(errors.ImageError, match=words):
        read()
    scene.kiriko.picture_source = "IMAGE"
    scene.kiriko.picture_image = plane.kiriko.image

    with pytest.raises(errors.ImageError, match="'Render Result' of the scene's picture exists"):
        read()

    scene.kiriko.picture_source = "PLANE"
    plane.kiriko.image = hot = generated("hot", is_float=True)
    pixels = random_pixels()
    pixels[3, 4, 1] = np.nan
    hot.pixels.foreach_set(pixels.ravel())

    with pytest.raises(
        errors.ImageError, match="'hot' of the picture 'poster' has infinite or invalid"
    ):
        read()


def test_tiled_picture(read):
    """Of a picture in several tiles the first is read, and a note says so."""
    plane = add_plane(None)
    plane.kiriko.image = bpy.data.images.new("tiles", *SIZE, tiled=True)
    reading = read()
    assert reading.rig.picture.image.shape == (SIZE[1], SIZE[0], 4)
    assert reading.notes == ("Only the first tile of the image 'tiles' is used.",)


def test_an_image_without_a_file_is_told_to_be_empty(scene):
    """As Blender makes one whose file was never chosen: no path stands in the sentence."""
    picture = small_rig()["PICTURE"]
    picture.kiriko.image = empty = bpy.data.images.new("Empty", 8, 8)
    empty.source = "FILE"
    words = f"The image 'Empty' of the picture '{picture.name}' is empty and has no file"
    with pytest.raises(RuntimeError, match=words):
        bpy.ops.kiriko.solve()
