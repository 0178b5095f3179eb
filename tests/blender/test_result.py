import json
import re
from pathlib import Path
from types import ModuleType

import bpy
import numpy as np
import pytest

from extension import loaded
from small_rigs import new_object, pixels, primitive, small_rig


@pytest.fixture
def result(scene) -> ModuleType:
    return loaded("core.blender.result.write_result")


def test_image_keeps_every_number(result):
    """Pixels written to a datablock come back bit for bit,
    row 0 at the top, also above 1 and below 0.
    """
    numbers = np.random.default_rng(1).normal(0, 10, (5, 7, 3)).astype(np.float32)
    image = result.replace_image(None, "numbers", numbers)
    assert np.array_equal(pixels(image)[..., :3], numbers)
    assert image.colorspace_settings.name.startswith("Linear")


@pytest.mark.parametrize("shape", [(517, 1021), (3000, 2), (1, 1), (40, 30)])
def test_a_thumbnail_has_the_mean_light_of_its_pixels(result, shape):
    """Stripes one pixel wide are as grey as sRGB writes half of their light, to a step of 8 bits,
    and row 0 is at the top. A newer image has its own, and so has one that undo brings back.
    """
    numbers = np.zeros((*shape, 3), np.float32)
    numbers[:, ::2] = 1
    numbers[: shape[0] // 2, :, 2] = 0

    def off(expected: np.ndarray) -> float:
        image = bpy.data.images["stripes"]
        width, height = image.preview.image_size
        found = np.empty(4 * width * height, np.float32)
        image.preview.image_pixels_float.foreach_get(found)
        step = -(-max(shape) // 256)
        assert (width, height) == (-(-shape[1] // step), -(-shape[0] // step))
        parts = [
            [
                block.mean(axis=(0, 1))
                for block in np.split(row, range(step, shape[1], step), axis=1)
            ]
            for row in np.split(expected, range(step, shape[0], step))
        ]
        linear = np.array(parts, float)
        srgb = np.where(linear > 0.0031308, 1.055 * linear ** (1 / 2.4) - 0.055, 12.92 * linear)
        return np.abs(found.reshape(height, width, 4)[::-1, :, :3] - srgb).max()

    bpy.context.scene.kiriko.picture_image = result.replace_image(None, "stripes", numbers)
    bpy.ops.ed.undo_push(message="first")
    assert off(numbers) < 1 / 255
    image = bpy.data.images["stripes"]
    bpy.context.scene.kiriko.picture_image = result.replace_image(image, "stripes", numbers / 4)
    bpy.ops.ed.undo_push(message="second")
    assert off(numbers / 4) < 1 / 255
    bpy.ops.ed.undo()
    assert off(numbers) < 1 / 255


def test_new_image_takes_the_place_of_the_old(result):
    """Whoever used the old image uses the new one, under the same name."""
    old = result.replace_image(None, "picture", np.zeros((2, 2, 3)))
    bpy.context.scene.kiriko.picture_image = old
    new = result.replace_image(old, "picture", np.ones((3, 3, 3)))
    assert bpy.context.scene.kiriko.picture_image == new
    assert [image.name for image in bpy.data.images] == ["picture"]


def test_display_that_shares_its_mesh_leaves_the_other_alone(result):
    """The source goes on the display only, not on another object with the same mesh."""
    mesh = bpy.data.meshes.new("sheet")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [], [(0, 1, 2)])
    mine = bpy.data.materials.new("Mine")
    mesh.materials.append(mine)
    display, other = (bpy.data.objects.new(name, mesh) for name in ("display", "other"))
    notes = loaded("core.blender.result.on_display").put_on_display(
        display, result.replace_image(None, "source", np.zeros((2, 2, 3)))
    )
    assert other.material_slots[0].material == mine
    assert display.material_slots[0].material != mine
    assert len(notes) == 1
    assert "'Mine'" in notes[0]


def test_details_say_how_far_the_tessellation_is_off(scene):
    """Nothing for a cube; for a smooth ball a number of
    display pixels, which falls as the ball gets finer.
    """
    small_rig()

    def error() -> float:
        assert bpy.ops.kiriko.solve() == {"FINISHED"}
        return json.loads(scene.kiriko.result.details)["tessellation_error"]

    assert error() == 0
    for thing in [thing for thing in scene.objects if thing.kiriko.role == "GLASS"]:
        bpy.data.objects.remove(thing)

    found = []
    for n in (8, 16, 32):
        mesh = primitive("uvsphere", u_segments=2 * n, v_segments=n, radius=0.025)
        mesh.shade_smooth()
        ball = new_object(mesh, "GLASS")
        ball.kiriko.use_ior = True
        found.append(error())
        bpy.data.objects.remove(ball)

    assert found[0] > 2 * found[1] > 4 * found[2] > 0


def test_lengths_in_notes_are_in_the_scenes_unit(scene):
    """A rig 10 km away, in which glass nearer than some inches touches."""
    parts = small_rig()
    for part in parts.values():
        part.location.x += 1e4
    scene.unit_settings.system, scene.unit_settings.length_unit = "IMPERIAL", "INCHES"
    bpy.ops.kiriko.solve()
    (note,) = (
        note
        for note in scene.kiriko.result.notes.splitlines()
        if "Blender rounds coordinates" in note
    )
    (inches,) = re.findall(r"glass closer than ([0-9.]+) in counts", note)
    assert 0.01 < float(inches) < 1


def paint_over(image: bpy.types.Image, folder: Path | None = None) -> None:
    image.pixels.foreach_set(np.full(len(image.pixels), 0.7, np.float32))
    image.update()


def spoil_and_pack(image: bpy.types.Image, folder: Path) -> None:
    paint_over(image)
    image.pack()


def spoil_and_save(image: bpy.types.Image, folder: Path) -> None:
    paint_over(image)
    image.save(filepath=str(folder / "elsewhere.exr"))


def take_for_srgb(image: bpy.types.Image, folder: Path) -> None:
    image.colorspace_settings.name = "sRGB"


def unpack(image: bpy.types.Image, folder: Path) -> None:
    image.unpack(method="REMOVE")


@pytest.mark.parametrize(
    "spoil", [paint_over, spoil_and_pack, spoil_and_save, take_for_srgb, unpack]
)
def test_solve_repairs_its_image(scene, kiriko, tmp_path, spoil):
    """Whatever somebody did to the image of a result, *Solve* brings it back, though nothing else
    changed; unchanged, it stays the same packed file.
    """
    small_rig()
    bpy.ops.kiriko.solve()
    image = scene.kiriko.result.source
    expected, file = pixels(image).copy(), image.packed_file.data
    name = image.colorspace_settings.name
    bpy.ops.kiriko.solve()
    assert scene.kiriko.result.source == image
    assert image.packed_file.data == file
    spoil(image, tmp_path)
    bpy.ops.kiriko.solve()
    image = scene.kiriko.result.source
    assert np.array_equal(pixels(image), expected)
    assert image.colorspace_settings.name == name
    assert image.packed_file is not None
