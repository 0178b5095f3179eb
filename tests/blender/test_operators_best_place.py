"""Best Place and Rotate to Recover: proposed with their gain, made by a second click."""

import re

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from extension import loaded
from kiriko.core.base.errors import RigError
from kiriko.core.blender.read.resize import give_matrix
from small_rigs import cube, small_rig


def place(thing: bpy.types.Object) -> np.ndarray:
    bpy.context.view_layer.update()
    return np.array(thing.matrix_world)


def coverage() -> float:
    bpy.ops.kiriko.solve()
    return bpy.context.scene.kiriko.result.coverage


def off_rig() -> dict[str, bpy.types.Object]:
    """A picture 4 mm beside its display, which is as large as the picture."""
    rig = small_rig(ior=1.0, picture_size=0.02, display_size=0.021)
    rig["PICTURE"].location.x += 0.004
    return rig


def tilted_rig() -> dict[str, bpy.types.Object]:
    """A tilted slab that moves the picture past the display's edge."""
    slab = cube(side=0.1, turn=np.radians(35))
    slab.scale = (1.0, 0.5, 1.0)
    slab.kiriko.use_ior, slab.kiriko.ior = True, 1.5
    bpy.ops.kiriko.add_rig(
        viewer_resolution=64,
        display_resolution=(64, 64),
        field=0.06,
        picture_size=0.02,
        display_size=0.028,
    )
    rig = {thing.kiriko.role: thing for thing in bpy.context.scene.objects}
    # where it would stand without glass: the picture in the middle of the slab
    rig["PICTURE"].location = (0, 0, 0)
    rig["DISPLAY"].location.x = 0
    return rig


def test_a_better_place_is_proposed_and_taken(scene, capfd):
    """The gain is told before anything moves; Take It moves the
    picture, and the solve finds the share that was told.
    """
    rig = off_rig()
    before = place(rig["PICTURE"])
    assert not bpy.ops.kiriko.take_proposal.poll()
    assert bpy.ops.kiriko.best_place() == {"FINISHED"}
    assert (place(rig["PICTURE"]) == before).all()
    text = re.search(
        r"([\d.]+) % of the picture arrives now, ([\d.]+) % with the picture ([\d.]+) mm to the"
        " left",
        capfd.readouterr().out,
    )
    assert float(text[3]) == pytest.approx(3.8, abs=0.6)
    assert float(text[1]) == pytest.approx(100 * coverage(), abs=1.5)

    assert bpy.ops.kiriko.take_proposal() == {"FINISHED"}
    assert place(rig["PICTURE"])[0, 3] == pytest.approx(before[0, 3] - 0.0038, abs=6e-4)
    assert 100 * coverage() == pytest.approx(float(text[2]), abs=1.0)
    assert not bpy.ops.kiriko.take_proposal.poll()
    bpy.ops.kiriko.best_place()
    assert "is already in the best place" in capfd.readouterr().out


def test_a_limit_that_was_reached_is_told(scene, capfd):
    """A picture that stands farther off than it may move by itself comes nearer alone: the sentence
    names the setting with which it comes back, and it does.
    """
    rig = off_rig()
    bpy.ops.kiriko.best_place()
    words = "It moved as far as allowed: raise 'Move up to'."
    assert words not in capfd.readouterr().out

    rig["PICTURE"].location.x += 0.010
    bpy.context.view_layer.update()
    bpy.ops.kiriko.best_place(turn=0.0)
    assert words in capfd.readouterr().out
    bpy.ops.kiriko.best_place(shift=0.016, turn=0.0)
    assert words not in capfd.readouterr().out
    bpy.ops.kiriko.take_proposal()
    assert coverage() > 0.99


def test_a_proposal_is_for_the_rig_as_it_was(scene):
    """Where the picture has moved since it cannot be taken; it can be left, too."""
    rig = off_rig()
    assert not bpy.ops.kiriko.drop_proposal.poll()
    bpy.ops.kiriko.best_place()
    assert bpy.ops.kiriko.take_proposal.poll()
    rig["PICTURE"].location.x += 0.001
    bpy.context.view_layer.update()
    assert not bpy.ops.kiriko.take_proposal.poll()
    rig["PICTURE"].location.x -= 0.001
    bpy.context.view_layer.update()
    assert bpy.ops.kiriko.take_proposal.poll()
    bpy.ops.kiriko.drop_proposal()
    assert not bpy.ops.kiriko.take_proposal.poll()
    assert not bpy.ops.kiriko.drop_proposal.poll()


