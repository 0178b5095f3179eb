"""Which parts are computed again, and which are kept.

And one clear sentence for each rig that cannot be solved.
"""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.errors import MeshError, RigError
from kiriko.core.base.steps import run_steps
from kiriko.core.glass import surfaces
from kiriko.core.glass.meshes import geometric_normals
from kiriko.core.image.source_image import Painting
from kiriko.core.light import ray_engine
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.rays import Reason
from kiriko.core.light.trace import trace_all
from kiriko.core.map import rasterise, shares
from kiriko.core.native import loading
from kiriko.core.rig.mesh import FURTHEST
from kiriko.core.rig.rig import Blocker, ConstantIndex, Glass, Mesh
from kiriko.core.rig.settings import LEAST_TOLERANCE, MOST_TOLERANCE, Settings
from kiriko.core.solve import accuracy, channel, painting
from kiriko.core.solve.accuracy import rounding_error
from kiriko.core.solve.channel import NOT_KEPT
from kiriko.core.solve.remarks import UNDECIDED
from kiriko.core.solve.session import Session
from kiriko.core.solve.tessellation import tessellation
from known import closed_forms
from known.extremes.bench import filled_cavity
from known.extremes.cases import joined, rays_of
from known.reference_rigs import (
    ball_rig,
    bottle,
    box,
    icosphere,
    lattice_image,
    mean_normals,
    rectangle,
    rig,
    torus,
    wavy_slab,
)
from known.work import drain, solve


def small(**options):
    return ball_rig(3, pixels=48, display_pixels=48, image=lattice_image(64), **options)


def test_a_solve_that_ends_after_its_picture_is_gone_on_with(monkeypatch):
    """The picture is shown once, as it will be; the next solve traces nothing and measures what was
    left: its numbers are those of a solve at once. Then nothing is left to be measured.
    """
    kept, shown = Session(), []
    a_rig = small()
    expected = solve(a_rig)
    steps = kept.solve(a_rig, None, shown.append)
    while not shown:
        next(steps)
    steps.close()
    assert len(shown) == 1
    assert np.array_equal(shown[0], expected.source)

    monkeypatch.setattr(channel, "Sampling", lambda plan: pytest.fail("traced again"))
    found = drain(kept.solve(a_rig, None, shown.append))
    assert len(shown) == 2
    assert all(np.array_equal(one, found.source) for one in shown)
    assert found.first.accuracy == expected.first.accuracy
    assert found.notes == expected.notes
    again = drain(kept.solve(a_rig, None, shown.append))
    assert len(shown) == 2
    assert again.first.accuracy is found.first.accuracy


@pytest.mark.parametrize("is_stopped", [False, True])
def test_what_is_told_of_the_pictures_light_follows_the_picture(monkeypatch, is_stopped):
    """Light of the picture goes through a gap only after it was moved before that: nothing is
    traced for a map or for the error of the mesh, and all that is told is of the picture where it
    is. So it is where a solve before was stopped, with its picture shown.
    """
    a_rig = small(picture=0.01)
    glass, picture = a_rig.glasses[0], a_rig.picture
    middles = glass.mesh.corners.mean(axis=1)
    gap = np.linalg.norm(middles[:, [0, 2]] - [0.012, 0], axis=1) < 0.004
    opened = replace(glass, mesh=some_of(glass.mesh, ~gap))
    here, there = (
        replace(
            a_rig,
            glasses=(opened,),
            pictures=(replace(picture, mesh=replace_vertices(picture.mesh, np.array([x, 0, 0]))),),
        )
        for x in (-0.01, 0.01)
    )
    expected = solve(there)
    assert "through gaps" in " ".join(expected.notes)

    kept, shown = Session(), []
    steps = kept.solve(here, None, shown.append)
    if is_stopped:
        while not shown:
            next(steps)
        steps.close()
    else:
        assert "through gaps" not in " ".join(drain(steps).notes)
    assert len(shown) == 1

    monkeypatch.setattr(channel, "Sampling", lambda plan: pytest.fail("traced again"))
    if not is_stopped:
        monkeypatch.setattr(accuracy, "tessellation", lambda _: pytest.fail("measured again"))
    found = solve(there, kept)
    assert found.first.accuracy == expected.first.accuracy
    assert found.notes == expected.notes
    back = solve(here, kept)
    assert "through gaps" not in " ".join(back.notes)


