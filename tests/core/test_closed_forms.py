"""The judge judged: closed forms that need roots against
mpmath and against the invariants of a path through a solid.
"""

import mpmath
import numpy as np
import pytest

from known import closed_forms
from known.reference_rigs import mean_normals, torus, uv_ellipsoid, wavy_slab

MAJOR = 0.018
MINOR = 0.007
N = 1.49
SLAB = {"size": 0.075, "thickness": 0.02, "amplitude": 0.001}
SOLIDS = {
    "torus": (closed_forms.torus(MAJOR, MINOR), MAJOR + MINOR, MINOR),
    "wavy slab": (closed_forms.wavy_slab(**SLAB), 0.055, 0.0158),
}


def rays(n, seed=7):
    """Rays from 0.3 m away, in all directions, through a ball of 25 mm."""
    rng = np.random.default_rng(seed)
    d = closed_forms.unit(rng.normal(size=(n, 3)))
    target = rng.uniform(-0.0144, 0.0144, (n, 3))
    return target - 0.3 * d, d


def paths(solid, n=400):
    parts, bound, bend = SOLIDS[solid]
    o, d = rays(n)
    points, directions, is_regular = closed_forms.follow(o, d, parts, N, bound, bend)
    return o[is_regular], d[is_regular], points[is_regular], directions[is_regular]


def precise_torus(x, y, z):
    return mpmath.sqrt((mpmath.sqrt(x * x + z * z) - mpmath.mpf(MAJOR)) ** 2 + y * y) - mpmath.mpf(
        MINOR
    )


def precise_slab(x, y, z):
    size, thickness, amplitude = (mpmath.mpf(v) for v in SLAB.values())
    k = 6 * mpmath.pi / size
    m = 5 * mpmath.pi / size
    front = amplitude * mpmath.sin(k * x) * mpmath.sin(k * z) - thickness / 2
    back = amplitude * mpmath.cos(m * x) * mpmath.cos(m * z) + thickness / 2
    return max(front - y, y - back, abs(x) - size / 2, abs(z) - size / 2)


