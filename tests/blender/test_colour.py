"""The picture's colours, and those that Kiriko writes, in each working space of Blender and under a
studio's colour configuration (tests/known/studio.ocio), for which these tests run once more.
"""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest

from extension import loaded
from small_rigs import cube, new_object

STUDIO = Path(__file__).parents[1] / "known" / "studio.ocio"
IS_STUDIO = os.environ.get("OCIO") == str(STUDIO)
WORKING = ("Linear Rec.709", "Linear Rec.2020", "ACEScg") if bpy.app.version >= (5, 0) else ("",)
QUADS = np.array([[(200, 60, 40), (40, 180, 90)], [(30, 70, 210), (128, 128, 128)]])
# red, green, blue and white, as x and y
PRIMARIES = {
    "Rec.709": (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290),
    "P3": (0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.3290),
    "Rec.2020": (0.708, 0.292, 0.17, 0.797, 0.131, 0.046, 0.3127, 0.3290),
    "AP1": (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767),
}
BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)


def to_xyz(name: str) -> np.ndarray:
    """From linear colours to XYZ of the white D65 (3, 3), adapted by Bradford's matrix."""
    xy = np.reshape(PRIMARIES[name], (4, 2)).T
    xyz = np.vstack([xy, 1 - xy.sum(axis=0)]) / xy[1]
    made = xyz[:, :3] * np.linalg.solve(xyz[:, :3], xyz[:, 3])
    d65 = np.array([0.3127, 0.3290, 1 - 0.3127 - 0.3290]) / 0.3290
    gain = (BRADFORD @ d65) / (BRADFORD @ xyz[:, 3])
    return np.linalg.inv(BRADFORD) @ np.diag(gain) @ BRADFORD @ made


def to_rec709(name: str) -> np.ndarray:
    return np.linalg.inv(to_xyz("Rec.709")) @ to_xyz(name)


def linear(encoded: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def quads(side: int = 32) -> np.ndarray:
    """Four plain colours (2 side, 2 side, 3), numbers 0..1."""
    return np.kron(QUADS / 255, np.ones((side, side, 1))).astype(np.float32)


def write(path: Path, pixels: np.ndarray, kind: str) -> Path:
    spec = oiio.ImageSpec(*pixels.shape[1::-1], pixels.shape[2], kind)
    spec.attribute("CompressionQuality", 100)
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec), oiio.geterror()
    assert out.write_image(pixels)
    assert out.close()
    return path


def numbers(path: Path) -> np.ndarray:
    """A file's numbers, those of its edge left out, where colours mix."""
    pixels = np.asarray(oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT))[..., :3]
    return pixels.reshape(-1, 3)


def has_quads(found: np.ndarray, off: float) -> bool:
    """Are all four colours among encoded numbers (n, 3) of a file, each in a fortieth of them?"""
    near = [np.abs(255 * found - one).max(axis=1) <= off for one in QUADS.reshape(-1, 3)]
    return all(one.mean() > 0.025 for one in near)


@pytest.fixture(params=WORKING)
def working(scene, request) -> str:
    """A new file with this working space."""
    if IS_STUDIO and request.param != WORKING[0]:
        pytest.skip("the configuration has its own")
    if request.param not in ("", WORKING[0]):
        bpy.ops.wm.set_working_color_space(working_space=request.param, convert_colors=True)
    return request.param


@pytest.fixture
def read(kiriko, working) -> Callable[[bpy.types.Image], np.ndarray]:
    module = loaded("core.blender.read.scene_picture")
    return lambda image: module.read_pixels(image, "the picture")[..., :3]


def straight_rig() -> None:
    """A cube right in front of the display: each place of the picture is seen where it is."""
    cube()
    bpy.ops.kiriko.add_rig(kind="BEHIND_GLASS", viewer_resolution=64, display_resolution=(64, 64))


@pytest.mark.skipif(IS_STUDIO, reason="it is what this test runs")
def test_a_studios_configuration():
    """All of these tests hold where no colour space has a name that Blender's own would have, and
    views can be looked through, and movies keep their pixels.
    """
    own = Path(__file__).parent
    others = (
        "test_looking_through.py::test_there_and_back",
        "test_movies.py::test_each_pixel_keeps_its_colour[FFV1-0]",
    )
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", __file__]
    command += [str(own / other) for other in others]
    run = subprocess.run(
        command, env={**os.environ, "OCIO": str(STUDIO)}, capture_output=True, text=True
    )
    assert run.returncode == 0, run.stdout[-3000:] + run.stderr[-2000:]
    assert " passed" in run.stdout


