"""Notes on a solution: each names the cause that was measured, and a remedy
that helps.
"""

from dataclasses import replace
from types import MappingProxyType, SimpleNamespace

import numpy as np
import pytest

from kiriko.core.base.words import percent
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.trace import trace_all
from kiriko.core.map.view_map import NO_ERROR
from kiriko.core.rig.rig import Mesh
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.accuracy import Accuracy, measure
from kiriko.core.solve.remarks import BEYOND, is_facetted, remarks_on
from kiriko.core.solve.tessellation import Tessellation, tessellation
from known import closed_forms
from known.extremes.cases import joined
from known.reference_rigs import (
    ball_rig,
    bottle,
    box,
    icosphere,
    lattice_image,
    mean_normals,
    rig,
)
from known.work import drain, solve


def small(**options):
    return ball_rig(3, pixels=48, display_pixels=48, image=lattice_image(64), **options)


def test_what_a_display_cannot_show_is_told():
    """With brightness a white picture asks for more than
    white: the note says how much of the image that is.
    """
    white = np.ones((4, 4, 4), np.float32)
    a_rig = rig(box([0.3, 0.02, 0.3]), pixels=16, display_pixels=16, image=white)
    assert not solve(a_rig).notes
    (note,) = solve(a_rig, brightness=True).notes
    assert "brighter than white" in note
    assert (
        "clipped: turn Brightness off, lower the Picture Brightness of 'picture', or export" in note
    )


@pytest.mark.parametrize("part", [0.0, 0.009, 0.011, 1 / 3])
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("axis", [0, 1])
def test_what_the_frame_cuts_off_is_told(projection, part, axis):
    """Of a picture that is 0.03 m of a field of 0.05 m, seen from before its
    middle: the viewer is moved in its own plane until a part is outside.
    """
    a_rig = small(projection=projection, field=0.05, picture=0.03)
    viewer = a_rig.viewer
    aside = (0.05 - 0.03) / 2 + part * 0.03
    moved = replace(viewer, position=viewer.position + aside * viewer.axes[axis])
    solution = solve(replace(a_rig, viewers=(moved,)))
    found = [remark.sentence() for remark in solution.remarks if "frame" in remark.text]
    assert found == [
        f"The frame of the viewer 'viewer' cuts off {percent(part)} of the picture: aim it at the"
        " picture, or widen its view."
    ] * (part > 0.01)


def encoded(value):
    """Linear light of an sRGB-encoded number near 1 (IEC 61966-2-1)."""
    return ((value + 0.055) / 1.055) ** 2.4


@pytest.mark.parametrize(
    ("white", "is_told"),
    [
        (1.0000242, False),
        (encoded(254.9 / 255), False),
        (encoded(255.49 / 255), False),
        (encoded(255.51 / 255), True),
    ],
)
def test_white_as_files_have_it_is_not_clipped(white, is_told):
    """A 16-bit PNG's white is read as 1.0000242: half a step of 8 bits is no clipping.

    More is, and names the image.
    """
    image = np.full((4, 4, 4), white, np.float32)
    notes = solve(rig(box([0.3, 0.02, 0.3]), pixels=16, display_pixels=16, image=image)).notes
    told = ["clipped: lower the Picture Brightness of 'picture', or" in note for note in notes]
    assert told == [True] * is_told


def test_a_view_that_changes_within_a_pixel_is_told():
    """A bottle's rim at 64 pixels: the share is the error's own. A ball has no such place."""
    bent = solve(rig(bottle(), pixels=64))
    plain = solve(ball_rig(4, pixels=64))
    error = bent.first.map_error
    share = error.facet_limited + error.unresolved - error.noise
    assert share > BEYOND
    assert [f"{percent(share)} of the view" in note for note in bent.warnings] == [True]
    assert plain.notes == ()


def test_a_coarse_mesh_is_told_and_a_flat_one_has_no_tessellation_error():
    """The note comes above a tenth of a display pixel.

    Where all is flat no ray is traced for it.
    """
    coarse = rig(replace(icosphere(0.025, 2), surface="facets"), pixels=48, image=lattice_image(64))
    found = solve(coarse)
    assert found.first.tessellation_error > 0.1
    assert any("The mesh causes errors of up to" in note for note in found.notes)
    flat = solve(rig(box([0.05] * 3), pixels=48, image=lattice_image(64)))
    assert flat.first.tessellation_error == 0.0
    assert "curved faces" in flat.left_out


def irregular_ball(levels=4, aside=0.0, noise=0.0, surface="smooth"):
    """A ball whose vertices were moved on it by up to a part of an
    edge, and off it, as of a scan, in parts of it.
    """
    mesh = icosphere(1.0, levels)
    random = np.random.default_rng(6)
    edge = np.linalg.norm(mesh.corners[:, 1] - mesh.corners[:, 0], axis=1).mean()
    v = mesh.vertices + aside * edge * random.uniform(-1, 1, mesh.vertices.shape)
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    v *= 0.025 * (1 + noise * random.normal(size=(len(v), 1)))
    return mean_normals(replace(mesh, vertices=v, surface=surface))


