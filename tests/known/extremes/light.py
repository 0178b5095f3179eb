"""Extreme cases of light: indices of refraction, angles, ill-conditioned maps."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from kiriko.core.base.steps import run_steps
from kiriko.core.base.vectors import dot
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.optics import refract
from kiriko.core.light.rays import Reason
from kiriko.core.light.trace import tracing
from kiriko.core.rig.rig import ConstantIndex, Glass, Mesh, Rig
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.solution import Solution

from .. import closed_forms
from ..reference_rigs import box, icosphere, rig, uv_ellipsoid
from .cases import (
    EPS,
    SLAB,
    Extended,
    Floats,
    N,
    Rows,
    X,
    Y,
    Z,
    at_aerial_plane,
    ball_rig,
    case,
    exact,
    furthest,
    layers,
    on,
    ramp,
    rays_of,
    reflected_in_plate,
    slab_rig,
    solve,
    traced,
    within,
    without_plate,
    worst,
)


@case("indices", "index exactly 1")
def index_one(quick: bool) -> Rows:
    random = np.random.default_rng(1)
    n = 20_000 if quick else 1_000_000
    normals = closed_forms.unit(random.normal(size=(n, 3)))
    across = closed_forms.unit(np.cross(normals, random.normal(size=(n, 3))))
    cosine = 10.0 ** random.uniform(-16, 0, n)[:, None]
    d = -cosine * normals + np.sqrt(1 - cosine**2) * across
    d = np.where(dot(d, normals)[:, None] > 0, -d, d)
    out, is_tir, _ = refract(d, normals, *np.full((2, n), N))
    yield exact(
        "directions changed by an interface, cosines from 1e-16 to 1", np.count_nonzero(out != d)
    )
    yield exact("total reflections among them", np.count_nonzero(is_tir))

    for name, glass in (
        ("box", box([0.05] * 3, degrees_about_z=15.8)),
        ("ball", icosphere(0.025, 4)),
        (
            "two boxes, one in the other",
            (
                Glass("a", box([0.05] * 3), ConstantIndex(1.0)),
                Glass("b", box([0.02] * 3), ConstantIndex(1.0)),
            ),
        ),
    ):
        a_rig = rig(glass, ior=1.0, field=0.035)
        o, d = rays_of(a_rig)
        found = traced(a_rig, o, d)
        off = worst(found.positions - reflected_in_plate(at_aerial_plane(o, d)))
        missed = 0.0 if found.has_arrived.all() and (found.n_events >= 4).all() else np.inf
        yield exact(f"landing, {name}", off + missed, 8 * np.spacing(1.15), "m")


@case("indices", "1 - 1e-9 and 1 + 1e-9")
def index_nearly_one(quick: bool) -> Rows:
    # a prism of 60 degrees, 1 m before the aerial plane, so that
    # it displaces by far more than places are rounded
    half, height = 0.02, 0.03
    v = np.array(
        [
            [x, y, z]
            for z in (-height, height)
            for x, y in ((-2 * half, -half), (-2 * half, half), (half, 0))
        ]
    )
    v -= Y
    t = np.array(
        [[0, 1, 2], [3, 5, 4], [0, 3, 4], [0, 4, 1], [1, 4, 5], [1, 5, 2], [2, 5, 3], [2, 3, 0]]
    )
    first = ((v[2] + v[0]) / 2, np.cross(v[2] - v[0], Z))
    last = ((v[2] + v[1]) / 2, np.cross(v[2] - v[1], Z))
    straight_rig = rig(
        Mesh(v, t), ior=1.0, field=0.01, viewer_distance=1.1, projection="orthographic"
    )
    o, d = rays_of(straight_rig, 33)
    straight = traced(straight_rig, o, d).positions
    glass = straight_rig.glasses[0]

    for n in (1 - 1e-9, 1 + 1e-9):
        bent_rig = replace(straight_rig, glasses=(replace(glass, ior=ConstantIndex(n)),))
        found = traced(bent_rig, o, d).positions - straight
        p, leaves = on(o, d, [(*first, 1.0, n), (*last, n, 1.0)])
        by_law = reflected_in_plate(at_aerial_plane(p, leaves)) - reflected_in_plate(
            at_aerial_plane(o, d)
        )
        off = worst(found - by_law) / worst(by_law)
        yield within(f"displacement at n - 1 = {n - 1:.0e}, of itself", off, 1e-6, "")


@case("indices", "1.0001 to 4, slab and ball")
def index_range(quick: bool) -> Rows:
    for n in (0.75, 1.0001, 1.333, 1.49, 2.0, 4.0):
        a_rig = slab_rig(box(SLAB, degrees_about_z=15.0), ior=n)
        o, d = rays_of(a_rig)
        a = np.radians(15)
        normal = np.array([-np.sin(a), np.cos(a), 0])
        exit_ = on(o, d, [(-0.01 * normal, normal, 1, n), (0.01 * normal, normal, n, 1)])
        yield exact(
            f"landing, slab of index {n:g}",
            furthest(a_rig, traced(a_rig, o, d), exit_),
            1e-11,
            "px",
        )
        a_rig = ball_rig(quick, ior=n, display=0.1)
        o, d = rays_of(a_rig)
        with np.errstate(
            invalid="ignore"
        ):  # totally reflected where the ball is the thinner medium
            through = closed_forms.through_ball(o, d, 0.025, n)
        yield within(
            f"landing, ball of index {n:g}",
            furthest(a_rig, traced(a_rig, o, d), through, 0.1),
            2e-3 if quick else 5e-5,
        )


@case("indices", "index 2: a ball focuses on its back")
def ball_of_two(quick: bool) -> Rows:
    a_rig = ball_rig(quick, ior=2.0, projection="orthographic", field=0.02)
    o, d = rays_of(a_rig)
    steps = []
    run_steps(tracing(compile_plan(a_rig, Settings()), o, d, steps=steps))
    b = np.hypot(o[:, 0], o[:, 2])

    # the chord turns the exit point to 2 a' - a off the
    # axis, which begins with the third power of b
    angle = 2 * np.arcsin(b / 0.025 / 2) - np.arcsin(b / 0.025)
    expected = 0.025 * np.stack(
        [np.sin(angle) * o[:, 0] / b, np.cos(angle), np.sin(angle) * o[:, 2] / b], axis=1
    )
    yield within(
        "where rays meet the back", worst(steps[1].place - expected), 1e-8 if quick else 1e-9, "m"
    )
    near = b < 1e-3
    spread = np.hypot(*steps[1].place[near][:, [0, 2]].T).max()
    yield within(
        "spot on the back, of rays within 1 mm of the axis",
        spread,
        0.025 * (1e-3 / 0.025) ** 3,
        "m",
    )


@case("indices", "bubble in water")
def bubble(quick: bool) -> Rows:
    water = 1.333
    bubble = icosphere(0.01, 4 if quick else 5)
    tank = box([0.3, 0.1, 0.3])
    a_rig = rig(
        (Glass("water", tank, ConstantIndex(water)), Glass("air", bubble, ConstantIndex(1.0))),
        display=0.1,
        field=0.022,
    )
    o, d = rays_of(a_rig)
    found = traced(a_rig, o, d)
    p, inside = on(o, d, layers((-0.05, water)))
    nearest = np.linalg.norm(p - (p * inside).sum(1, keepdims=True) * inside, axis=1) / 0.01
    with np.errstate(invalid="ignore"):  # totally reflected at the bubble
        q, leaves = closed_forms.through_ball(p, inside, 0.01, 1 / Extended(water))
    exit_ = on(q, leaves, [(0.05 * Y, Y, water, 1.0)])
    yield within(
        "landing through the bubble", furthest(a_rig, found, exit_, 0.1), 2e-3 if quick else 5e-5
    )

    # beyond b = R / n light is turned back into the water at
    # the bubble: it meets it once, or goes a long way
    sure = np.abs(nearest - 1 / water) > 1e-4
    turned = sure & (nearest > 1 / water) & (nearest < 0.99) & found.has_arrived
    passed = sure & (nearest < 1 / water) & found.has_arrived
    wrong = (found.n_events[turned] == 6).sum() + (found.n_events[passed] != 6).sum()
    yield exact(
        "rays of the wrong class, reflected or passed",
        wrong if turned.sum() + passed.sum() > 500 else np.inf,
    )


@case("indices", "1e-12 between nested media")
def nearly_equal(quick: bool) -> Rows:
    # so near to grazing that 1e-12 bends light by as much as it
    # slants, or turns it back: below a slope of 1.41e-6
    slopes = np.array([1.2e-6, 1.4e-6, 1.5e-6, 2e-6, 1e-5, 1e-4])
    o = np.stack([-0.1 * slopes, np.full(len(slopes), -0.1), 0 * slopes + 0.01], axis=1)
    d = closed_forms.unit(
        np.stack([N * slopes, np.sqrt(1 - (N * slopes) ** 2), 0 * slopes], axis=1)
    )

    for more in (-1e-12, 1e-12):
        inner = N * (1 + more)
        a_rig = without_plate(
            rig(
                (
                    Glass("outer", box([0.2, 0.2, 0.2]), ConstantIndex(N)),
                    Glass("inner", box([0.05, 0.1, 0.1], (0.025, 0, 0)), ConstantIndex(inner)),
                )
            )
        )
        found = traced(a_rig, o - 0.1 * d, d)
        # n sin, kept by the entry
        n1 = Extended(N)
        n2 = Extended(inner)
        slant = d[:, 0].astype(Extended)
        k = (n2 - n1) * (n2 + n1) + slant**2  # (n2 cos)^2 behind the face
        expected = np.where(k < 0, -slant, np.sqrt(np.maximum(k, 0)))
        off = np.abs(found.directions[:, 0] / expected - 1)
        yield exact(
            f"rays of the wrong class, inner {more:+.0e}",
            np.count_nonzero((found.directions[:, 0] < 0) != (k < 0)),
        )
        yield exact(
            f"slope behind it, slopes of 1e-6 to 1e-4, inner {more:+.0e}",
            worst(off),
            1e-14,
            "of itself",
        )


@case("angles", "critical angle, +- 1e-3 to 1e-15 rad")
def critical(quick: bool) -> Rows:
    eta = Extended(N)
    apart_by = np.concatenate([s * 10.0 ** -np.arange(3, 16) for s in (-1, 1)])
    random = np.random.default_rng(3)

    off_by = []
    unsure = []
    for _ in range(20 if quick else 2000):
        normal = closed_forms.unit(random.normal(size=3))
        across = closed_forms.unit(np.cross(normal, random.normal(size=3)))
        angle = (np.arcsin(1 / eta) + apart_by.astype(Extended))[:, None]
        d = (np.sin(angle) * across - np.cos(angle) * normal).astype(float)
        out, is_tir, _ = refract(
            d, np.tile(normal, (len(d), 1)), np.full(len(d), N), np.ones(len(d))
        )
        # the answer for the rounded direction and normal, in extended precision
        long_d = d.astype(Extended)
        long_n = closed_forms.unit(normal.astype(Extended))
        c = -(long_d * long_n).sum(1, keepdims=True)
        along = long_d + c * long_n
        sine = np.sqrt((along**2).sum(1) / (long_d**2).sum(1))
        k = 1 - eta**2 * sine**2
        off = np.abs(np.arcsin(np.minimum(sine, 1)) - np.arcsin(1 / eta))
        wrong = is_tir != (k < 0)
        unsure.append(off[wrong].max(initial=0))
        passed = ~is_tir & (k > 0) & (off > 1e-14)
        expected = eta * along - np.sqrt(np.maximum(k, 0))[:, None] * long_n
        allowed = 4 * EPS / np.sqrt(np.maximum(k, 1e-30))
        off_by.append((np.linalg.norm(out - expected, axis=1) / allowed)[passed].max())

    yield exact(
        "furthest from the critical angle that a ray is put into the wrong class",
        worst(unsure),
        1e-14,
        "rad",
    )
    yield exact("error of the direction, of 4 eps / sqrt k", worst(off_by), 1.0)


@case("angles", "critical angle, through a box")
def critical_traced(quick: bool) -> Rows:
    # in at the front, at the side face beyond or below the critical angle: at n = 1.3 both can be
    n = 1.3
    a_rig = without_plate(rig(box([0.05, 0.4, 0.4]), ior=n))
    apart_by = np.concatenate([s * 10.0 ** -np.arange(3, 14) for s in (-1, 1)])
    inside = np.arcsin(1 / Extended(n)) + apart_by  # at the side
    entry = np.arcsin(n * np.cos(inside))  # at the front, from its normal
    d = np.stack([np.sin(entry), np.cos(entry), 0 * entry], axis=1).astype(float)
    o = np.tile([-0.01, -0.2, 0.01], (len(d), 1)) - 0.1 * d
    found = traced(a_rig, o, d)
    _, leaves = on(o, d, [(-0.2 * Y, Y, 1, n), (0.025 * X, X, n, 1)])
    by_law = np.isnan(leaves[:, 0].astype(float))
    passes = found.n_events == 2
    yield exact(
        "rays put into the wrong class, from 1e-13 rad on", np.count_nonzero(passes == by_law)
    )
    yield within(
        "direction behind it, 1e-3 to 1e-12 rad below",
        _of_bound(found.directions, leaves, passes, apart_by),
        1.0,
        "of 8 eps / sqrt k",
    )


def _of_bound(found: Floats, expected: Floats, some: Floats, apart_by: Floats) -> float:
    """Error of directions as a part of the error that the condition of
    the problem allows after two interfaces.
    """
    some = some & (np.abs(apart_by) > 5e-13)
    k = np.abs(apart_by[some]) * 2
    return float((np.linalg.norm(found - expected, axis=1)[some] / (8 * EPS / np.sqrt(k))).max())


@case("angles", "grazing, 89.9 to 89.999999 degrees")
def grazing(quick: bool) -> Rows:
    a_rig = slab_rig()
    for degrees in (89.9, 89.99, 89.999, 89.9999, 89.999999):
        a = np.radians(degrees)
        d = np.tile([np.sin(a), np.cos(a), 0], (9, 1))
        d = closed_forms.unit(d + np.linspace(0, 0.1, 9)[:, None] * Z)
        o = np.array([0, -0.01, 0]) - 0.1 * d + 1e-3 * np.arange(9)[:, None] * X
        found = traced(a_rig, o, d)
        p, leaves = on(o, d, layers((-0.01, N), (0.01, 1.0)))
        off = worst(found.positions - p, found.directions - leaves)
        bound = (
            2 * EPS / np.cos(a)
        )  # where a plane is met is as uncertain as its distance over this cosine
        yield exact(
            f"exit point (m) and direction, {degrees} degrees",
            off if (found.n_events == 2).all() else np.inf,
            bound,
            "",
        )


@case("angles", "normal incidence")
def normal_incidence(quick: bool) -> Rows:
    a_rig = slab_rig(projection="orthographic")
    o, d = rays_of(a_rig)
    found = traced(without_plate(a_rig), o, d)
    yield exact(
        "directions changed",
        np.count_nonzero(found.directions != d) + np.count_nonzero(found.n_events != 2),
    )
    found = traced(a_rig, o, d)
    yield exact(
        "landing",
        worst(found.positions - reflected_in_plate(at_aerial_plane(o, d))),
        8 * np.spacing(1.15),
        "m",
    )


@case("angles", "rays along a face")
def along_a_face(quick: bool) -> Rows:
    for name, glass in (
        ("box", box([0.02, 0.05, 0.02])),
        ("box of 60 triangles", quartered(box([0.02, 0.05, 0.02]))),
    ):
        a_rig = rig(glass, projection="orthographic", field=0.05)
        edge = np.linspace(-0.01, 0.01, 11)
        face = np.full(11, 0.01)
        o = np.concatenate(
            [np.stack([s * face, -1 + 0 * edge, edge], axis=1) for s in (-1, 1)]
            + [np.stack([edge, -1 + 0 * edge, s * face], axis=1) for s in (-1, 1)]
        )
        d = np.tile(Y, (len(o), 1))
        found = traced(a_rig, o, d)
        # in the glass or beside it: light goes straight on either way
        ends = np.isin(found.reason, (Reason.ARRIVED, Reason.MISSED_GLASS))
        straight = reflected_in_plate(at_aerial_plane(o, d))
        off = np.abs(found.positions - straight)[found.has_arrived].max(initial=0)
        yield exact(f"landing, {name}", off if ends.all() else np.inf, 8 * np.spacing(1.15), "m")


def quartered(mesh: Mesh) -> Mesh:
    """Each triangle in four (flat)."""
    a, b, c = mesh.corners.transpose(1, 0, 2)
    ab = (a + b) / 2
    bc = (b + c) / 2
    ca = (c + a) / 2
    corners = np.concatenate(
        [np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    )
    v, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    return Mesh(v, index.reshape(-1, 3))


@case("angles", "rays through vertices and edges, even and odd grids")
def through_vertices(quick: bool) -> Rows:
    shapes = {
        "ball with its pole in view": uv_ellipsoid([0.025] * 3, 32, 16, pole=1)
        if quick
        else uv_ellipsoid([0.025] * 3, 128, 64, pole=1),
        "icosphere": icosphere(0.025, 3 if quick else 5),
    }
    bound = 0.02 if quick else 3e-5

    for name, mesh in shapes.items():
        for pixels in (32, 33):
            a_rig = rig(mesh, pixels=pixels, projection="orthographic", field=0.03)
            o, d = rays_of(a_rig, 2 * pixels + 1, (0, 0))  # the pixels' corners and middles
            found = traced(a_rig, o, d)
            through = closed_forms.through_ball(o, d, 0.025, N)
            yield within(f"landing, {name}, {pixels} px", furthest(a_rig, found, through), bound)
            yield exact("rays lost inside", np.count_nonzero(found.reason == Reason.LOST_INSIDE))

    for pixels in (32, 33):
        seen = solve(
            rig(
                box([0.05] * 3),
                pixels=pixels,
                display_pixels=64,
                projection="orthographic",
                field=0.08,
            )
        )
        cover = seen.first.view_coverage
        yield exact(
            f"cube, {pixels} px: left and right, top and bottom differ",
            worst(cover - cover[:, ::-1], cover - cover[::-1]),
            1e-9,
            "px^2",
        )
        yield within(
            "area seen through the cube",
            abs(cover.sum() - (pixels * 50 / 80) ** 2),
            2.0**-9 * 4 * pixels,
            "px^2",
        )


@dataclass(frozen=True)
class Lens:
    """A ball seen by parallel rays, and its effect on one at
    a distance b from its axis, by the closed form.

    beyond : m, from its centre to the aerial plane; n : its index
    """

    beyond: float
    n: float = N
    radius: float = 0.025

    def rig(self, quick: bool, **options: object) -> Rig:
        mesh = icosphere(self.radius, 4 if quick else 6, centre=(0, -self.beyond, 0))
        return rig(
            mesh, ior=self.n, **({"projection": "orthographic", "viewer_distance": 0.3} | options)
        )

    def through(self, o: Floats, d: Floats) -> tuple[Floats, Floats]:
        p, leaves = closed_forms.through_ball(o + self.beyond * Y, d, self.radius, self.n)
        return p - self.beyond * Y, leaves

    def stretch(self, b: Floats) -> tuple[Floats, Floats]:
        """Singular values of the map from viewer to display, m / m: along and across the radius."""
        r, n = self.radius, self.n
        t = 2 * (np.arcsin(b / r) - np.arcsin(b / (n * r)))
        slope = 2 * (1 / np.sqrt(r**2 - b**2) - 1 / np.sqrt((n * r) ** 2 - b**2))
        high = b - self.beyond * np.sin(t)
        return (
            (1 - self.beyond * np.cos(t) * slope) * np.cos(t) + high * np.sin(t) * slope
        ) / np.cos(t) ** 2, (high / np.cos(t) / b)


def off_map(
    a_rig: Rig, solution: Solution, through: Callable[[Floats, Floats], tuple[Floats, Floats]]
) -> float:
    """Error, display px, that 99.9 % of random places of the map stay below, against a
    closed form.
    """
    at = np.random.default_rng(5).uniform(0, (a_rig.viewer.width, a_rig.viewer.height), (20_000, 2))
    expected = closed_forms.landing(a_rig, *through(*a_rig.viewer.rays(at))).astype(float)
    found = solution.first.view_map.display_from_view(at)
    with np.errstate(invalid="ignore"):
        is_seen = ((expected > 0) & (expected < (a_rig.display.width, a_rig.display.height))).all(
            axis=1
        )
    off = np.nan_to_num(np.linalg.norm(found - expected, axis=1)[is_seen], nan=np.inf)
    return float(np.quantile(off, 0.999)) if len(off) > 1000 else np.inf


def off_areas(
    a_rig: Rig, solution: Solution, through: Callable[[Floats, Floats], tuple[Floats, Floats]]
) -> float:
    """Where the viewer's area goes, on 8 x 8 parts of the display,
    against dense rays: greatest error, of the whole.
    """
    w = a_rig.display.width
    h = a_rig.display.height
    k = max(1, 1024 // a_rig.viewer.width)
    x, y = np.meshgrid(
        *((np.arange(size * k) + 0.5) / k for size in (a_rig.viewer.width, a_rig.viewer.height))
    )
    landings = closed_forms.landing(
        a_rig, *through(*a_rig.viewer.rays(np.stack([x.ravel(), y.ravel()], axis=1)))
    )
    counts, *_ = np.histogram2d(landings[:, 1], landings[:, 0], bins=8, range=((0, h), (0, w)))
    found = solution.weight.reshape(8, h // 8, 8, w // 8).sum(axis=(1, 3))
    return float(np.abs(found - counts / k**2).max() / (counts.sum() / k**2))


def lens_rows(quick: bool, lens: Lens, **options: object) -> Rows:
    """Landings, map and areas of a ball as a lens."""
    a_rig = lens.rig(
        quick, display_pixels=64 if quick else 512, pixels=64 if quick else 256, **options
    )
    o, d = rays_of(a_rig)
    yield within(
        "landing", furthest(a_rig, traced(a_rig, o, d), lens.through(o, d)), 5e-5 if quick else 1e-6
    )
    found = solve(a_rig)
    yield within(
        "map, 99.9 % of places, tolerance 0.1 px", off_map(a_rig, found, lens.through), 0.1
    )
    yield within(
        "viewer's area on 8 x 8 parts of the display, of the whole",
        off_areas(a_rig, found, lens.through),
        1e-3 if quick else 1e-4,
        "",
    )
    yield exact(
        "values of the source image that are no numbers",
        np.count_nonzero(~np.isfinite(found.source)),
    )


@case("maps", "det J = 0: aerial plane at the back focus")
def at_focus(quick: bool) -> Rows:
    yield from lens_rows(quick, Lens(N * 0.025 / (2 * (N - 1))), field=0.03, display=0.02)


@case("maps", "critical curves that touch: index 2")
def touching_curves(quick: bool) -> Rows:
    # the focus of index 2 is on the ball's back, where the curves
    # along and across the radius shrink to one point
    yield from lens_rows(quick, Lens(0.0255, 2.0), field=0.03, display=0.02)


@case("maps", "caustic inside the display")
def caustic(quick: bool) -> Rows:
    yield from lens_rows(quick, Lens(0.06), field=0.03, display=0.05)


@case("maps", "condition numbers from 1e2 to 1e8")
def conditions(quick: bool) -> Rows:
    lens = Lens(0.032)
    a_rig = lens.rig(quick, field=0.03, display=0.02)
    b = np.linspace(1e-4, 0.014, 20_001)
    radial, across = lens.stretch(b)
    fold = b[np.flatnonzero(np.diff(np.sign(radial)))[0]]
    view_map = solve(a_rig).first.view_map

    for power in (2, 4, 6, 8):
        low = np.full(1, fold - 0.002)
        high = np.full(1, fold + 1e-6)
        for _ in range(200):  # where along / across is 10^-power
            middle = (low + high) / 2
            radial, across = lens.stretch(middle.astype(Extended))
            is_short = np.abs(radial) * np.sign(
                radial * lens.stretch(low)[0]
            ) > 10.0**-power * np.abs(across)
            low = np.where(is_short, middle, low)
            high = np.where(is_short, high, middle)
        angle = np.linspace(0, 2 * np.pi, 100)
        o = np.stack([low * np.cos(angle), np.full(100, -0.3), low * np.sin(angle)], axis=1)
        d = np.tile(Y, (100, 1))
        found = traced(a_rig, o, d)
        radial, across = lens.stretch(low.astype(Extended))
        condition = float(np.abs(across / radial)[0])
        through = lens.through(o, d)
        yield within(
            f"landing where it is {condition:.1e}",
            furthest(a_rig, found, through),
            2e-4 if quick else 1e-6,
        )
        mapped = view_map.display_from_view(a_rig.viewer.project(o))
        yield within(
            "map there, tolerance 0.1 px",
            worst(mapped - closed_forms.landing(a_rig, *through)),
            0.1,
        )


@case("maps", "a display pixel seen by 1e5 viewer pixels, and the reverse")
def many_to_one(quick: bool) -> Rows:
    # glass of index 1: the picture lies on the display as it is, turned by the plate
    for n_viewer, n_display in ((96, 3), (3, 96)) if quick else ((1024, 3), (3, 1024)):
        a_rig = slab_rig(
            pixels=n_viewer,
            display_pixels=n_display,
            ior=1.0,
            image=ramp(),
            projection="orthographic",
            field=0.02,
            display=0.02,
            picture=0.04,
        )
        found = solve(a_rig)
        x, y = np.meshgrid(*2 * [(np.arange(n_display) + 0.5) / n_display])
        # the display's middle half of the picture, its up turned to down by the plate
        off = worst(
            found.source[..., 0] - (0.25 + 0.5 * x), found.source[..., 1] - (0.25 + 0.5 * y)
        )
        yield within(
            f"{n_viewer}^2 viewer, {n_display}^2 display pixels: colours of a ramp", off, 1e-6, ""
        )
        yield exact("area", abs(found.weight.sum() - n_viewer**2) / n_viewer**2, 1e-12, "")

    lens = Lens(N * 0.025 / (2 * (N - 1)))
    pixels = 96 if quick else 1024
    a_rig = lens.rig(quick, display_pixels=8, pixels=pixels, field=0.03, display=0.016)
    found = solve(
        a_rig, tolerance=0.01
    )  # of a display pixel, or light beside its border counts for the next one
    most = (
        f"ball at its focus, {pixels}^2 viewer, 8^2 display pixels: up to"
        f" {found.weight.max():.0f} on one"
    )
    yield within(f"{most}, of all that is seen", off_areas(a_rig, found, lens.through), 1e-3, "")