def test_every_way_writes_the_pictures_own_colours(working, run, kiriko, tmp_path):
    """An 8-bit picture that is seen straight through is what the button, a faster update, a file
    that is opened again, the command line and the preview write, as sRGB numbers.
    """
    straight_rig()
    bpy.ops.kiriko.open_picture(filepath=str(write(tmp_path / "p.png", quads(), "uint8")))
    bpy.ops.kiriko.solve()
    scene = bpy.context.scene

    def exported(name: str) -> np.ndarray:
        bpy.ops.kiriko.export(filepath=str(tmp_path / name))
        return numbers(tmp_path / name)

    assert has_quads(exported("button.png"), off=1)
    assert has_quads(exported("button_16.tif"), off=1)
    light = exported("button.exr")
    # half a step of 16 bits
    assert np.abs(light - linear(exported("16.tif"))).max() < 2e-5

    result = loaded("core.blender.result.write_result")
    image = scene.kiriko.result.source
    result.update_source(scene, light.reshape(image.size[1], image.size[0], 3))
    assert has_quads(exported("updated.png"), off=1)
    result.pack_source(scene)
    assert has_quads(exported("packed.png"), off=1)

    path = tmp_path / "solved.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))
    assert has_quads(exported("opened.png"), off=1)

    assert run("solve", "--out", tmp_path / "out") == 0
    for name in ("source.png", "seen.png", "ideal.png"):
        assert has_quads(numbers(tmp_path / "out" / name), off=1), name
    assert np.abs(numbers(tmp_path / "out" / "source.exr") - light).max() < 1e-5

    # Cycles traces the corners of the cube: 2 of 255 are the noise of one filtered ray a pixel
    bpy.ops.kiriko.preview(filepath=str(tmp_path / "preview.png"), reflections=False)
    assert has_quads(numbers(tmp_path / "preview.png"), off=2)


# Blender 4.2's matrices from other primaries are good to 2.4e-4
KINDS = [
    ("p.png", "uint8", 3e-4),
    ("p.png", "uint16", 3e-4),
    ("p.tif", "uint8", 3e-4),
    ("p.tif", "uint16", 3e-4),
    ("p.jpg", "uint8", 0.02),  # the best quality is off by 2 of 255
]


@pytest.mark.parametrize(("name", "kind", "off"), KINDS)
def test_pictures_of_the_screen_are_read_as_srgb(read, tmp_path, name, kind, off):
    """Files in the space that Blender gives a screen's are the sRGB light of their numbers."""
    image = bpy.data.images.load(str(write(tmp_path / name, quads(), kind)))
    off_by = np.abs(read(image) - linear(quads()))
    # JPEG mixes the colours of two pixels
    assert np.delete(np.delete(off_by, [31, 32], 0), [31, 32], 1).max() < off


LINEAR = [("p.exr", "half", 1e-3), ("p.exr", "float", 1e-5), ("p.hdr", "float", 8e-3)]


@pytest.mark.parametrize(("name", "kind", "off"), LINEAR)
def test_linear_pictures_are_read_by_their_primaries(read, tmp_path, name, kind, off):
    """Linear files are Rec.709 by Blender's own default, and the working space of a studio's."""
    image = bpy.data.images.load(str(write(tmp_path / name, linear(quads()).astype("f4"), kind)))
    wanted = linear(quads()) @ (to_rec709("AP1").T if IS_STUDIO else np.eye(3))
    assert np.abs(read(image) - wanted).max() < off + 3e-4


def from_acescct(encoded: np.ndarray) -> np.ndarray:
    """ACES S-2016-001."""
    low = (encoded - 0.0729055341958355) / 10.5402377416545
    return np.where(encoded <= 0.155251141552511, low, 2 ** (encoded * 17.52 - 9.72))


SPACES = {
    "Display P3": ("P3", linear),
    "Linear Rec.2020": ("Rec.2020", np.asarray),
    "ACEScg": ("AP1", np.asarray),
}
if bpy.app.version >= (5, 0):
    SPACES["ACEScct"] = "AP1", from_acescct
