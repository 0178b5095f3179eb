"""Laws for any rig and any ray, whatever shape the glass has: tried by hypothesis."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kiriko.core.base.errors import RigError
from kiriko.core.base.steps import run_steps
from kiriko.core.image.picture import picture_from_view
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.optics import reflect, refract
from kiriko.core.light.rays import BY_GAPS, REASON_WORDS, Rays, Reason
from kiriko.core.light.trace import trace_all
from kiriko.core.rig.rig import Blocker, ConstantIndex, Display, Glass, Mesh, Mirror
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.picture_coverage import TOO_FINE
from kiriko.core.solve.session import Session
from known.closed_forms import unit
from known.rasterised import to_display, to_view
from known.reference_rigs import (
    box,
    icosphere,
    rectangle,
    rig,
    rotation,
    taken,
    torus,
    uv_ellipsoid,
    wavy_slab,
)

EPS = np.finfo(float).eps
RAYS = 300
BESIDE = 1e-6  # m: so far behind an interface the medium is asked
# no state is kept between runs: a failure comes again by the numbers that hypothesis prints
few, more = (
    settings(max_examples=n, deadline=None, database=None, derandomize=True) for n in (12, 40)
)

seeds = st.integers(0, 2**32 - 1)
indices = st.one_of(
    st.floats(1.01, 2.5), st.floats(0.5, 0.99), st.sampled_from([1.0, 1 + 1e-9, 1.49, 4.0])
)
sizes = st.floats(0.01, 0.05)


def turned_box(random, size, centre=(0, 0, 0)):
    mesh = box(size)
    return replace(mesh, vertices=mesh.vertices @ rotation(random).T + centre)


def subdivided(mesh, times):
    """Flat triangles cut into four, some times."""
    vertices, t = mesh.vertices, mesh.triangles
    for _ in range(times):
        ends = np.sort(np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]]), axis=1)
        pairs, at = np.unique(ends, axis=0, return_inverse=True)
        ab, bc, ca = (at.ravel() + len(vertices)).reshape(3, -1)
        vertices = np.concatenate([vertices, vertices[pairs].mean(axis=1)])
        a, b, c = t.T
        t = np.concatenate(
            [np.stack(x, axis=1) for x in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))]
        )
    return Mesh(vertices, t)


@st.composite
def flat_glasses(draw, most=3):
    """One to three boxes, turned: apart, nested or overlapping, with priorities and indices."""
    random = np.random.default_rng(draw(seeds))
    glasses = []
    for k in range(draw(st.integers(1, most))):
        size = [draw(sizes) for _ in range(3)]
        mesh = turned_box(random, size, random.uniform(-0.015, 0.015, 3))
        glasses.append(Glass(f"{k}", mesh, ConstantIndex(draw(indices)), draw(st.integers(0, 2))))
    return tuple(glasses)


def rays_at(random, n, reach=0.03, far=0.5):
    """Rays (n, 3) from all round through places near the origin."""
    d = unit(random.normal(size=(n, 3)))
    return random.uniform(-reach, reach, (n, 3)) - far * d, d


def out_of_the_way(glasses):
    """A rig of glass whose plate and display no ray meets."""
    return rig(glasses, distance=1e3, plate=1e-3, display=1e-3)


# one interface


@pytest.mark.numpy_alone
@more
@given(seeds, indices, indices)
def test_an_interface_keeps_length_tangent_and_energy(seed, n1, n2):
    """|direction| = 1, n sin a is kept as a vector, and the shares
    transmitted and reflected are all the light.

    The transmitted share goes by Fresnel's amplitudes behind the face, of which the code knows
    nothing. In cosines c of light, its part of the power is off by as much as they are, in parts of
    themselves.
    """
    random = np.random.default_rng(seed)
    m = unit(random.normal(size=(RAYS, 3)))
    across = unit(np.cross(m, random.normal(size=m.shape)))
    c1 = np.concatenate([random.uniform(0, 1, RAYS - 100), 10 ** random.uniform(-7, 0, 99), [1.0]])
    d = unit(np.sqrt((1 - c1) * (1 + c1))[:, None] * across - c1[:, None] * m)
    c1 = -(d * m).sum(axis=1)
    out, is_tir, transmittance = refract(d, m, *np.full((RAYS, 2), [n1, n2]).T)
    steep = max(1, n1 / n2) ** 2

    assert np.abs(np.linalg.norm(out, axis=1) - 1).max() < 8 * EPS * steep
    behind = np.where(is_tir, n1, n2)[:, None]
    assert (
        np.abs(behind * np.cross(out, m) - n1 * np.cross(d, m)).max() < 16 * EPS * (n1 + n2) * steep
    )
    assert np.array_equal((out * m).sum(axis=1) > 0, is_tir)
    assert np.array_equal(out[is_tir], reflect(d, m)[is_tir])
    assert (transmittance[is_tir] == 1).all()

    some = np.flatnonzero(~is_tir)
    c1 = c1[some]
    c2 = -(out * m).sum(axis=1)[some]
    flux = n2 * c2 / (n1 * c1)
    reflected = ((n1 * c1 - n2 * c2) / (n1 * c1 + n2 * c2)) ** 2 + (
        (n2 * c1 - n1 * c2) / (n2 * c1 + n1 * c2)
    ) ** 2
    amplitudes = (2 * n1 * c1 / (n1 * c1 + n2 * c2)) ** 2 + (2 * n1 * c1 / (n2 * c1 + n1 * c2)) ** 2
    rounding = 64 * EPS * steep / np.minimum(np.minimum(c1, c2), 1) ** 2

    assert (np.abs(transmittance[some] - flux * amplitudes / 2) < rounding).all()
    assert (np.abs(transmittance[some] + reflected / 2 - 1) < rounding).all()
    assert (transmittance >= -8 * EPS).all()
    assert (transmittance <= 1).all()


# a ray and where it is


def parity(mesh, points):
    """Is each point (n, 3) inside a closed mesh: does a ray from
    it cross its triangles an odd number of times?
    """
    way = np.array([0.3141592, 0.2718281, 0.9096])
    a, b, c = np.moveaxis(mesh.corners, 1, 0)
    e1, e2 = b - a, c - a
    h = np.cross(way, e2)
    f = 1 / (e1 * h).sum(axis=1)
    s = points[:, None] - a
    u = f * np.einsum("nti,ti->nt", s, h)
    q = np.cross(s, e1)
    v = f * (q @ way)
    t = f * np.einsum("nti,ti->nt", q, e2)
    return ((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)).sum(axis=1) % 2 == 1


def index_at(glasses, points):
    """Index (n,) at points: of the glass of highest priority they
    are in, among equals of the smallest; air outside.
    """
    volume = [abs(np.linalg.det(g.mesh.corners).sum()) for g in glasses]
    found = np.ones(len(points))
    for k in sorted(range(len(glasses)), key=lambda k: (glasses[k].priority, -volume[k])):
        found[parity(glasses[k].mesh, points)] = glasses[k].ior.at(0)
    return found


def flat(mesh):
    return Mesh(mesh.vertices, mesh.triangles)


@cache
def faceted():
    """Shapes of flat facets that are neither boxes nor, all of them, convex."""
    return (
        flat(icosphere(0.02, 1)),
        flat(torus(0.018, 0.007, 16, 8)),
        flat(uv_ellipsoid((0.025, 0.01, 0.015), 12, 8)),
    )


@few
@given(flat_glasses(most=2), st.integers(-1, 2), seeds)
def test_light_is_in_what_its_place_is_in(glasses, shape, seed):
    """After each event the index that light is in is that of
    the solids around it, by the parity of crossings.

    Places from which the next interface is nearer than twice
    as far as they are looked at are left out.
    """
    random = np.random.default_rng(seed)
    if shape >= 0:
        glasses = (*glasses, Glass("faceted", faceted()[shape], ConstantIndex(1.7), 1))
    plan = compile_plan(out_of_the_way(glasses), Settings())
    o, d = rays_at(random, RAYS)

    asked = 0
    for events in range(1, 9):
        rays = Rays(o, d, None, False)
        run_steps(plan.tracer.follow(replace(plan, settings=Settings(max_events=events)), rays))
        further = Rays(o, d, None, False)
        run_steps(
            plan.tracer.follow(replace(plan, settings=Settings(max_events=events + 1)), further)
        )
        way = np.linalg.norm(further.positions - rays.positions, axis=1)
        some = np.flatnonzero(
            (rays.n_events == events) & ((way > 2 * BESIDE) | (further.n_events == events))
        )
        at = rays.positions[some] + BESIDE * rays.directions[some]
        now = plan.media.index(rays.last_part[some], rays.mask[some])
        assert np.array_equal(now, index_at(glasses, at))
        asked += len(some)

    ended = ~np.isin(rays.reason, (Reason.LOST_INSIDE, Reason.CUT_OFF))
    assert (rays.mask[ended] == 0).all()
    assert asked > RAYS / 10


@few
@given(flat_glasses(), seeds)
def test_light_sent_back_from_its_landing_comes_to_the_viewer(glasses, seed):
    """From the display back through plate and glass the ray goes
    through the point it came from, against its way.

    Of rays that meet as many interfaces: one within rounding of an edge or of the critical angle
    may not. The error is that of rounding, times the factor of grazing interfaces.
    """
    random = np.random.default_rng(seed)
    a_rig = rig(glasses, display=0.4)
    viewer = a_rig.viewer
    o, d = viewer.rays(random.uniform(0, viewer.width, (RAYS, 2)))
    landings = trace_all(compile_plan(a_rig, Settings()), o, d)
    found = landings.has_arrived
    if not found.any():
        return
    screen = Display(
        "eye", rectangle(viewer.position - [0, 0.2, 0], [-1, 0, 0], [0, 0, 1], 20, 20), 10, 10
    )
    back = trace_all(
        compile_plan(replace(a_rig, displays=(screen,)), Settings()),
        landings.positions[found],
        -landings.directions[found],
    )
    same = back.has_arrived & (back.n_events == landings.n_events[found])

    assert same.mean() > 0.98
    assert np.abs(back.directions + d[found])[same].max() < 1e-9
    t = ((viewer.position - back.positions) * back.directions).sum(axis=1)
    passes = back.positions + t[:, None] * back.directions

    assert np.abs(passes - viewer.position)[same].max() < 1e-9


# the whole rig


def landings_of(a_rig, xy):
    return trace_all(compile_plan(a_rig, Settings()), *a_rig.viewer.rays(xy))


def assert_same(here, there, least=0.99):
    """Landings on the same display pixels to 1e-6, but where
    rounding tells which of two faces is met.
    """
    same = (here.reason == there.reason) & (here.n_events == there.n_events)
    assert same.mean() >= least
    apart = np.abs(here.xy - there.xy)[same & here.has_arrived]
    assert np.quantile(apart, 0.99) < 1e-6 if len(apart) else True
    assert apart.max(initial=0) < 1e-3  # px; the most grazing one of hundreds


@cache
def curved():
    return icosphere(0.02, 2), torus(0.018, 0.007, 32, 16), wavy_slab(8)


@few
@given(flat_glasses(), st.integers(-1, 2), seeds, st.floats(-3, 3), st.floats(0, 3))
def test_turned_scaled_and_moved_a_rig_lands_on_the_same_pixels(
    glasses, shape, seed, log_scale, log_shift
):
    """Any rotation, 1e-3 to 1e3 of the size, moved by up to 1e3 times it: 1e-6 display px. Further
    off, faces count as touching that are hundredths of a millimetre apart on a rig of 50 mm.
    """
    random = np.random.default_rng(seed)
    if shape >= 0:
        glasses = (Glass("curved", curved()[shape], ConstantIndex(1.49)),)
    a_rig = rig(glasses)
    scale = 10**log_scale
    other = taken(
        a_rig, rotation(random), scale, scale * 0.1 * 10**log_shift * unit(random.normal(size=3))
    )
    xy = random.uniform(0, a_rig.viewer.width, (RAYS, 2))
    assert_same(landings_of(a_rig, xy), landings_of(other, xy), least=0.98)


@few
@given(flat_glasses(), st.integers(1, 3), seeds)
def test_subdividing_flat_faces_changes_nothing(glasses, times, seed):
    """12 triangles in float64, or 48 to 768 by way of the ray
    engine: the same landings, events and branches.
    """
    a_rig = rig(glasses)
    finer = tuple(replace(glass, mesh=subdivided(glass.mesh, times)) for glass in glasses)
    xy = np.random.default_rng(seed).uniform(0, a_rig.viewer.width, (RAYS, 2))
    assert_same(landings_of(a_rig, xy), landings_of(replace(a_rig, glasses=finer), xy))


# nothing that is no number


@cache
def wild_glasses():
    """Curved, hollow, open, inside out, of index 1 and less: whatever may be drawn."""
    ball, ring, slab = curved()
    inside_out = replace(
        ball, triangles=ball.triangles[:, ::-1], corner_normals=-ball.corner_normals[:, ::-1]
    )
    half = ball.vertices[ball.triangles].mean(axis=1)[:, 2] > 0
    shell = Mesh(
        ball.vertices, ball.triangles[half], ball.corner_normals[half], ball.is_smooth[half]
    )
    cracked = Mesh(ball.vertices, ball.triangles[7:])
    inner = icosphere(0.015, 2, smooth=False)
    hollow = Mesh(
        np.concatenate([ball.vertices, inner.vertices]),
        np.concatenate([ball.triangles, inner.triangles + len(ball.vertices)]),
    )

    return ball, ring, slab, hollow, inside_out, shell, cracked, *faceted()


@more
@given(
    st.integers(0, 9),
    flat_glasses(most=1),
    indices,
    seeds,
    st.sampled_from(["imaged", "folded", "reflected"]),
)
def test_nothing_that_is_no_number_comes_of_any_ray(shape, others, n, seed, light):
    """Places, directions and throughput are finite, directions unit;
    a pixel is NaN exactly where nothing landed.

    Rays from anywhere, through vertices and along axes and
    edges among them, past a mirror and a blocker.
    """
    random = np.random.default_rng(seed)
    mesh = wild_glasses()[shape]
    a_rig = rig((Glass("wild", mesh, ConstantIndex(n)), *others), display=0.2)
    a_rig = replace(
        a_rig,
        mirrors=(Mirror("mirror", rectangle([0.1, 0, 0], [0, 1, 0], [0, 0, 1], 0.1, 0.1)),),
        blockers=(Blocker("blocker", rectangle([-0.1, 0, 0], [0, 1, 0], [0, 0, 1], 0.1, 0.1)),),
    )
    o, d = rays_at(random, RAYS)
    to_vertex = mesh.vertices[random.integers(0, len(mesh.vertices), RAYS)] - o
    along = np.eye(3)[random.integers(0, 3, RAYS)]
    o = np.concatenate([o, o, mesh.vertices[random.integers(0, len(mesh.vertices), RAYS)] - along])
    d = np.concatenate([d, unit(to_vertex), along])
    found = trace_all(compile_plan(a_rig, Settings(brightness=True)), o, d, light)

    assert np.isfinite(found.positions).all()
    assert np.abs(np.linalg.norm(found.directions, axis=1) - 1).max() < 1e-14
    assert ((found.throughput >= 0) & (found.throughput <= 1)).all()
    is_number = np.isfinite(found.xy)

    assert (is_number[:, 0] == is_number[:, 1]).all()
    assert is_number[found.has_arrived].all()
    assert np.array_equal(is_number[:, 0], found.branch != 0)
    beside = is_number[:, 0] & ~found.has_arrived

    assert (found.reason[beside] == Reason.MISSED_DISPLAY).all()
    # such a ray just missed the display: beyond its image it has a place, not on it
    assert not ((found.xy[beside] > 0) & (found.xy[beside] < a_rig.display.width)).all(axis=1).any()


# both sides of the shares


def shoelace(polygon):
    """Area of a polygon (n, 2)."""
    x, y = polygon.T
    return 0.5 * abs((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())


@few
@given(
    st.floats(-40, 40),
    st.floats(1.1, 2),
    st.floats(0.02, 0.2),
    st.integers(8, 40),
    st.integers(8, 40),
)
def test_shares_sum_to_what_is_covered_on_both_sides(degrees, n, side, pixels, display_pixels):
    """Viewer's side: the area whose rays land on the
    display. Display's side: the area they land on.

    A tilted slab maps the viewer's whole image one to one. Where the display is larger than its
    image, both areas are known: all viewer pixels, and the polygon that the viewer's border lands
    on. Where it is smaller, it is all covered.
    """
    a_rig = rig(
        box([0.3, 0.02, 0.3], degrees_about_z=degrees),
        ior=n,
        display=side,
        pixels=pixels,
        display_pixels=display_pixels,
    )
    solution = run_steps(Session().solve(a_rig, Settings(tolerance=0.01)))

    viewed = 0.0
    shown = 0.0
    seen = 0.0
    lit = 0.0
    for shares in solution.first.shares:
        ones = np.ones(len(shares))
        viewed = viewed + shares.area.sum()
        shown = shown + shares.display_area.sum()
        seen = seen + to_view(shares, ones).sum()
        lit = lit + to_display(shares, ones).sum()

    assert abs(seen - viewed) < 1e-9 * viewed
    assert abs(lit - viewed) < 1e-9 * viewed
    t = np.linspace(0, pixels, 400, endpoint=False)
    sides = (t, 0 * t), (pixels + 0 * t, t), (pixels - t, pixels + 0 * t), (0 * t, pixels - t)
    border = np.concatenate([np.stack(side, axis=1) for side in sides])
    xy = landings_of(a_rig, border).xy
    is_all_on = ((xy > 0) & (xy < display_pixels)).all()

    if is_all_on:
        assert abs(viewed - pixels**2) < 1e-9 * pixels**2
        assert abs(shown - shoelace(xy)) < 1e-4 * shown + 1e-3
    else:
        fine = (np.arange(512) + 0.5) * pixels / 512
        landed = landings_of(
            a_rig, np.stack(np.meshgrid(fine, fine), axis=-1).reshape(-1, 2)
        ).has_arrived
        assert abs(viewed / pixels**2 - landed.mean()) < 4 / 512
        assert shown < display_pixels**2 * (1 + 1e-9)

    assert solution.display_coverage.max() <= 1
    assert abs(solution.first.view_coverage.sum() - viewed) < 1e-6 * pixels**2


@st.composite
def lossy_rigs(draw):
    """Rigs that lose light in all ways: flat facets, gaps, small
    plates and displays, odd UV maps, few surfaces.
    """
    random = np.random.default_rng(draw(seeds))
    shape = draw(st.sampled_from(["boxes", "facets", "gap", "smooth"]))
    ball = icosphere(0.02, draw(st.integers(0, 2)), smooth=shape == "smooth")
    glass = {
        "boxes": lambda: draw(flat_glasses(2)),
        "gap": lambda: replace(
            ball, triangles=ball.triangles[random.random(len(ball.triangles)) < 0.9]
        ),
    }.get(shape, lambda: ball)()
    n = draw(st.integers(4, 24))
    a_rig = rig(
        glass,
        ior=draw(indices),
        pixels=n,
        display_pixels=draw(st.integers(1, 24)),
        display=draw(st.floats(0.01, 0.1)),
        plate=draw(st.floats(0.05, 0.488)),
        picture=draw(st.floats(0.01, 0.06)),
    )
    (display,) = a_rig.displays
    uv = draw(st.floats(0.3, 3.0)) * (display.mesh.uv - 0.5) + 0.5 + draw(st.floats(-0.3, 0.3))

    return replace(a_rig, displays=(replace(display, mesh=replace(display.mesh, uv=uv)),))


@more
@given(lossy_rigs(), st.integers(2, 12), st.booleans())
def test_coverage_and_reasons_make_the_whole(a_rig, max_events, only_through_glass):
    """The shown part of the picture, and the missing ones, by reason, are shares of it, and 1
    together.
    """
    how = Settings(max_events=max_events, only_through_glass=only_through_glass, tolerance=0.5)
    try:
        found = run_steps(Session().solve(a_rig, how))
    except RigError:  # no ray arrives
        return
    shares = [found.picture_coverage, *found.misses.values()]
    assert min(shares) > -1e-9
    assert abs(sum(shares) - 1) < 1e-9


@pytest.mark.parametrize("shape", ["facets", "gap", "ball", "cut"])
def test_shares_by_reason_are_those_of_rays(shape):
    """Rays through random points of the viewer's image, each
    weighed by its part of the picture, end as told.

    Within a hundredth: rays tell it to a few thousandths, and slivers along borders, narrower
    than a pixel, which are not shown, take half a hundredth of so many pixels.
    """
    ball = icosphere(0.02, 4 if shape == "ball" else 1, smooth=shape == "ball")
    if shape == "gap":
        ball = replace(ball, triangles=np.delete(ball.triangles, np.s_[::9], axis=0))
    options = (
        {"plate": 0.08, "display": 0.03} if shape == "ball" else {"plate": 0.2, "display": 0.06}
    )
    a_rig = rig(ball, ior=1.7, pixels=256, display_pixels=64, picture=0.034, **options)
    how = Settings(max_events=5 if shape == "cut" else 32)
    found = run_steps(Session().solve(a_rig, how))
    random = np.random.default_rng(5)
    xy = random.uniform(0, 256, (200_000, 2))
    cover = picture_from_view(a_rig.picture_place, a_rig.viewer, xy).cover
    seen = cover > 0
    landings = trace_all(compile_plan(a_rig, how), *a_rig.viewer.rays(xy[seen]))
    reason = np.where(
        landings.has_arrived & (landings.xy < 0).any(axis=1), Reason.MISSED_DISPLAY, landings.reason
    )
    is_leaked = landings.leak >= 0
    weight = cover[seen] / cover.sum()
    of_reason = np.bincount(reason[~is_leaked], weight[~is_leaked], len(Reason))
    leaked = weight[is_leaked].sum()

    assert found.picture_coverage == pytest.approx(of_reason[Reason.ARRIVED], abs=0.01)
    told = dict(found.misses)
    assert told.pop(BY_GAPS, 0.0) == pytest.approx(leaked, abs=0.01)
    assert told.pop(TOO_FINE, 0.0) < 0.01
    for number, word in REASON_WORDS.items():
        assert told.pop(word, 0.0) == pytest.approx(of_reason[number], abs=0.01), word

    assert told == {}
