"""Landings against closed forms: no glass, slab, ball,
ellipsoid, total reflection, nested and touching solids.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from kiriko.core.base.errors import RigError
from kiriko.core.glass.solids import solids_from_mesh
from kiriko.core.glass.surfaces import make_surface
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.layer_hits import first_hits
from kiriko.core.light.ray_engine import Layer
from kiriko.core.light.rays import Reason
from kiriko.core.light.rig_parts import check_viewer_outside
from kiriko.core.light.trace import trace_all
from kiriko.core.rig.rig import Blocker, ConstantIndex, Glass, Mesh, Mirror, Rig
from kiriko.core.rig.settings import Settings
from known import closed_forms
from known.reference_rigs import ball_rig, box, icosphere, rectangle, rig, rod, taken


def grid(viewer, n=65):
    x, y = np.meshgrid(np.linspace(0, viewer.width, n), np.linspace(0, viewer.height, n))
    return np.stack([x.ravel(), y.ravel()], axis=1)


def traced(a_rig, xy=None, **settings):
    xy = grid(a_rig.viewer) if xy is None else xy
    o, d = a_rig.viewer.rays(xy)
    return o, d, trace_all(compile_plan(a_rig, Settings(**settings)), o, d)


def error_px(a_rig, landings, through, o, d, **shape):
    exact = closed_forms.landing(a_rig, *through(o, d, **shape))
    found = landings.has_arrived & np.isfinite(exact[:, 0])
    assert (
        found.sum() > 0.999 * landings.has_arrived.sum()
    )  # a facet can lie where the curved surface is missed
    return np.linalg.norm(landings.xy[found] - exact[found], axis=1), exact


@pytest.mark.numpy_alone
def test_without_glass_the_landing_is_the_mirror_image():
    """Index 1: each landing is the mirror image of the point on the aerial plane, within
    1e-12 m.
    """
    a_rig = rig(box([0.05] * 3), ior=1.0)
    o, d, landings = traced(a_rig)
    assert landings.has_arrived.all()
    on_aerial_plane = o + (-o[:, 1] / d[:, 1])[:, None] * d
    normal = np.array([0, 1, -1]) / 2**0.5
    mirrored = (
        on_aerial_plane
        + 2 * (np.array([0, 0.15, 0]) @ normal - on_aerial_plane @ normal)[:, None] * normal
    )
    assert np.abs(landings.positions - mirrored).max() < 1e-12
    assert np.abs(landings.xy - closed_forms.landing(a_rig, o, d)).max() < 1e-12 / (0.05 / 512) * 2


@pytest.mark.numpy_alone
@pytest.mark.parametrize("degrees", [0.0, 15.8, 40.0])
def test_slab_landings_are_right_to_a_nanometre(degrees):
    """A flat-faced solid: within 1e-9 m of the shifted ray of the slab formula."""
    a_rig = rig(box([0.3, 0.02, 0.3], degrees_about_z=degrees), display=0.1)
    o, d, landings = traced(a_rig)
    a = np.radians(degrees)
    normal = np.array([-np.sin(a), np.cos(a), 0])

    assert landings.has_arrived.mean() > 0.5
    error, _ = error_px(
        a_rig,
        landings,
        closed_forms.through_slab,
        o,
        d,
        normal=normal,
        near=-0.01 * normal,
        thickness=0.02,
        n=1.49,
    )

    assert error.max() * 0.1 / 512 < 1e-9


def test_smooth_ball_is_right_to_a_hundred_thousandth_of_a_pixel():
    """20 k smooth-shaded triangles land within 1e-5 display px
    of the analytic ball at 512 px, all of them.
    """
    a_rig = ball_rig()
    o, d, landings = traced(a_rig, grid(a_rig.viewer, 257))
    error, exact = error_px(a_rig, landings, closed_forms.through_ball, o, d, radius=0.025, n=1.49)
    assert error.max() < 1e-5
    # and nothing that should have arrived has not: a point inside the display is reached
    inside = ((exact > 0.01) & (exact < 511.99)).all(axis=1)
    assert landings.has_arrived[inside].all()


def test_ball_error_falls_with_the_square_of_the_edge():
    """Facets with the surface's own normals, as drawn: four
    times the triangles, a quarter of the error.
    """
    errors = []
    for levels in (3, 4, 5):
        a_rig = rig(replace(icosphere(0.025, levels), surface="facets"))
        o, d, landings = traced(a_rig)
        error, _ = error_px(a_rig, landings, closed_forms.through_ball, o, d, radius=0.025, n=1.49)
        errors.append(np.median(error))
    slope = np.polyfit(np.log(4.0 ** np.arange(3)), np.log(errors), 1)[0]
    assert -1.15 < slope < -0.85


def test_ellipsoid_agrees_with_the_quadric():
    """An ellipsoid of 25 x 20 x 15 mm, 20 k smooth triangles, against the quadric."""
    radii = (0.025, 0.020, 0.015)
    a_rig = rig(icosphere(radii, 5), picture=0.015)
    o, d, landings = traced(a_rig, grid(a_rig.viewer, 257))
    error, _ = error_px(a_rig, landings, closed_forms.through_ellipsoid, o, d, radii=radii, n=1.49)
    assert landings.has_arrived.mean() > 0.1
    assert np.sqrt((error**2).mean()) < 1e-5
    assert error.max() < 1e-4


def test_nested_and_touching_solids_follow_the_priority_rule():
    """Equal media joined by touching faces, and a solid of the
    same index inside, act as one slab: to rounding.
    """
    whole = rig(box([0.3, 0.02, 0.3]), display=0.1)
    n = ConstantIndex(1.49)
    halves = (
        Glass("front", box([0.3, 0.01, 0.3], (0, -0.005, 0)), n),
        Glass("back", box([0.3, 0.01, 0.3], (0, 0.005, 0)), n),
    )
    inner = (
        Glass("outer", box([0.3, 0.02, 0.3]), n),
        Glass("inner", box([0.05, 0.004, 0.05], (0.003, 0, 0)), n),
    )
    _, _, one = traced(whole)

    for glasses in (halves, inner):
        _, _, other = traced(rig(glasses, display=0.1))
        assert np.array_equal(one.reason, other.reason)
        assert np.nanmax(np.abs(one.xy - other.xy)) < 1e-9


@pytest.mark.numpy_alone
def test_hollow_glass_equals_its_two_walls():
    """A box with a cavity is two slabs with air between, whichever way the cavity's faces were
    drawn; and so is one that holds a solid of index 1.
    """
    outer = box([0.3, 0.03, 0.3])
    cavity = box([0.28, 0.01, 0.28])
    walls = (
        Glass("a", box([0.3, 0.01, 0.3], (0, -0.01, 0))),
        Glass("b", box([0.3, 0.01, 0.3], (0, 0.01, 0))),
    )
    _, _, expected = traced(rig(walls, display=0.1, field=0.04))

    for turned in (False, True):
        inner = cavity.triangles[:, ::-1] if turned else cavity.triangles
        mesh = Mesh(
            np.concatenate([outer.vertices, cavity.vertices]),
            np.concatenate([outer.triangles, inner + 8]),
        )
        _, _, found = traced(rig(mesh, display=0.1, field=0.04))
        assert found.has_arrived.all()
        assert np.abs(found.xy - expected.xy).max() < 1e-9

    nested = Glass("glass", outer), Glass("air", cavity, ConstantIndex(1.0))
    _, _, found = traced(rig(nested, display=0.1, field=0.04))
    assert np.abs(found.xy - expected.xy).max() < 1e-9


def test_a_shell_that_leaves_the_glass_is_no_cavity_in_it():
    """A box that begins in an L of glass and ends beside it is a
    solid of its own, and a box in that its cavity.
    """
    outline = np.array([(0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3)], float)
    points = np.concatenate([np.column_stack([outline, np.full(6, z)]) for z in (-1.0, 1.0)])
    top = np.array([(3, 4, 5), (3, 5, 0), (3, 0, 1), (3, 1, 2)])
    sides = [
        (i, j, k)
        for a in range(6)
        for b in [(a + 1) % 6]
        for i, j, k in ((a, b, b + 6), (a, b + 6, a + 6))
    ]
    cavity = box([2.0, 2.0, 1.0], (1.5, 1.5, 0))
    within = box([0.5] * 3, (2, 2, 0))

    assert (cavity.vertices[cavity.triangles[0, 0]][:2] == 0.5).all()
    assert np.isin(within.vertices[:, :2], (1.75, 2.25)).all()
    triangles = np.concatenate(
        [top[:, ::-1], top + 6, sides, cavity.triangles + 12, within.triangles + 20]
    )
    solids = solids_from_mesh(
        Mesh(np.concatenate([points, cavity.vertices, within.vertices]), triangles)
    )

    assert [solid.volume for solid in solids] == pytest.approx([2 * 5, 4 - 0.125])


@pytest.mark.numpy_alone
def test_priority_decides_where_solids_overlap():
    """Two overlapping slabs: the one with the higher priority fills the overlap."""
    a = box([0.3, 0.02, 0.3], (0, -0.005, 0))
    b = box([0.3, 0.02, 0.3], (0, 0.005, 0))
    n1 = ConstantIndex(1.4)
    n2 = ConstantIndex(1.7)
    _, _, found = traced(rig((Glass("a", a, n1, priority=1), Glass("b", b, n2)), display=0.1))
    apart = (
        Glass("a", box([0.3, 0.02, 0.3], (0, -0.005, 0)), n1),
        Glass("b", box([0.3, 0.01, 0.3], (0, 0.010, 0)), n2),
    )
    _, _, expected = traced(rig(apart, display=0.1))
    assert found.has_arrived.mean() > 0.9
    assert np.nanmax(np.abs(found.xy - expected.xy)) < 1e-9


@pytest.mark.numpy_alone
def test_total_internal_reflection_goes_on_up_to_the_limit():
    """A right-angled prism turns the light by 90 degrees onto the plate.

    A limit of fewer events cuts it off.
    """
    half = 0.03
    corners = (-half, -half), (half, -half), (-half, half)
    v = np.array([[*corner, z] for corner in corners for z in (-half, half)])
    t = np.array(
        [[0, 2, 4], [1, 5, 3], [0, 1, 3], [0, 3, 2], [0, 4, 5], [0, 5, 1], [2, 3, 5], [2, 5, 4]]
    )
    prism = Mesh(v, t)
    y = np.eye(3)[1]

    # light along +y meets the face y = -half at normal incidence, then the hypotenuse x + y = 0 at
    # 45 degrees (TIR for n = 1.49, whose critical angle is 42.2), and leaves through x = -half
    # along -x
    a_rig = rig(prism, projection="orthographic", pixels=32, field=0.02)
    a_rig.viewers[0].position[:] = [-0.005, -1, 0]
    d = np.tile(y, (50, 1))
    o = np.stack(
        [np.linspace(-0.02, 0.02, 50), np.full(50, -1.0), np.linspace(-0.01, 0.01, 50)], axis=1
    )
    landings = trace_all(compile_plan(a_rig, Settings()), o, d)

    assert (landings.reason == Reason.MISSED_PLATE).all()
    np.testing.assert_allclose(landings.directions, np.tile([-1.0, 0, 0], (50, 1)), atol=1e-15)
    assert (landings.n_events == 3).all()
    short = trace_all(compile_plan(a_rig, Settings(max_events=2)), o, d)

    assert (short.reason == Reason.CUT_OFF).all()


@pytest.mark.numpy_alone
def test_every_ray_keeps_its_reason():
    """Missed the glass, the plate, the display, blocked: each where the geometry says so."""
    reasons = lambda r, **s: traced(r, grid(r.viewer, 9), **s)[2].reason  # noqa: E731 - a name for five uses
    slab_rig = rig(box([0.3, 0.02, 0.3]), display=0.1)
    assert (reasons(slab_rig) == Reason.ARRIVED).all()
    assert (reasons(rig(box([0.002] * 3, (0.2, 0, 0)), display=0.1)) == Reason.MISSED_GLASS).all()
    assert (
        reasons(rig(box([0.3, 0.02, 0.3]), plate=1e-6), only_through_glass=True)
        == Reason.MISSED_PLATE
    ).mean() > 0.9
    assert (reasons(rig(box([0.3, 0.02, 0.3]), display=1e-6)) == Reason.MISSED_DISPLAY).mean() > 0.9

    board = Blocker("board", rectangle([0, 0.05, 0], [1, 0, 0], [0, 0, 1], 1, 1))
    blocked = Rig(
        slab_rig.viewers,
        slab_rig.glasses,
        slab_rig.plates,
        slab_rig.displays,
        slab_rig.pictures,
        (),
        (board,),
    )

    assert (reasons(blocked) == Reason.BLOCKED).all()
    beside = rig(box([0.002] * 3, (0.2, 0, 0)), display=0.1)
    assert (reasons(beside, only_through_glass=False) == Reason.ARRIVED).all()


def test_elements_may_stand_in_any_order():
    """Glass behind the plate and a mirror before it: the landing equals the one followed
    by hand.
    """
    x, y, z = np.eye(3)
    base = rig(
        box([0.3, 0.3, 0.02], (0, 0.15, -0.08)), display=0.2
    )  # a slab between plate and display
    o, d, landings = traced(base)
    p = o + ((0.15 * y - o) @ np.array([0, 1, -1.0]) / (d @ np.array([0, 1, -1.0])))[:, None] * d
    down = np.stack([-d[:, 0], -d[:, 2], -d[:, 1]], axis=1)
    leaves, _ = closed_forms.through_slab(
        p, down, np.array([0, 0, -1.0]), np.array([0, 0, -0.07]), 0.02, 1.49
    )
    t = (-0.15 - leaves[:, 2]) / down[:, 2]
    expected = leaves + t[:, None] * down

    assert landings.has_arrived.all()
    assert np.abs(landings.positions - expected).max() < 1e-12
    # a mirror at 45 degrees: the viewer stands at the side and sees the same
    side = rig(box([0.3, 0.02, 0.3]), display=0.1)
    mirror = Mirror("mirror", rectangle([0, -0.5, 0], np.array([1, 1, 0]) / 2**0.5, z, 0.5, 0.5))
    viewer = type(side.viewer)(
        "viewer",
        "perspective",
        np.array([-0.5, -0.5, 0.0]),
        np.stack([-y, z, x]),
        side.viewer.window,
        512,
        512,
    )
    turned = Rig((viewer,), side.glasses, side.plates, side.displays, side.pictures, (mirror,))
    _, _, direct = traced(side)
    _, _, folded = traced(turned)
    n = int(len(direct.xy) ** 0.5)  # the mirror turns left into right

    assert np.abs(direct.xy.reshape(n, n, 2)[:, ::-1] - folded.xy.reshape(n, n, 2)).max() < 1e-9


def vertices_and_edges(mesh):
    """All vertices of a mesh and the middles of all its edges."""
    pairs = np.unique(np.sort(mesh.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    return np.concatenate([mesh.vertices, mesh.vertices[pairs].mean(axis=1)])


@pytest.mark.numpy_alone
@pytest.mark.parametrize("surface", ["smooth", "facets"])
def test_rays_at_vertices_and_edges_do_not_leak(surface):
    """Rays aimed from outside at every vertex and edge midpoint of
    a closed mesh: each crosses it, none is lost.
    """
    mesh = replace(icosphere(0.025, 4), surface=surface)
    a_rig = rig(mesh)
    plan = compile_plan(a_rig, Settings())
    targets = vertices_and_edges(mesh)
    targets = targets[targets[:, 1] < -0.008]  # those the viewer sees, off the silhouette
    o = np.tile(a_rig.viewer.position, (len(targets), 1))
    d = closed_forms.unit(targets - o)
    landings = trace_all(plan, o, d)
    assert len(targets) > 2000
    assert (landings.reason != Reason.LOST_INSIDE).all()
    assert (landings.reason != Reason.MISSED_GLASS).all()
    assert (landings.n_events >= 2).all()


@pytest.mark.parametrize("start", [[0, 0, 0], [0.003, 0.001, -0.002], [-0.011, 0.004, 0.007]])
def test_rays_from_inside_end_at_the_vertices_and_edges_they_are_aimed_at(start):
    """No ray from inside 5 120 facets escapes, and each meets them
    where it was aimed at, to rounding of float64.
    """
    mesh = icosphere(0.025, 4)
    away = vertices_and_edges(mesh) - start
    distance = np.linalg.norm(away, axis=1)
    is_inside = np.ones(len(away), bool)
    hits = first_hits(
        Layer(mesh.corners),
        np.tile(start, (len(away), 1)).astype(float),
        closed_forms.unit(away),
        is_inside,
        lambda _, hits: (~hits.enters, hits.enters & (hits.distance > 1e-7)),
    )
    assert np.abs(hits.distance - distance).max() < 1e-16


@pytest.mark.parametrize("options", [{}, {"projection": "orthographic", "field": 0.1}])
def test_viewer_inside_the_glass_is_refused(options):
    """One sentence that names viewer and glass."""
    with pytest.raises(RigError, match="viewer 'viewer' is inside the glass 'glass'"):
        compile_plan(rig(box([3, 3, 3]), **options), Settings())


ABOUT_AN_AXIS = np.linalg.qr([[0.3, 0.8, 0.5], [-0.7, 0.4, 0.2], [0.1, -0.6, 0.9]])[0]


@pytest.mark.parametrize("turn", [np.eye(3), ABOUT_AN_AXIS], ids=["upright", "turned"])
@pytest.mark.parametrize(
    ("glass", "is_cut"),
    [
        (box([0.02] * 3, (0, -1, 0)), True),
        (rod([0.013, -1.1, 0.0177], [0.013, -0.9, 0.0177], 1e-6), True),
        (rod([-0.2, -1.01, 0.013], [0.2, -0.99, 0.014], 1e-6), True),
        (icosphere(1e-5, 3, centre=(0.0499, -1, 0.02)), True),
        (icosphere(0.02, 3, centre=(0.0601, -1, 0.0601)), True),
        (icosphere(0.02, 3, centre=(0.065, -1, 0.065)), False),
        (rod([0.051, -1.1, -0.2], [0.051, -0.9, 0.2], 1e-6), False),
        (rod([0.013, -0.9999, 0.0177], [0.013, -0.9, 0.0177], 1e-6), False),
        (box([0.2] * 3, (0, -0.9 + 1e-6, 0)), False),
    ],
)
def test_glass_that_cuts_an_orthographic_viewers_plane_is_refused_however_thin(glass, is_cut, turn):
    """The plane is 0.1 m wide, 1 m before the origin: the cut is known, wherever it is."""
    a_rig = rig(glass, projection="orthographic", field=0.1)
    viewer = replace(
        a_rig.viewer, position=a_rig.viewer.position @ turn.T, axes=a_rig.viewer.axes @ turn.T
    )
    glass = replace(a_rig.glasses[0], mesh=replace(glass, vertices=glass.vertices @ turn.T))
    solid = make_surface(glass.mesh.flat())

    if is_cut:
        with pytest.raises(
            RigError, match="glass 'glass' cuts the plane of the orthographic viewer 'viewer'"
        ):
            check_viewer_outside(viewer, glass, solid)
    else:
        check_viewer_outside(viewer, glass, solid)


def test_faces_that_float32_parted_touch():
    """Two cubes side by side, their matrices rounded to float32
    as in Blender, act as one block: no film of air.

    Light meets the face between them beyond the critical angle,
    where a film of air, however thin, would mirror it.
    """
    n = ConstantIndex(1.49)
    degrees = 55
    a = np.radians(degrees)
    turn = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    block = rig(box([0.06, 0.12, 0.06], degrees_about_z=degrees), display=0.1, field=0.02)
    _, _, whole = traced(block)
    random = np.random.default_rng(2)

    for _ in range(12):
        shift = random.uniform(-5, 5, 3)
        cubes = []
        for side in (-1, 1):
            cube = box([0.06] * 3)
            place = (turn @ [0, 0.03 * side, 0] + shift).astype(np.float32).astype(float)
            rounded = cube.vertices @ turn.astype(np.float32).astype(float).T + place - shift
            cubes.append(Glass(f"cube {side}", replace(cube, vertices=rounded), n))
        _, _, found = traced(taken(rig(tuple(cubes), display=0.1, field=0.02), shift=shift))
        assert (found.reason == whole.reason).mean() > 0.999
        both = found.has_arrived & whole.has_arrived
        assert both.mean() > 0.3
        assert np.abs(found.xy - whole.xy)[both].max() < 0.05


@pytest.mark.parametrize("times", [1.5, 3.0])
def test_light_beside_the_image_of_a_uv_map_that_leaves_it_has_missed_the_display(times):
    """Where UV goes beyond 0..1 there is no pixel: light there has
    not arrived, and is told as missing the display.

    It keeps its place beside the image, as that which just
    misses a display does, so that the edge is cut there.
    """
    a_rig = rig(box([0.05] * 3))
    (display,) = a_rig.displays
    uv = times * (display.mesh.uv - 0.5) + 0.5
    larger = replace(a_rig, displays=(replace(display, mesh=replace(display.mesh, uv=uv)),))
    _, _, here = traced(a_rig)
    _, _, there = traced(larger)
    expected = times * (here.xy - 256) + 256
    np.testing.assert_allclose(there.xy[here.has_arrived], expected[here.has_arrived], atol=1e-9)
    is_on_image = ((expected >= 0) & (expected <= 512)).all(axis=1) & here.has_arrived
    assert np.array_equal(there.has_arrived, is_on_image)
    assert (there.reason[here.has_arrived & ~is_on_image] == Reason.MISSED_DISPLAY).all()


def test_a_mirror_as_drawn_reflects_by_its_normals():
    """Interpolated between the corners.

    Where light would be sent through the mirror, by the facet's own.
    """
    corners = np.array([[-0.05, 0, -0.05], [0.05, 0, -0.05], [0, 0, 0.05]])
    bent = closed_forms.unit(np.array([[-0.2, -1, -0.1], [0.1, -1, 0], [0, -1, 0.15]]))
    mesh = Mesh(corners, np.array([[0, 1, 2]]), bent[None], np.ones(1, bool), surface="facets")
    away = Glass("glass", box([0.01] * 3, (0, -3, 0)))
    a_rig = replace(rig((away,)), mirrors=(Mirror("mirror", mesh),))
    u, v = 0.25, 0.3
    at = (1 - u - v) * corners[0] + u * corners[1] + v * corners[2]
    normal = closed_forms.unit((1 - u - v) * bent[0] + u * bent[1] + v * bent[2])
    plan = compile_plan(a_rig, Settings(only_through_glass=False))

    for slope, by in ((0.3, normal), (60.0, np.array([0, -1.0, 0]))):
        d = closed_forms.unit(np.array([-slope, 1.0, 0.1 * slope]))
        found = trace_all(plan, (at - 0.01 * d)[None], d[None])
        expected = d - 2 * (d @ by) * by
        assert (d @ normal < 0) or slope > 1
        assert np.abs(found.directions[0] - expected).max() < 1e-12


def test_light_jumps_within_no_branch():
    """In a hollow ball as drawn, whose bent normals fail at the rim of its inside, rays a billionth
    of a pixel apart land side by side where their branches are the same.
    """
    outside, inside = (icosphere(radius, 2) for radius in (0.025, 0.022))
    ball = Mesh(
        np.concatenate([outside.vertices, inside.vertices]),
        np.concatenate([outside.triangles, len(outside.vertices) + inside.triangles[:, ::-1]]),
        np.concatenate([outside.corner_normals, -inside.corner_normals[:, ::-1]]),
        np.concatenate([outside.is_smooth, inside.is_smooth]),
        surface="facets",
    )
    a_rig = rig(ball, pixels=64, display=0.4, field=0.06)
    plan = compile_plan(a_rig, Settings())

    # places around the inside's rim, and others about a pixel away
    random = np.random.default_rng(3)
    turn, radius = random.random((2, 1500)) * [[2 * np.pi], [0.012]] + [[0], [0.86]]
    rim = 64 * 0.025 / 0.06
    near = 32 + rim * radius[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    far = near + random.normal(size=near.shape)

    # halved again and again: to the half in which light changes most
    for _ in range(35):
        middle = (near + far) / 2
        ends = [trace_all(plan, *a_rig.viewer.rays(xy)) for xy in (near, middle, far)]
        steps = [
            np.nan_to_num(np.linalg.norm(one.xy - other.xy, axis=1))
            for one, other in pairwise(ends)
        ]
        holds = ends[0].branch == ends[1].branch
        is_one = holds & (ends[1].branch == ends[2].branch)
        is_near = np.where(is_one, steps[0] > steps[1], ~holds)[:, None]
        near, far = np.where(is_near, near, middle), np.where(is_near, middle, far)

    first, last = (trace_all(plan, *a_rig.viewer.rays(xy)) for xy in (near, far))
    is_one = (first.branch == last.branch) & (first.branch != 0)
    assert is_one.sum() > 500
    assert np.linalg.norm(first.xy - last.xy, axis=1)[is_one].max() < 1e-3