@pytest.mark.numpy_alone
def test_a_new_picture_alone_traces_nothing(monkeypatch):
    """Same optics, other picture: equal to a solve from
    scratch, with no ray traced and no place looked for.
    """
    kept = Session()
    a_rig = small()
    solve(a_rig, kept)
    other = replace(a_rig, pictures=(replace(a_rig.picture, image=lattice_image(64)[::-1].copy()),))
    expected = solve(other)
    monkeypatch.setattr(channel, "Sampling", lambda plan: pytest.fail("traced again"))
    monkeypatch.setattr(painting, "find_filter_taps", lambda *_: pytest.fail("placed again"))
    found = solve(other, kept)
    assert np.array_equal(found.source, expected.source)
    assert found.n_rays == 0
    assert "tracing" not in found.seconds


@pytest.mark.parametrize("brightness", [False, True])
def test_shares_too_many_to_keep_are_made_again(monkeypatch, brightness):
    """Kept or made again, some at a time: images and
    coverages agree to rounding, also for a new picture.
    """
    a_rig = ball_rig(3, pixels=48, display_pixels=300, image=lattice_image(64))
    other = replace(a_rig, pictures=(replace(a_rig.picture, image=lattice_image(64)[::-1].copy()),))
    expected = [solve(some, brightness=brightness) for some in (a_rig, other)]
    n = len(expected[0].first.shares)

    assert n < shares.MOST_CACHED
    monkeypatch.setattr(shares, "MOST_CACHED", n // 2)
    monkeypatch.setattr(rasterise, "SHARES_AT_ONCE", n // 5)
    monkeypatch.setattr(rasterise, "PARTS_AT_ONCE", n // 20)
    monkeypatch.setattr(painting, "SHARE_OF_FREE", 0)
    kept = Session()

    for some, one in zip((a_rig, other), expected, strict=True):
        found = solve(some, kept, brightness=brightness)
        assert len(list(found.first.shares)) > 3
        # a share whose area is rounding alone is there or not, by the sizes of numpy's arrays
        assert abs(len(found.first.shares) - n) <= 1e-4 * n
        np.testing.assert_allclose(found.source, one.source, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(found.seen(), one.seen(), rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(found.weight, one.weight, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(
            found.display_coverage, one.display_coverage, rtol=1e-9, atol=1e-12
        )
        np.testing.assert_allclose(found.first.view_coverage, one.first.view_coverage, rtol=1e-9)
        assert found.picture_coverage == pytest.approx(one.picture_coverage, rel=1e-9)
        assert NOT_KEPT in found.left_out
        assert NOT_KEPT not in one.left_out

    assert found.n_rays == 0


@pytest.mark.numpy_alone
def test_nothing_new_paints_nothing(monkeypatch):
    """The same rig and settings again: the same source image, with no picture read; any setting
    of its light changes it.
    """
    kept, a_rig = Session(), small()
    expected = solve(a_rig, kept)
    with monkeypatch.context() as patch:
        patch.setattr(Painting, "add", lambda *_, **__: pytest.fail("painted again"))
        assert np.array_equal(solve(a_rig, kept).source, expected.source)
    assert not np.array_equal(solve(a_rig, kept, margin=2).source, expected.source)
    assert np.array_equal(solve(a_rig, kept).source, expected.source)


def test_another_picture_in_a_pause_leaves_each_its_own():
    """A solve of one picture, with one of another in any of its pauses: each session afterwards
    shows of either what a new one shows.
    """
    first = small()
    second = replace(
        first, pictures=(replace(first.picture, image=first.picture.image[::-1].copy()),)
    )
    expected = [solve(first).source, solve(second).source]
    n_pauses = 0
    while True:
        kept = Session()
        solve(second, kept)
        steps = kept.solve(first)
        try:
            for _ in range(n_pauses):
                next(steps)
        except StopIteration:
            break
        solve(second, kept)
        assert np.array_equal(run_steps(steps).source, expected[0])
        for a_rig, one in ((second, expected[1]), (first, expected[0])):
            assert np.array_equal(solve(a_rig, kept).source, one)
        n_pauses += 1
    assert n_pauses > 3


@pytest.mark.numpy_alone
def test_after_a_failed_solve_nothing_is_traced_twice():
    """A rig whose picture is out of sight traces, and fails; the rig before is traced once more."""
    kept, a_rig = Session(), small()
    expected = solve(a_rig, kept)
    viewer = replace(a_rig.viewer, position=a_rig.viewer.position + np.array([0.001, 0, 0]))
    corners = a_rig.picture.mesh.vertices + np.array([10.0, 0, 0])
    gone = replace(a_rig.picture, mesh=replace(a_rig.picture.mesh, vertices=corners))
    with pytest.raises(RigError):
        solve(replace(a_rig, viewers=(viewer,), pictures=(gone,)), kept)
    found = [solve(a_rig, kept) for _ in range(3)]
    assert [one.n_rays for one in found] == [expected.n_rays, 0, 0]
    assert all(np.array_equal(one.source, expected.source) for one in found)


def test_a_picture_changed_in_its_place_is_painted_anew():
    """A picture is known by its values, a place or size of it
    by those: nothing of the old one is left.
    """
    kept = Session()
    a_rig = small()
    first = solve(a_rig, kept)
    a_rig.picture.image[:] = a_rig.picture.image[::-1].copy()
    found = solve(a_rig, kept)

    assert not np.array_equal(found.source, first.source)
    assert np.array_equal(found.source, solve(a_rig).source)
    wide = replace(
        a_rig, pictures=(replace(a_rig.picture, image=lattice_image(64)[:, :40].copy()),)
    )

    assert np.array_equal(solve(wide, kept).source, solve(wide).source)
    shifted = replace(
        a_rig.picture, mesh=replace_vertices(a_rig.picture.mesh, np.array([0.001, 0, 0]))
    )
    aside = replace(a_rig, pictures=(shifted,))
    found = solve(aside, kept)
    expected = solve(aside)

    assert np.array_equal(found.source, expected.source)
    assert found.picture_coverage == expected.picture_coverage != first.picture_coverage


def test_only_a_changed_mesh_builds_an_engine(monkeypatch):
    """The ray engine is known by the shape of the triangles in
    it, not by their place or by the rest of the rig.
    """
    kept = Session()
    a_rig = small()
    solve(a_rig, kept)
    built = []

    original = ray_engine.EngineTriangles

    def counted(corners, *others):
        if len(corners) > ray_engine.FEW_TRIANGLES:
            built.append(1)
        return original(corners, *others)

    monkeypatch.setattr(ray_engine, "EngineTriangles", counted)
    v = a_rig.viewer
    moved = replace(a_rig, viewers=(replace(v, position=v.position + np.array([0.01, 0, 0])),))
    assert np.array_equal(solve(moved, kept).source, solve(moved).source)
    assert len(built) == 1  # by the solve from scratch

    glass = a_rig.glasses[0].mesh
    moved = rig(replace_vertices(glass, 0.001), pixels=48, display_pixels=48)
    np.testing.assert_allclose(solve(moved, kept).source, solve(moved).source, atol=1e-6)
    assert len(built) == 2  # by the solve from scratch again

    solve(rig(replace(glass, vertices=1.01 * glass.vertices), pixels=48, display_pixels=48), kept)
    assert len(built) == 3


def replace_vertices(mesh, shift):
    return replace(mesh, vertices=mesh.vertices + shift)


def some_of(mesh, some):
    """Some of the triangles of a smooth mesh."""
    return Mesh(
        mesh.vertices, mesh.triangles[some], mesh.corner_normals[some], mesh.is_smooth[some]
    )


def test_settings_and_index_are_part_of_the_optics():
    """Another index or limit is traced again."""
    kept = Session()
    a_rig = small()
    first = solve(a_rig, kept)
    denser = replace(a_rig, glasses=(replace(a_rig.glasses[0], ior=ConstantIndex(1.6)),))
    assert not np.array_equal(solve(denser, kept).source, first.source)
    assert solve(denser, kept, only_through_glass=False).n_rays > 0


@pytest.mark.numpy_alone
def test_a_failed_or_stopped_solve_leaves_the_session_as_it_was():
    """After an error and after a stop in the middle the next solve of the old rig needs
    no tracing.
    """
    kept = Session()
    a_rig = small()
    solve(a_rig, kept)
    with pytest.raises(RigError):
        solve(replace(a_rig, displays=()), kept)
    stopped = kept.solve(
        replace(a_rig, glasses=(replace(a_rig.glasses[0], ior=ConstantIndex(1.7)),)), Settings()
    )
    next(stopped)
    stopped.close()
    assert solve(a_rig, kept).n_rays == 0


def without(part):
    return lambda: replace(small(), **{part: ()})


def broken(**changes):
    a_rig = small()
    return replace(
        a_rig, glasses=(replace(a_rig.glasses[0], mesh=replace(a_rig.glasses[0].mesh, **changes)),)
    )


def scaled(scale):
    """The small rig, so many times as large."""
    a_rig = small()

    def larger(parts):
        return tuple(
            replace(part, mesh=replace(part.mesh, vertices=part.mesh.vertices * scale))
            for part in parts
        )

    return replace(
        a_rig,
        glasses=larger(a_rig.glasses),
        plates=larger(a_rig.plates),
        displays=larger(a_rig.displays),
        pictures=larger(a_rig.pictures),
        viewers=(replace(a_rig.viewer, position=a_rig.viewer.position * scale),),
    )


def nan_vertices():
    vertices = small().glasses[0].mesh.vertices.copy()
    vertices[3] = np.nan
    return broken(vertices=vertices)


def far_vertex():
    vertices = small().glasses[0].mesh.vertices.copy()
    vertices[3, 2] = -1e40
    return broken(vertices=vertices)


def moved_away(parts):
    part = getattr(small(), parts)[0]
    return replace(
        small(),
        **{parts: (replace(part, mesh=replace_vertices(part.mesh, np.array([3.0, 0, 0]))),)},
    )


def turned_display():
    a_rig = small()
    mesh = a_rig.display.mesh
    turned = replace(mesh, triangles=mesh.triangles[:, ::-1], uv=mesh.uv[:, ::-1])
    return replace(a_rig, displays=(replace(a_rig.display, mesh=turned),))


def with_uv(factor):
    mesh = small().display.mesh
    return replace(
        small(), displays=(replace(small().display, mesh=replace(mesh, uv=mesh.uv * factor)),)
    )


def bent_plate():
    a_rig = small()
    vertices = a_rig.plates[0].mesh.vertices.copy()
    vertices[0] += [0, 0.01, 0]
    return replace(
        a_rig,
        plates=(replace(a_rig.plates[0], mesh=replace(a_rig.plates[0].mesh, vertices=vertices)),),
    )


def flattened_plate():
    a_rig = small()
    mesh = a_rig.plates[0].mesh
    points = np.broadcast_to(mesh.vertices[:1], mesh.vertices.shape)
    return replace(a_rig, plates=(replace(a_rig.plates[0], mesh=replace(mesh, vertices=points)),))


def picture_behind():
    a_rig = small()
    away = rectangle([0, -5, 0], [1, 0, 0], [0, 0, 1], 0.1, 0.1)
    return replace(a_rig, pictures=(replace(a_rig.picture, mesh=away),))


def second_plate(part=0.5, shift=(0.0, 0.0, 0.0)):
    """Another plate, of a part of the first one's size, moved from its middle."""
    a_rig = small()
    (plate,) = a_rig.plates
    middle = plate.mesh.vertices.mean(axis=0)
    smaller = replace(
        plate.mesh, vertices=middle + part * (plate.mesh.vertices - middle) + np.array(shift)
    )
    return replace(a_rig, plates=(plate, replace(plate, name="other", mesh=smaller)))


def viewing(**changes):
    a_rig = small()
    return replace(a_rig, viewers=(replace(a_rig.viewer, **changes),))


def with_corner(vertex):
    """Another vertex at the first corner of the glass."""
    triangles = small().glasses[0].mesh.triangles.copy()
    triangles[0, 0] = vertex
    return broken(triangles=triangles)


BAD = {
    "viewer nowhere": (
        lambda: viewing(position=np.array([0, np.nan, 0])),
        RigError,
        "viewer 'viewer' has a number that is not finite",
    ),
    "viewer shifted by no number": (
        lambda: viewing(window=(np.nan, 1, 0, 1)),
        RigError,
        "has a number that is not finite",
    ),
    "viewer that sees nothing": (
        lambda: viewing(window=(0.1, 0.1, 0, 1)),
        RigError,
        "'viewer' sees nothing",
    ),
    "no display": (without("displays"), RigError, "no display"),
    "no picture": (without("pictures"), RigError, "no picture"),
    "no viewer": (without("viewers"), RigError, "no viewer"),
    "two pictures": (
        lambda: replace(small(), pictures=small().pictures * 2),
        RigError,
        "2 pictures",
    ),
    "empty mesh": (lambda: broken(triangles=np.empty((0, 3), int)), MeshError, "no faces"),
    "NaN vertices": (nan_vertices, MeshError, "not finite"),
    "vertices beyond float32": (lambda: scaled(1e300), MeshError, r"further than 3.4e\+38 m"),
    "a vertex beyond float32": (far_vertex, MeshError, r"further than 3.4e\+38 m"),
    "no UV": (
        lambda: replace(
            small(),
            displays=(replace(small().display, mesh=replace(small().display.mesh, uv=None)),),
        ),
        MeshError,
        "no UV map",
    ),
    "UV not finite": (lambda: with_uv(np.nan), MeshError, "no UV map with an area"),
    "UV without area": (lambda: with_uv(0.0), MeshError, "no UV map with an area"),
    "index 0": (
        lambda: replace(small(), glasses=(replace(small().glasses[0], ior=ConstantIndex(0.0)),)),
        RigError,
        "has IOR 0: set it above 0",
    ),
    "viewer inside": (lambda: rig(box([3, 3, 3])), RigError, "inside the glass"),
    "plate not reached": (lambda: moved_away("plates"), RigError, "no ray reaches the plate"),
    "display not reached": (lambda: moved_away("displays"), RigError, "no ray reaches the display"),
    "display turned": (turned_display, RigError, "display's front"),
    "plate bent": (bent_plate, RigError, "not a flat plane: replace it"),
    "plate without area": (flattened_plate, RigError, "has no area: scale it up"),
    "picture out of view": (picture_behind, RigError, "does not see the picture"),
    "picture out of view, and no light arrives": (
        lambda: replace(
            moved_away("displays"), viewers=viewing(position=np.array([0.04, -1, 0])).viewers
        ),
        RigError,
        "does not see the picture",
    ),
    "blocked": (
        lambda: replace(
            small(), blockers=(Blocker("b", rectangle([0, 0.05, 0], [1, 0, 0], [0, 0, 1], 1, 1)),)
        ),
        RigError,
        "blocked",
    ),
    "glass out of view": (
        lambda: rig(box([0.01] * 3, (3, 0, 0)), pixels=16),
        RigError,
        "no ray from the viewer hits",
    ),
    "glass within a pixel": (
        lambda: rig(icosphere(1e-4, 2, centre=(0.0031, 0, 0.0012)), pixels=16),
        RigError,
        "'glass' is narrower than one pixel of the viewer 'viewer'",
    ),
    "glass like a needle": (
        lambda: rig(box([6e-4, 6e-4, 0.016], (8e-4, 0, 8e-4)), pixels=16),
        RigError,
        "'glass' is narrower than one pixel of the viewer 'viewer'",
    ),
    "no pixels": (lambda: viewing(width=0), RigError, "The viewer 'viewer' has no pixels: set its"),
    "fewer pixels than none": (
        lambda: replace(small(), displays=(replace(small().display, height=-1),)),
        RigError,
        "The display 'display' has no pixels: set its",
    ),
    "a corner too many": (
        lambda: with_corner(10**6),
        MeshError,
        "faces with missing vertices",
    ),
    "a corner below 0": (lambda: with_corner(-1), MeshError, "faces with missing vertices"),
    "index is a function": (
        lambda: replace(
            small(), glasses=(replace(small().glasses[0], ior=lambda wavelength: 1.5),)
        ),
        RigError,
        "index of refraction of the wrong type: use a number",
    ),
}


def test_a_rig_as_large_as_float32_allows_is_solved():
    """As one of usual size, but for the slack of lengths that do not grow with it: 1.5e-5."""
    scale = 2.0 ** int(np.log2(FURTHEST) - 2)
    a_rig = scaled(scale)
    assert np.abs(a_rig.display.mesh.vertices).max() > FURTHEST / 64
    np.testing.assert_allclose(solve(a_rig).source, solve(small()).source, rtol=0, atol=1e-4)


@pytest.mark.parametrize("name", BAD)
def test_a_rig_that_cannot_be_solved_is_told_in_one_sentence(name):
    """The error is one of core's own, and one sentence that names the remedy."""
    make, kind, words = BAD[name]
    with pytest.raises(kind, match=words) as caught:
        solve(make())
    text = str(caught.value)
    assert text.endswith(".")
    assert text.count(". ") == 0
    assert ":" in text


@pytest.mark.numpy_alone
def test_solutions_say_what_was_left_out():
    """A rig of few flat faces builds no engine and says so, as others say which.

    Overlapping solids are counted.
    """
    few = rig(box([0.3, 0.02, 0.3]), pixels=16, display_pixels=16)
    with loading.off():
        flat = solve(few)
        curved = solve(small())
    assert "ray engine" in flat.left_out
    assert "ray engine (Embree)" in curved.used
    assert any(words.startswith("compiled kernel") for words in curved.left_out)
    assert "overlapping media" in flat.left_out
    nested = (Glass("a", box([0.3, 0.02, 0.3])), Glass("b", box([0.02, 0.01, 0.02])))
    both = solve(rig(nested, pixels=16, display_pixels=16))
    assert "overlapping media" in both.used


def test_a_name_is_no_part_of_the_optics():
    """A renamed glass is not traced again, and the notes name it as it is called now."""
    mesh = icosphere(0.025, 2)
    a_rig = rig(replace(mesh, corner_normals=-mesh.corner_normals), pixels=16, display_pixels=16)
    kept = Session()
    solve(a_rig, kept)
    renamed = replace(a_rig, glasses=(replace(a_rig.glasses[0], name="other"),))
    solution = solve(renamed, kept)
    assert solution.n_rays == 0
    assert any("triangles of 'other' are missing or contradict" in note for note in solution.notes)


SHAPES = {"ball": (0.025,) * 3, "ellipsoid": (0.025, 0.020, 0.015)}


@pytest.mark.parametrize("surface", ["smooth", "facets"])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("levels", [2, 3, 4])
def test_the_tessellation_error_is_of_the_size_of_the_true_one(shape, levels, surface):
    """Facets: within a factor of 4 of the error against the
    closed form. Curved faces: not less than it.
    """
    radii = SHAPES[shape]
    a_rig = rig(replace(icosphere(radii, levels), surface=surface), picture=0.015)
    plan = compile_plan(a_rig, Settings())
    at = np.linspace(0, 512, 65)
    o, d = a_rig.viewer.rays(np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2))
    landings = trace_all(plan, o, d)
    exact = closed_forms.landing(a_rig, *closed_forms.through_ellipsoid(o, d, radii, 1.49))
    error = np.linalg.norm(landings.xy - exact, axis=1)[landings.has_arrived]

    # facets are far off near silhouettes, where a single ray decides: those are left out
    true = np.sqrt(np.nanmean(np.sort(error)[: int(0.98 * len(error))] ** 2))
    told = drain(tessellation(plan)).error
    if surface == "facets":
        assert true / 4 < told < 4 * true
    else:
        assert true < told < (0.3, 0.03, 0.003)[levels - 2]


@pytest.mark.parametrize("levels", [(2, 4), (3, 2)])
def test_glass_that_touches_with_other_triangles_is_told(levels):
    """Light arrives elsewhere, or could, or does not: the film between is an accident of meshes."""
    assert (
        drain(tessellation(compile_plan(filled_cavity(*levels), Settings()))).undecided > UNDECIDED
    )


@pytest.mark.parametrize("n", [1.0, 1.333, 1.49, 1.6])
def test_glass_that_touches_with_the_same_triangles_leaves_nothing_undecided(n):
    """The remedy that is told for it does away with it, whatever is in the cavity."""
    a_rig = filled_cavity(3, 3)
    block, ball = a_rig.glasses
    a_rig = replace(a_rig, glasses=(block, replace(ball, ior=ConstantIndex(n))))
    assert drain(tessellation(compile_plan(a_rig, Settings()))).undecided == 0.0


@pytest.mark.parametrize(
    "a_rig",
    [
        filled_cavity(4, 4),
        rig(bottle(wall=1e-6)),
        rig(icosphere((0.025, 0.02, 0.015), 2)),
        rig(mean_normals(wavy_slab(8))),
        rig(mean_normals(torus(0.018, 0.007, 12, 6))),
    ],
    ids=[
        "filled cavity",
        "wall of a micrometre",
        "coarse ellipsoid",
        "coarse wavy slab",
        "coarse torus",
    ],
)
def test_thin_walls_and_coarse_meshes_leave_no_light_undecided(a_rig):
    assert drain(tessellation(compile_plan(a_rig, Settings()))).undecided == 0.0


ROUNDED = {
    "ball": icosphere(0.025, 4),
    "ball, mean normals": mean_normals(icosphere(0.025, 4)),
    "bottle": bottle(),
    "wavy slab": mean_normals(wavy_slab(64)),
    "cube": box([0.05] * 3, degrees_about_z=15.8),
}


@pytest.mark.parametrize("far", [1.0, 10.0])
@pytest.mark.parametrize("shape", ROUNDED)
def test_the_rounding_error_is_of_the_size_of_the_true_one(shape, far):
    """Vertices rounded to float32 far from their object's origin:
    not below half of the error of 99 % of the landings.
    """
    mesh = ROUNDED[shape]
    a_rig = rig(mesh)
    o, d = rays_of(a_rig)
    here = trace_all(compile_plan(a_rig, Settings()), o, d)
    shift = far * closed_forms.unit(np.array([0.3137, -0.7091, 0.4173]))
    moved = (mesh.vertices + shift).astype(np.float32).astype(float)
    rounded = replace(mesh, vertices=moved - shift, rounding=2.0**-24 * np.abs(moved).max())
    plan = compile_plan(
        replace(a_rig, glasses=(replace(a_rig.glasses[0], mesh=rounded),)), Settings()
    )
    there = trace_all(plan, o, d)
    same = here.has_arrived & (here.branch == there.branch)

    assert same.sum() > 0.99 * here.has_arrived.sum()
    true = np.quantile(np.linalg.norm(here.xy - there.xy, axis=1)[same], 0.99)
    assert true / 2 < rounding_error(plan) < 15 * true


def test_a_fine_mesh_is_left_flat():
    """Where no normal turns by more than a quarter of a
    degree over a triangle, facets serve as well.
    """
    fine = icosphere(0.025, 4)
    assert surfaces.make_surface(fine).curved is not None
    # normals that hardly leave those of the facets turn as little as those of a very fine mesh
    normals = fine.corner_normals + 30 * geometric_normals(fine.corners)[:, None]
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    assert surfaces.make_surface(replace(fine, corner_normals=normals)).curved is None


def test_a_mesh_whose_rounding_shows_is_left_flat():
    """Vertices rounded so coarsely that a fine face's slope is
    lost in it are not made to carry curved faces.
    """
    fine = icosphere(0.025, 5)
    assert surfaces.make_surface(replace(fine, rounding=1e-9)).curved is not None
    assert surfaces.make_surface(replace(fine, rounding=1e-6)).curved is None


@pytest.mark.parametrize(
    ("part", "shift"),
    [(1.0, (0, 0, 0)), (0.1, (0.02, 0, 0)), (0.7, (0.2, 0, 0)), (1.0, (0.488, 0, 0))],
    ids=["the same", "on it", "over its edge", "beside it"],
)
def test_plates_in_one_plane_act_as_one(part, shift):
    """Light that crossed one is beyond the other, too.

    Before, it went to and fro between the two for ever.
    """
    alone, both = (landings_of(a_rig) for a_rig in (small(), second_plate(part, shift)))
    assert alone.has_arrived.mean() > 0.3
    assert both.has_arrived[alone.has_arrived].all()
    assert np.abs(alone.xy - both.xy)[alone.has_arrived].max() < 1e-9
    assert not (both.reason == Reason.LOST_INSIDE).any()


def test_a_plate_behind_another_turns_the_light_back_again():
    """A tenth of a millimetre further is another place: after two the light goes on as it came."""
    assert landings_of(second_plate(1.0, (0.0, 1e-4, 0.0))).has_arrived.mean() < 0.01


def landings_of(a_rig):
    return trace_all(compile_plan(a_rig, Settings()), *rays_of(a_rig))


@pytest.mark.parametrize("effort", [2.5, 0, 4097, float("nan")])
def test_an_effort_that_is_no_whole_number_of_rays_is_refused(effort):
    said = rf"^Effort is {effort:g}: set a whole number from 1 to 4096\.$"
    with pytest.raises(RigError, match=said):
        Settings(effort=effort).check()


def test_a_tolerance_as_blender_keeps_it_is_the_one_that_was_set():
    for tolerance in (LEAST_TOLERANCE, MOST_TOLERANCE):
        Settings(tolerance=float(np.float32(tolerance))).check()


def test_an_error_is_one_line_whatever_a_name_holds():
    """Line breaks go; blanks that are in the name of a file stay."""
    assert str(RigError("The glass 'a\nb\t\u2028c' is broken.")) == "The glass 'a b c' is broken."
    assert str(RigError("'a  b\u3000c' is broken.")) == "'a  b\u3000c' is broken."


def test_a_bevel_and_faces_without_area_are_no_matter_of_rounding():
    """Most faces of a finely bevelled block are tiny, but most light goes through the
    large ones.
    """
    block = box([0.05] * 3)
    strips = icosphere(2e-5, 3, smooth=False, centre=(0.025, 0.025, 0.025))
    for other in (strips, Mesh(np.zeros((3, 3)), np.zeros((40, 3), int))):
        mesh = replace(
            joined(block, replace(other, corner_normals=None, is_smooth=None)), rounding=1.5e-9
        )
        plan = compile_plan(rig(block), Settings())
        plan = replace(
            plan, rig=replace(plan.rig, glasses=(replace(plan.rig.glasses[0], mesh=mesh),))
        )
        assert rounding_error(plan) < 0.01


@pytest.mark.parametrize("tolerance", [0.0, -0.1, 1e-9, 1e3, float("nan"), float("inf")])
def test_a_tolerance_that_cannot_be_kept_is_refused(tolerance):
    """Refused in one sentence that names the range, before any work.

    The session stays as it was.
    """
    kept = Session()
    a_rig = small()
    solve(a_rig, kept)
    with pytest.raises(RigError, match=r"^The rig has Tolerance .*: set it from 1e-06 to 100\.$"):
        solve(a_rig, kept, tolerance=tolerance)
    assert solve(a_rig, kept).n_rays == 0


def test_the_measured_error_goes_with_the_tolerance():
    """A smaller tolerance, a smaller measured error, more rays; it is told with the result."""
    tolerances = (0.3, 0.1, 0.03)
    solutions = [solve(ball_rig(4, pixels=128), tolerance=t) for t in tolerances]
    errors = [solution.first.map_error.rms for solution in solutions]
    assert errors[0] > errors[1] > errors[2]
    assert errors[0] > 4 * errors[2]
    assert errors[0] < tolerances[0] / 4
    assert solutions[0].n_rays < solutions[1].n_rays < solutions[2].n_rays