def true_and_told(mesh):
    """Error of landings against the closed form of the
    ball, rms display px, and the note on it.
    """
    a_rig = rig(mesh, picture=0.015)
    plan = compile_plan(a_rig, Settings())
    at = np.linspace(0, 512, 65)
    o, d = a_rig.viewer.rays(np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2))
    landings = trace_all(plan, o, d)
    exact = closed_forms.landing(a_rig, *closed_forms.through_ball(o, d, 0.025, 1.49))
    error = np.linalg.norm(landings.xy - exact, axis=1)[landings.has_arrived]
    true = np.sqrt(
        np.nanmean(np.sort(error)[: int(0.98 * len(error))] ** 2)
    )  # without the rays that graze
    return true, drain(tessellation(plan))


def notes_without_solving(mesh, error=NO_ERROR):
    """The note on a mesh by a sample of rays."""
    plan = compile_plan(rig(mesh), Settings())
    return [remark.sentence() for remark in remarks_of(plan, drain(measure(plan)), error)]


def remarks_of(plan, accuracy, error, misses=MappingProxyType({})):
    """Remarks on a channel of which no more is known than this, and on a black source image."""
    channel = SimpleNamespace(
        plan=plan, accuracy=accuracy, map_error=error, misses=misses, glare=None, split=None
    )
    return remarks_on((channel,), np.zeros((1, 1, 3), np.float32))


@pytest.mark.parametrize(("aside", "noise"), [(0.0, 1e-2), (0.0, 1e-3), (0.0, 1e-4), (0.2, 1e-3)])
def test_the_error_of_noisy_meshes_is_told(aside, noise):
    """The estimate is within a factor of 2 of the error against the ball that was meant. It names
    why, but where noise is so little that facets are further off.
    """
    mesh = irregular_ball(3, aside, noise)
    true, told = true_and_told(mesh)
    assert true / 2 < told.error < 2 * true
    drawn, _ = true_and_told(replace(mesh, surface="facets"))
    assert (told.cause == "jumps") == (drawn < true)
    assert told.uneven == 0


def test_notes_on_the_mesh_follow_the_tolerance():
    """An error of the mesh is noted from the tolerance on, whatever that is."""
    told = Accuracy(Tessellation(order=0.2), 0.0, (0.0,), 0.0, (0.0,))
    for tolerance, is_noted in ((0.1, True), (0.19, True), (0.21, False), (0.5, False)):
        plan = compile_plan(ball_rig(3, pixels=8), Settings(tolerance=tolerance))
        notes = [remark.sentence() for remark in remarks_of(plan, told, NO_ERROR)]
        assert (
            any("The mesh causes errors of up to about 0.2" in note for note in notes) == is_noted
        )


@pytest.mark.parametrize(("aside", "noise"), [(0.3, 1e-3), (0.0, 1e-2), (0.0, 1e-3)])
def test_automatic_helps_where_it_is_told_to(aside, noise):
    """Where the note says to set Surface to Automatic, that
    brings landings nearer to the surface that was meant.
    """
    mesh = irregular_ball(4, aside, noise)
    (note,) = [note for note in notes_without_solving(mesh) if "The mesh causes errors" in note]
    assert "curved faces of 'glass' disagree at their edges; set its Surface to Automatic" in note

    automatic = replace(mesh, surface="automatic")
    assert true_and_told(automatic)[0] < true_and_told(mesh)[0]
    notes = notes_without_solving(automatic)
    assert any("100 % of its smooth faces are traced as drawn." in note for note in notes)
    assert not any("set its Surface" in note for note in notes)


def test_a_coarse_but_regular_mesh_is_told_to_be_subdivided():
    """A ball of 80 faces is coarse, not irregular; subdivided twice it is not coarse any more."""
    (note,) = notes_without_solving(icosphere(0.025, 1))
    assert note.endswith("display pixels: subdivide the glass.")
    assert notes_without_solving(icosphere(0.025, 3)) == []


def test_light_that_max_events_cuts_off_is_told_by_its_name():
    """A diamond of flat faces: the share cut off is told
    with the limit, and gone when that is raised.
    """
    point = np.array([[0, 0, -0.02], [0, 0, 0.01]])
    a = 2 * np.pi * np.arange(7) / 7
    rim = np.stack([0.02 * np.cos(a), 0.02 * np.sin(a), 0 * a], axis=1)
    k = np.arange(7)
    this = 2 + k
    following = 2 + (k + 1) % 7
    low = np.stack([0 * k, following, this], axis=1)
    high = np.stack([0 * k + 1, this, following], axis=1)
    triangles = np.concatenate([low, high])
    a_rig = rig(
        Mesh(np.concatenate([point, rim]), triangles), ior=2.42, pixels=32, plate=5.0, display=0.5
    )
    few = solve(a_rig, max_events=5)
    many = solve(a_rig, max_events=200)
    share = few.misses["cut off by Max Events"]

    assert share > 0.01
    told = (
        f"{percent(share)} of the picture's light needs more than 5 events and is cut off:"
        f" raise Max Events."
    )

    assert told in few.warnings
    assert (
        "cut off by Max Events" not in many.misses
        or many.misses["cut off by Max Events"] < share / 10
    )
    assert not any("cut off" in note for note in many.notes)


