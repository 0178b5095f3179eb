"""An image for each of several viewers, in that viewer's own pixels, in Blender."""

from collections.abc import Iterator
from typing import Any

import bpy
import numpy as np
import pytest

from extension import loaded
from small_rigs import pixels, small_rig


@pytest.fixture
def rig(scene) -> dict[str, bpy.types.Object]:
    """A rig around a cube of two viewers, whose pictures are images; the objects by role."""
    parts = small_rig()
    thing = ours().viewer.copy()
    thing.name = "mine"
    thing.location.x += 0.01
    scene.collection.objects.link(thing)
    bpy.context.view_layer.objects.active = thing
    bpy.ops.kiriko.add_viewer()
    ours().picture_source = "IMAGE"
    return parts


def ours() -> bpy.types.PropertyGroup:
    return bpy.context.scene.kiriko


def plain(name: str, colour: tuple[float, float, float], size: int = 64) -> bpy.types.Image:
    """An image of one colour, linear."""
    image = bpy.data.images.new(name, size, size, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    image.pixels.foreach_set(np.tile([*colour, 1.0], size * size).astype(np.float32))
    image.update()
    return image


def give(first: bpy.types.Image | None, second: bpy.types.Image | None) -> None:
    for one, image in zip(ours().viewers, (first, second), strict=True):
        one.image = image


def work() -> Any:
    return loaded("operators.work")


def source() -> np.ndarray:
    return pixels(ours().result.source).copy()


def test_each_viewer_sees_its_own_image(kiriko, rig):
    """Red for the one, blue for the other: where both see a display pixel it shows the mean by
    weight, elsewhere the one colour; each viewer's ideal image is its own.
    """
    give(plain("red", (1, 0, 0)), plain("blue", (0, 0, 1)))
    ours().viewers[1].weight = 3.0
    read = work().read(bpy.context).rig
    assert {one.name: one.image[0, 0, :3].tolist() for one in read.picture.own} == {
        "Kiriko Viewer": [1, 0, 0],
        "mine": [0, 0, 1],
    }
    assert bpy.ops.kiriko.solve() == {"FINISHED"}
    colours = source()[..., :3]
    lit = colours.max(axis=2) > 0
    assert lit.mean() > 0.1
    np.testing.assert_allclose(colours[lit].sum(axis=1), 1, atol=1e-5)
    assert not colours[..., 1].any()
    assert (np.abs(colours[lit] - [0.25, 0, 0.75]).max(axis=1) < 0.01).mean() > 0.2


def test_images_go_along_with_their_viewers(kiriko, rig):
    """Moved in the list, which solves to the same. The last viewer's is the scene's image."""
    red, blue = plain("red", (1, 0, 0)), plain("blue", (0, 0, 1))
    give(red, blue)
    bpy.ops.kiriko.solve()
    before = source()
    bpy.ops.kiriko.move_viewer(step=-1)
    assert [one.image.name for one in ours().viewers] == ["blue", "red"]
    bpy.ops.kiriko.solve()
    np.testing.assert_allclose(source(), before, atol=1e-6)

    give(red, blue)  # to each the other's
    bpy.ops.kiriko.solve()
    assert np.abs(source() - before).max() > 0.5

    ours().viewer_shown = 0
    bpy.ops.kiriko.remove_viewer()
    assert (len(ours().viewers), ours().picture_image) == (0, blue)


def test_eyes_that_are_made_anew_keep_all_images(kiriko, rig):
    """Theirs, the viewer's they stand around, and that of all. A grid of heads has none of them."""
    ours().viewer_shown = 1
    bpy.ops.kiriko.remove_viewer()
    bpy.ops.kiriko.two_eyes()
    ours().picture_image = plain("of all", (1, 1, 1))
    for name, one in zip(("own", "left", "right"), ours().viewers, strict=True):
        one.image = plain(name, (0, 0, 0))
    bpy.ops.kiriko.two_eyes()
    assert [one.image.name for one in ours().viewers] == ["own", "left", "right"]
    assert ours().picture_image.name == "of all"

    ours().picture_source = "PLANE"
    bpy.ops.kiriko.viewer_grid(heads=(2, 1, 1))
    assert [one.image and one.image.name for one in ours().viewers] == ["own", None, None]
    assert ours().picture_image.name == "of all"


def test_viewers_without_images_see_that_of_the_scene(kiriko, rig):
    """So it is before any is chosen; an image of a viewer who is off does not count."""
    grey, red = plain("grey", (0.5, 0.5, 0.5)), plain("red", (1, 0, 0))
    ours().picture_image = grey
    assert work().read(bpy.context).rig.picture.own == ()
    give(None, red)
    ours().viewers[1].is_on = False
    picture = work().read(bpy.context).rig.picture
    assert (picture.name, picture.own) == ("grey", ())

    # a plane is the same for all
    ours().viewers[1].is_on = True
    ours().picture_source = "PLANE"
    assert work().read(bpy.context).rig.picture.own == ()


@pytest.fixture
def solved(kiriko, rig) -> Iterator[np.ndarray]:
    """The source image of a solve for both, which is there afterwards as before."""
    give(plain("red", (1, 0, 0)), plain("blue", (0, 0, 1)))
    bpy.ops.kiriko.solve()
    before = source()
    yield before
    assert np.array_equal(source(), before)


def test_a_missing_image_is_one_sentence(kiriko, solved):
    """Of one that is not chosen, of one whose file is gone, and where nobody has one."""
    second = ours().viewers[1]
    second.image = None
    words = r"The viewer 'mine' has no image of its own, but others do: choose one in the list of"
    with pytest.raises(RuntimeError, match=words):
        bpy.ops.kiriko.solve()

    lost = bpy.data.images.new("lost", 4, 4)
    lost.source, lost.filepath = "FILE", "//not_there.png"
    second.image = lost
    words = r"The image 'lost' of the viewer 'mine' cannot be read: .*not_there\.png"
    with pytest.raises(RuntimeError, match=words):
        bpy.ops.kiriko.solve()

    give(None, None)
    with pytest.raises(RuntimeError, match="No picture: choose an image"):
        bpy.ops.kiriko.solve()


def test_an_image_of_another_size_is_told_and_stretched(kiriko, rig):
    give(plain("red", (1, 0, 0)), plain("blue", (0, 0, 1), 32))
    reading = work().read(bpy.context)
    told = [str(note) for note in reading.notes if "stretched" in str(note)]
    size = next(v for v in reading.rig.viewers if v.name == "mine")
    assert told == [
        "The image 'blue' (32 x 32 pixels) is stretched to fit the viewer 'mine'"
        f" ({size.width} x {size.height})."
    ]
    assert bpy.ops.kiriko.solve() == {"FINISHED"}


def test_a_result_is_stale_where_a_viewer_gets_another_image(kiriko, rig):
    scene_now = work().scene_now
    chosen = loaded("operators.chosen").chosen_settings
    give(plain("red", (1, 0, 0)), plain("blue", (0, 0, 1)))
    before, listed = scene_now(bpy.context), chosen(bpy.context.scene)
    ours().viewers[1].image = plain("green", (0, 1, 0))
    assert not scene_now(bpy.context).is_same(before)
    assert chosen(bpy.context.scene) != listed
    ours().viewers[1].image = bpy.data.images["blue"]
    assert scene_now(bpy.context).is_same(before)
    bpy.ops.kiriko.move_viewer(step=-1)
    assert scene_now(bpy.context).is_same(before)


def test_the_lattice_takes_the_place_of_all_images(kiriko, rig):
    """Calibrate needs it, whichever viewer takes the photograph."""
    give(plain("red", (1, 0, 0)), plain("blue", (0, 0, 1)))
    bpy.ops.kiriko.lattice_picture()
    assert {one.image.name for one in ours().viewers} == {ours().picture_image.name}