if IS_STUDIO:
    SPACES = {"wide screen": ("P3", linear), "light": ("AP1", np.asarray)}


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("is_float", [False, True])
def test_images_in_other_spaces_are_read_by_closed_forms(read, tmp_path, space, is_float):
    """An image is the light of its numbers by curve and primaries of its space, at 8 bits as at
    16, and whatever the working space is.
    """
    kind = "uint16" if is_float else "uint8"
    image = bpy.data.images.load(str(write(tmp_path / "p.png", quads(), kind)))
    image.colorspace_settings.name = space
    primaries, curve = SPACES[space]
    found = read(image)
    assert image.is_float == is_float
    wanted = curve(quads()) @ to_rec709(primaries).T
    # as above, and Blender's tables
    assert (np.abs(found - wanted) < 4e-4 + 1e-3 * np.abs(wanted)).all()


def spaces_of_cycles() -> list[str]:
    if IS_STUDIO:
        return ["wide screen", "light", "archive", "numbers"]
    newer = ["Gamma 2.2 Encoded AdobeRGB"] if bpy.app.version >= (5, 0) else []
    return ["Display P3", "Rec.1886", "Rec.2020", "Non-Color", *newer]


@pytest.mark.parametrize("space", spaces_of_cycles())
def test_bytes_in_any_space_are_the_light_that_cycles_sends(read, scene, tmp_path, space):
    """A plane that emits an 8-bit image of random colours sends, in the working space, the light
    that the picture has in Rec.709.
    """
    noise = np.random.default_rng(7).random((16, 16, 3)).astype(np.float32)
    image = bpy.data.images.load(str(write(tmp_path / "p.png", noise, "uint8")))
    image.colorspace_settings.name = space

    mesh = bpy.data.meshes.new("plane")
    square = [(-0.5, -0.5, 0), (0.5, -0.5, 0), (0.5, 0.5, 0), (-0.5, 0.5, 0)]
    mesh.from_pydata(square, [], [range(4)])
    mesh.uv_layers.new().uv.foreach_set("vector", [0, 0, 1, 0, 1, 1, 0, 1])
    mesh.materials.append(emission(image))
    new_object(mesh)
    camera = new_object(bpy.data.cameras.new("eye"))
    camera.location.z, camera.data.type, camera.data.ortho_scale = 2.0, "ORTHO", 1.0
    scene.camera, render = camera, scene.render
    render.engine, render.resolution_x, render.resolution_y = "CYCLES", 16, 16
    scene.cycles.samples, scene.cycles.use_denoising = 1, False
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 0.01
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
    render.filepath = str(tmp_path / "render.exr")
    bpy.ops.render.render(write_still=True)

    name = bpy.data.colorspace.working_space if bpy.app.version >= (5, 0) else "Linear Rec.709"
    primaries = {"Linear Rec.709": "Rec.709", "Linear Rec.2020": "Rec.2020", "ACEScg": "AP1"}
    matrix = to_rec709("AP1" if IS_STUDIO else primaries[name])
    sent = numbers(tmp_path / "render.exr").reshape(16, 16, 3) @ matrix.T
    found = read(image)
    assert np.ptp(found) > 0.1
    # Cycles keeps half floats, good to 2^-11, of which the matrix makes up to 2.3 as much; the rest
    # is of Blender's matrices, as above
    off = np.abs(found - sent) - 1.2e-3 * np.abs(sent).max(axis=2, keepdims=True)
    assert off.max() < 4e-4


def emission(image: bpy.types.Image) -> bpy.types.Material:
    material = bpy.data.materials.new("light")
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    texture, shader, output = (
        tree.nodes.new(f"ShaderNode{kind}") for kind in ("TexImage", "Emission", "OutputMaterial")
    )
    texture.image, texture.interpolation = image, "Closest"
    tree.links.new(texture.outputs["Color"], shader.inputs["Color"])
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return material


@pytest.mark.skipif(bpy.app.version < (5, 0), reason="no working space to choose")
def test_a_result_outlives_its_working_space(scene, tmp_path):
    """A result has its colours after the working space was changed, solved again or not."""
    straight_rig()
    bpy.ops.kiriko.open_picture(filepath=str(write(tmp_path / "p.png", quads(), "uint8")))
    bpy.ops.kiriko.solve()
    path = tmp_path / "p.blend"
    for space in () if IS_STUDIO else WORKING[1:]:
        bpy.ops.wm.set_working_color_space(working_space=space, convert_colors=True)
        for again in (False, True):
            if again:
                bpy.ops.kiriko.solve()
            bpy.ops.wm.save_as_mainfile(filepath=str(path))
            bpy.ops.wm.open_mainfile(filepath=str(path))
            bpy.ops.kiriko.export(filepath=str(tmp_path / f"{space}{again}.png"), allow_stale=True)
            assert has_quads(numbers(tmp_path / f"{space}{again}.png"), off=1), (space, again)