def test_the_glass_turns_back_what_is_lost(scene, capfd):
    """About the upright axis, by the angle that it says; scale and children's ties stay."""
    rig = tilted_rig()
    lost = coverage()
    assert lost < 0.98
    scale = np.linalg.norm(place(rig["GLASS"])[:3, :3], axis=0)
    middle = place(rig["GLASS"])[:3, 3]
    assert bpy.ops.kiriko.turn_back(take=True) == {"FINISHED"}
    text = re.search(
        r"by ([\d.]+) degrees about the vertical axis recovers 100 % of the lost part: ([\d.]+) %",
        capfd.readouterr().out,
    )
    after = place(rig["GLASS"])
    assert np.linalg.norm(after[:3, :3], axis=0) == pytest.approx(scale, rel=1e-5)
    assert after[:3, 3] == pytest.approx(middle, abs=1e-6)
    angle = np.degrees(rig["GLASS"].matrix_world.to_euler().z)
    assert abs(35 - angle) == pytest.approx(float(text[1]), abs=0.5)
    found = coverage()
    assert found > lost
    assert 100 * found == pytest.approx(float(text[2]), abs=1.0)


def test_what_no_turn_brings_back_is_said(scene, capfd):
    """As a warning, and nothing is proposed; nor where nothing is lost."""
    small_rig(ior=1.0, picture_size=0.02, display_size=0.015)
    assert bpy.ops.kiriko.turn_back(limit=np.radians(2)) == {"FINISHED"}
    assert "Warning: No rotation up to 2 degrees recovers" in capfd.readouterr().out
    assert not bpy.ops.kiriko.take_proposal.poll()


def test_a_part_of_the_lost_part_is_said_to_be_one(scene, capfd):
    """A smaller limit than the glass needs: a warning names the limit, then the axis."""
    tilted_rig()
    assert bpy.ops.kiriko.turn_back(limit=np.radians(5), take=True) == {"FINISHED"}
    assert re.search(
        r"Warning: No rotation up to 5 degrees recovers the whole lost part\. Rotating the glass by"
        r" [\d.]+ degrees about the vertical axis recovers \d+ % of the lost part",
        capfd.readouterr().out,
    )


def test_axes_have_names(kiriko):
    """Of the viewer's own axes; others are oblique."""
    words = loaded("operators.proposal")._axis_words
    names = [str(words(turn, np.eye(3))) for turn in (*np.eye(3), -np.eye(3)[1], np.ones(3))]
    assert names == [
        "the horizontal axis across the view",
        "the vertical axis",
        "the line of sight",
        "the vertical axis",
        "an oblique axis",
    ]


def test_glass_that_is_held_stays(scene):
    """The picture does not move either, where the glass cannot turn."""
    rig = tilted_rig()
    before = {role: place(thing) for role, thing in rig.items()}
    rig["GLASS"].lock_rotation[2] = True
    with pytest.raises(RuntimeError, match="can't be moved: its transform is locked"):
        bpy.ops.kiriko.turn_back(take=True)
    assert all((place(thing) == before[role]).all() for role, thing in rig.items())


def test_a_changed_scene_is_looked_at_again(scene):
    """Where another part has moved, or its glass is another, nothing is moved, and it says why;
    where all is as it was again, it can be taken.
    """
    rig = off_rig()
    bpy.ops.kiriko.best_place()
    before = place(rig["PICTURE"])
    rig["DISPLAY"].location.x += 0.003
    with pytest.raises(RuntimeError, match="Best Place is outdated"):
        bpy.ops.kiriko.take_proposal()
    rig["DISPLAY"].location.x -= 0.003
    rig["GLASS"].kiriko.ior = 1.5
    with pytest.raises(RuntimeError, match="Best Place is outdated"):
        bpy.ops.kiriko.take_proposal()
    assert (place(rig["PICTURE"]) == before).all()
    rig["GLASS"].kiriko.ior = 1.0
    assert bpy.ops.kiriko.take_proposal() == {"FINISHED"}


def below_an_uneven_parent(scene: bpy.types.Scene, data: bpy.types.ID | None) -> bpy.types.Object:
    """The glass of a small rig, as a child of something scaled unevenly."""
    glass = small_rig()["GLASS"]
    parent = bpy.data.objects.new("parent", data)
    scene.collection.objects.link(parent)
    parent.scale = (1.0, 2.0, 1.0)
    glass.parent = parent
    return glass


def test_below_an_uneven_parent_a_turn_is_exact(scene):
    """Its own location, turn and scale would have to be sheared: the way to its parent is. One
    that is held all the same is where it was.
    """
    glass = below_an_uneven_parent(scene, None)
    place(glass)
    turned = Matrix.Rotation(0.3, 4, "X") @ glass.matrix_world
    own = glass.matrix_basis.copy()
    give_matrix(bpy.context, glass, turned)
    assert np.abs(place(glass) - np.array(turned)).max() < 1e-7
    assert glass.matrix_basis == own

    before, way = place(glass), glass.matrix_parent_inverse.copy()
    glass.constraints.new("LIMIT_LOCATION").use_max_z = True
    glass.constraints[0].max_z = 0.0
    raised = Matrix.Rotation(0.3, 4, "X") @ Matrix.Translation((0, 0, 0.1)) @ glass.matrix_world
    with pytest.raises(RigError, match="a constraint or a driver holds it"):
        give_matrix(bpy.context, glass, raised)
    assert (place(glass) == before).all()
    assert glass.matrix_parent_inverse == way