def precise_path(f, o, d, guesses):
    """The path in 40 digits: roots near the guesses, normals by
    mpmath's own derivative, Snell's law by its vectors.
    """
    p = mpmath.matrix(o)
    d = mpmath.matrix(d)
    d /= mpmath.norm(d)
    for k, guess in enumerate(guesses):
        start = mpmath.norm(mpmath.matrix(guess) - p)
        t = mpmath.findroot(
            lambda t, p=p, d=d: f(*(p + t * d)), (start, start * (1 + mpmath.mpf(10) ** -12))
        )
        p = p + t * d
        normal = mpmath.matrix(
            [mpmath.diff(f, tuple(p), order) for order in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
        )
        normal /= mpmath.norm(normal)
        eta = mpmath.mpf(N) if k % 2 else 1 / mpmath.mpf(N)
        c = -(normal.T * d)[0]
        normal, c = (normal, c) if c > 0 else (-normal, -c)
        d = eta * d + (eta * c - mpmath.sqrt(1 - eta**2 * (1 - c**2))) * normal
        yield [float(x) for x in p], [float(x) for x in d]


@pytest.mark.parametrize("solid", SOLIDS)
def test_paths_are_those_of_forty_digits(solid):
    """Each point within 1e-15 m of mpmath's where it is first
    met, and all within 1e-13 at the end of the path.

    A curved interface multiplies an error by less than 1 /
    GRAZING = 10; roots are good to 1e-16 m at 0.3 m.
    """
    f = precise_torus if solid == "torus" else precise_slab
    o, d, points, directions = paths(solid)
    count = np.isfinite(points[..., 0]).sum(axis=1)
    chosen = np.concatenate([np.flatnonzero(count == k)[:6] for k in np.unique(count)])
    with mpmath.workdps(40):
        for ray in chosen:
            guesses = points[ray, : count[ray]]
            for k, (p, e) in enumerate(precise_path(f, o[ray], d[ray], guesses)):
                assert np.abs(points[ray, k] - p).max() < (1e-15 if k == 0 else 1e-13)
                assert np.abs(directions[ray, k] - e).max() < 1e-12 * (1 if k == 0 else 10)
    assert solid != "torus" or {2, 4} <= set(count[chosen])


def test_a_torus_of_index_1_is_met_at_the_roots_of_the_quartic():
    """The number of crossings and their distances are those of the
    polynomial's real roots, found by companion matrix.

    Roots of a quartic are good to the square root of rounding
    where two are near each other, hence 3e-9 m.
    """
    o, d = rays(300)
    points, _, is_regular = closed_forms.follow(
        o, d, closed_forms.torus(MAJOR, MINOR), 1.0, MAJOR + MINOR, MINOR
    )

    counts = []
    for ray in np.flatnonzero(is_regular):
        p = o[ray] + 0.3 * d[ray]
        e = d[ray]
        # (|p + t e|^2 + R^2 - r^2)^2 = 4 R^2 (x^2 + z^2)
        square = np.array([1, 2 * p @ e, p @ p + MAJOR**2 - MINOR**2])
        flat_p = p[[0, 2]]
        flat_e = e[[0, 2]]
        ring = 4 * MAJOR**2 * np.array([flat_e @ flat_e, 2 * flat_p @ flat_e, flat_p @ flat_p])
        roots = np.roots(np.polysub(np.polymul(square, square), ring))
        roots = np.sort(roots[np.abs(roots.imag) < 1e-7].real)
        t = (points[ray] - p) @ e
        t = t[np.isfinite(t)]
        assert len(t) == len(roots)
        assert np.abs(t - roots).max() < 3e-9
        counts.append(len(t))

    assert {2, 4} == set(counts)


def test_a_slab_without_waves_is_a_slab():
    """Amplitude 0: the slab formula to rounding at 0.3 m, for the rays that meet front and back."""
    o, d = rays(500)
    p, e, _ = closed_forms.through_wavy_slab(o, d, 0.075, 0.02, 0.0, N)
    q, f = closed_forms.through_slab(
        o, d, np.array([0, 1.0, 0]), -0.01 * np.sign(d[:, 1:2]) * [0, 1, 0], 0.02, N
    )
    entry = o + ((-0.01 * np.sign(d[:, 1]) - o[:, 1]) / d[:, 1])[:, None] * d
    both = (np.abs(entry[:, [0, 2]]) < 0.0375).all(axis=1) & (np.abs(q[:, [0, 2]]) < 0.0375).all(
        axis=1
    )
    assert both.sum() > 200
    assert np.abs(p - q)[both].max() < 1e-15
    assert np.abs(e - f)[both].max() < 1e-14


MESHES = {
    "ellipsoid": (
        lambda s: uv_ellipsoid((0.025, 0.02, 0.015), s, s // 2),
        4 / 3 * np.pi * 0.025 * 0.02 * 0.015,
    ),
    "ball, poles on y": (
        lambda s: uv_ellipsoid((0.025,) * 3, s, s // 2, pole=1),
        4 / 3 * np.pi * 0.025**3,
    ),
    "torus": (lambda s: torus(MAJOR, MINOR, s, s // 2), 2 * np.pi**2 * MAJOR * MINOR**2),
    "wavy slab": (
        lambda s: wavy_slab(s // 2),
        0.075**2 * 0.02 + 0.001 * (2 * 0.075 / (5 * np.pi)) ** 2,
    ),
}


@pytest.mark.parametrize("shape", MESHES)
def test_meshes_are_closed_and_enclose_the_solid(shape):
    """Every edge has two faces, once in each direction.

    The volume goes to the solid's with the square of the edge.
    """
    make, volume = MESHES[shape]
    errors = []
    for segments in (64, 128):
        mesh = make(segments)
        directed = np.concatenate([mesh.triangles[:, [i, (i + 1) % 3]] for i in range(3)])
        assert len(np.unique(directed, axis=0)) == len(directed)
        assert {tuple(e) for e in directed} == {tuple(e) for e in directed[:, ::-1]}
        a, b, c = np.moveaxis(mesh.corners, 1, 0)
        errors.append(abs((a * np.cross(b, c)).sum() / 6 / volume - 1))
    assert errors[1] < 3e-3  # a polygon of 64 sides has 1.6e-3 less area than its circle
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)


@pytest.mark.parametrize("shape", MESHES)
def test_mean_normals_go_to_the_surface_s_own(shape):
    """Angle between mean and own normals shrinks at least with the edge.

    Flat faces keep theirs exactly.
    """
    make, _ = MESHES[shape]
    worst = []
    for segments in (64, 128):
        mesh = make(segments)
        mean = mean_normals(mesh)
        off = np.linalg.norm(mean.corner_normals - mesh.corner_normals, axis=2)
        assert mean.has_mean_normals
        assert (off[~mesh.is_smooth] == 0).all()
        worst.append(off.max())
    assert worst[1] < 0.6 * worst[0] < 0.06