@pytest.mark.parametrize(("share", "is_told"), [(0.0009, False), (0.0011, True)])
def test_what_is_lost_is_told_from_a_thousandth_on(share, is_told):
    """Light that leaks through gaps, and light that is cut off.

    By whether more surfaces would set it free.
    """
    plan = compile_plan(ball_rig(1, pixels=8), Settings())
    for leaked, cut_off, caught, words in (
        (share, 0.0, 0.0, "leaks through gaps in 'glass'"),
        (0.0, share, 0.0, "and is cut off: raise Max Events"),
        (0.0, share, 0.89, "and is cut off: raise Max Events"),
        (0.0, share, 0.91, "never leaves the glass"),
    ):
        accuracy = Accuracy(Tessellation(), 0.0, (leaked,), caught, (0.0,))
        misses = {"cut off by Max Events": cut_off}
        found = remarks_of(plan, accuracy, NO_ERROR, misses)
        assert [words in remark.text and remark.is_warning for remark in found] == [True] * is_told


@pytest.mark.parametrize(("share", "is_told"), [(0.0099, False), (0.0101, True)])
def test_light_at_contradicting_normals_is_told_from_a_hundredth_on(share, is_told):
    """In place of the number of such triangles, which says nothing of the light."""
    plan = compile_plan(ball_rig(1, pixels=8), Settings())
    plan = replace(plan, counts=replace(plan.counts, n_contradicted=(3,)))
    accuracy = Accuracy(Tessellation(), 0.0, (0.0,), 0.0, (share,))
    (remark,) = remarks_of(plan, accuracy, NO_ERROR)
    assert not remark.is_warning
    assert ("picture's light hits normals of 'glass'" in remark.text) == is_told
    assert ("of 3 smooth triangles of 'glass'" in remark.text) != is_told


@pytest.mark.parametrize(
    ("bends", "unresolved", "cut_off", "noise", "remedy"),
    [
        (0.0, 0.1, 0.06, 0.0, "raise Max Events"),
        (0.0, 0.1, 0.04, 0.0, "raise the viewer"),
        (0.1, 0.05, 0.05, 0.0, "raise the viewer"),
        (0.0, 0.1, 0.03, 0.06, "raise the viewer"),
    ],
)
def test_the_remedy_is_for_the_largest_cause(bends, unresolved, cut_off, noise, remedy):
    """Of a view that changes within pixels: where cut-off light is most of it, Max Events.

    Noise is no cause.
    """
    plan = compile_plan(ball_rig(3, pixels=8), Settings())
    accuracy = Accuracy(Tessellation(), 0.0, (0.0,), 0.0, (0.0,))
    error = replace(
        NO_ERROR, facet_limited=bends, unresolved=unresolved, cut_off=cut_off, noise=noise
    )
    (remark,) = remarks_of(plan, accuracy, error)
    assert remedy in remark.text
    assert remark.text.startswith(percent(bends + unresolved - noise))


def test_light_that_no_limit_sets_free_is_not_told_to_raise_it():
    """A hollow that shares a face with the outside of its block,
    as a notch is often drawn: light is caught in it.
    """
    block = box([0.3, 0.02, 0.3])
    hollow = box([0.1, 0.01, 0.1], (0, -0.005, 0))
    a_rig = rig(joined(block, hollow), pixels=32, field=0.3, picture=0.2, display=0.3)
    few = solve(a_rig, max_events=32)
    many = solve(a_rig, max_events=500)
    share = few.misses["cut off by Max Events"]
    assert share == many.misses["cut off by Max Events"] > 0.2
    assert any(
        note.startswith(f"{percent(share)} of the picture's light never leaves the glass")
        for note in few.warnings
    )
    assert not any("raise Max Events" in note for note in few.notes)


@pytest.mark.parametrize(
    ("mesh", "is_so"),
    [
        (icosphere(0.025, 3, smooth=False), True),
        (icosphere(0.025, 3), False),
        (icosphere(0.025, 0, smooth=False), False),
        (box([0.05] * 3), False),
    ],
    ids=["ball of 1280 facets", "smooth ball", "icosahedron", "cube"],
)
def test_smooth_shading_is_advised_for_facets_that_stand_for_a_curve(mesh, is_so):
    """Many flat faces that meet at small angles.

    Not glass that is smooth already, nor a solid of few faces.
    """
    assert is_facetted(mesh) == is_so
    if is_so:
        found = solve(rig(mesh, pixels=24, image=lattice_image(64)))
        assert any(
            "hade 'glass' smooth if it is meant to be curved" in note for note in found.warnings
        )
