"""How light the picture is wanted and how the display shines: the same to Kiriko, Cycles, files."""

from types import ModuleType

import bpy
import numpy as np
import pytest

from extension import loaded
from small_rigs import pixels, small_rig

GREY = 0.5


def grey_card(**options: object) -> dict[str, bpy.types.Object]:
    """A rig whose picture is a grey card, and whose glass hardly bends light."""
    parts = small_rig(ior=1.0001, **options)
    image = bpy.data.images.new("grey", 8, 8, float_buffer=True)
    image.pixels.foreach_set(np.tile(np.array([GREY, GREY, GREY, 1], np.float32), 64))
    parts["PICTURE"].kiriko.image = image
    return parts


def solved(scene: bpy.types.Scene, kiriko: ModuleType) -> tuple[np.ndarray, np.ndarray]:
    """What the viewer sees in the middle of the picture, by Kiriko and by Cycles; (n, 3) each."""
    assert bpy.ops.kiriko.solve() == {"FINISHED"}
    work = kiriko.operators.work
    reading = work.read(bpy.context)
    steps = work.session().solve(reading.rig, work.settings_of(scene))
    seen = kiriko.core.base.steps.run_steps(steps).seen()
    preview = loaded("core.blender.preview.cycles_preview")
    rendered = preview.render_preview(
        scene, reading, scene.kiriko.result.source, samples=16, fresnel=False, surroundings=False
    )
    middle = np.s_[28:36, 28:36, :3]
    return seen[middle].reshape(-1, 3), rendered[middle].reshape(-1, 3)


@pytest.mark.parametrize(
    ("tone", "black_level"),
    [((1.0, 1.0, 0.0), 0.0), ((0.8, 1.0, 0.0), 0.1), ((0.9, 2.2, 0.1), 0.02)],
)
def test_a_grey_card_is_seen_as_light_as_is_wished(scene, kiriko, tone, black_level):
    """Within 1 %, by Kiriko and in Cycles, whatever the picture's and the display's settings."""
    parts = grey_card()
    ours = parts["PICTURE"].kiriko.picture
    ours.brightness, ours.gamma, ours.black_level = tone
    parts["DISPLAY"].kiriko.display.black_level = black_level
    brightness, gamma, picture_black = tone
    wished = brightness * ((GREY - picture_black) / (1 - picture_black)) ** (1 / gamma)

    seen, rendered = solved(scene, kiriko)
    assert seen == pytest.approx(wished, rel=0.01)
    assert rendered == pytest.approx(wished, rel=0.01)


def test_black_shines_where_nothing_is_wanted(scene, kiriko):
    """A black card is seen as light as the display's black is; the display in the scene, too."""
    parts = grey_card()
    parts["PICTURE"].kiriko.picture.brightness = 0.0
    display = parts["DISPLAY"]
    display.kiriko.display.black_level = 0.2
    seen, rendered = solved(scene, kiriko)
    assert not pixels(scene.kiriko.result.source)[..., :3].any()
    assert seen == pytest.approx(0.2, rel=1e-3)
    assert rendered == pytest.approx(0.2, rel=1e-3)

    def raised() -> list[float]:
        nodes = display.material_slots[0].material.node_tree.nodes
        return [n.inputs[2].default_value[0] for n in nodes if n.type == "VECT_MATH"]

    assert raised() == pytest.approx([0.2])
    display.kiriko.display.black_level = 0.0
    bpy.ops.kiriko.solve()
    assert raised() == []


def test_an_image_in_the_viewers_pixels_has_a_tone_of_its_own(scene, kiriko):
    """The scene's settings count for it, and the plane's do not."""
    parts = grey_card()
    parts["PICTURE"].kiriko.picture.brightness = 0.1
    scene.kiriko.picture_source = "IMAGE"
    scene.kiriko.picture_image = bpy.data.images["grey"]
    scene.kiriko.picture.brightness = 0.5
    image = kiriko.operators.work.read(bpy.context).rig.picture.image
    assert image[..., :3] == pytest.approx(0.5 * GREY)


@pytest.mark.parametrize("encoding", ["SRGB", "POWER"])
def test_a_file_is_encoded_for_the_display(scene, tmp_path, encoding):
    """Numbers of a 16-bit file, decoded as the display does, are the source image; to 16 bits.

    The result is not old by it: light lands where it did.
    """
    oiio = pytest.importorskip("OpenImageIO")
    parts = grey_card()
    bpy.ops.kiriko.solve()
    ours = parts["DISPLAY"].kiriko.display
    ours.encoding, ours.gamma = encoding, 2.0
    path = str(tmp_path / "source.png")
    assert bpy.ops.kiriko.export(filepath=path) == {"FINISHED"}
    scene.kiriko.export_format = "PNG16"
    assert bpy.ops.kiriko.export(filepath=path, overwrite=True) == {"FINISHED"}

    file = oiio.ImageInput.open(path)
    numbers = np.asarray(file.read_image(format="float"), float)[..., :3]
    description = file.spec().get_string_attribute("ImageDescription")
    srgb = np.where(numbers <= 0.04045, numbers / 12.92, ((numbers + 0.055) / 1.055) ** 2.4)
    light = numbers**2.0 if encoding == "POWER" else srgb
    source = np.clip(pixels(scene.kiriko.result.source)[..., :3], 0, 1)
    assert light == pytest.approx(source, abs=2.4 / 65535)
    assert ("gamma 2" in description) == (encoding == "POWER")
