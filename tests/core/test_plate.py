"""The mirror array in closed form: against marching, fifty
digits, a mesh of its mirrors, and the symmetries of a plate.
"""

from dataclasses import replace

import mpmath
import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from kiriko.core.base.errors import RigError
from kiriko.core.base.steps import run_steps
from kiriko.core.glass.surfaces import make_surface
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.optics import plane_symmetry, reflect
from kiriko.core.light.plate import ArrayFrame, PlatePath, array_frame, fold
from kiriko.core.light.rays import Reason
from kiriko.core.light.rig_parts import find_thin_surfaces
from kiriko.core.light.trace import trace
from kiriko.core.rig.rig import Kind, MirrorArray, Plate
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session
from known.closed_forms import unit
from known.marching import march, turned
from known.mirror_mesh import MirrorMesh, agreement, plate_frame, random_light
from known.reference_rigs import ball_rig, box, rectangle

EPS = np.finfo(float).eps
LAYOUTS = "crossed", "holes", "radial"
IMAGED = PlatePath.IMAGED
STRAY_1 = PlatePath.STRAY_1
STRAY_2 = PlatePath.STRAY_2
THROUGH = PlatePath.THROUGH
# phases a direction, at the middle of equal steps: a share
# of them is off by 1 / GRID an end at the most
GRID = 200


def frame_of(array, seed=None):
    """An array at the origin in its own axes, or anywhere."""
    if seed is None:
        return ArrayFrame(array, np.zeros(3), np.eye(3))
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    axes[2] = np.cross(axes[0], axes[1])
    return ArrayFrame(array, rng.uniform(-0.5, 0.5, 3), axes)


def light_on(frame, n, least=0.03, seed=0):
    """Light (n, 3) on a plate of 0.4 m, both ways, cosines to
    its normal from `least` to 1, equally in logarithms.
    """
    rng = np.random.default_rng(seed)
    cosine = least ** rng.uniform(0, 1, n)
    azimuth = rng.uniform(0, 2 * np.pi, n)
    sine = np.sqrt(1 - cosine**2)
    local = np.stack(
        [sine * np.cos(azimuth), sine * np.sin(azimuth), cosine * rng.choice([-1, 1], n)], axis=1
    )
    return frame.centre + rng.uniform(-0.2, 0.2, (n, 2)) @ frame.axes[:2], unit(local @ frame.axes)


def at_angle(degrees, azimuth=0.0, way=1):
    """A unit direction at an angle to the normal z.

    Azimuth 0 is the symmetric plane, 45 across the first mirrors.
    """
    a, b = np.radians([degrees, azimuth])
    return np.array([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), way * np.cos(a)])


def all_phases(array, direction, n=GRID):
    """One direction (n^2, 3) met at n x n places of one period of both directions of mirrors."""
    steps = array.pitch * (np.arange(n) + 0.5) / n
    u, v = (a.ravel() for a in np.meshgrid(steps, steps))
    place = np.stack([u - v, u + v, 0 * u], axis=1) / np.sqrt(2)
    return place, np.broadcast_to(direction, place.shape).copy()


def pitches_crossed(array, direction):
    """|r| of the two layers: by how many pitches light would
    pass mirrors, by Snell's law in angles.
    """
    inside = np.arcsin(np.hypot(*direction[:2]) / array.ior)
    across = np.arctan2(direction[1], direction[0]) - np.pi / 4 * np.array([1, 3])
    return np.abs(array.height * np.tan(inside) * np.cos(across)) / array.pitch


def odd(r):
    """Share of phases with an odd number of mirrors between 0 and
    r: r up to one pitch, then falling, and so on.
    """
    r = r % 2
    return r if r <= 1 else 2 - r


ARRAYS = {
    "crossed": MirrorArray(),
    "crossed wrong": MirrorArray(crossing_error=0.02, phase=(0.3, -0.2)),
    "fine, high": MirrorArray(pitch=0.1e-3, height=3e-3, ior=1.8),
    "air": MirrorArray(ior=1.0, phase=(0.1, 0.4)),
    "holes": MirrorArray("holes", phase=(0.3, -0.2)),
    "holes in air": MirrorArray("holes", pitch=0.1e-3, height=0.3e-3, ior=1.0),
    "radial": MirrorArray("radial", phase=(0.3, -0.2)),
}


@pytest.mark.parametrize("name", ARRAYS)
def test_a_fold_comes_out_where_marching_from_mirror_to_mirror_does(name):
    """Number of reflections equal; place within 8 eps (|place| +
    way) k / cos^2, direction within 16 eps k / cos.

    k is 1 + the number of reflections, each of which rounds once in the march. A plate met at a
    small cosine turns a rounding of the direction into one of the place by 1 / cos^2: once as light
    runs to the face, once as it runs back.
    """
    array = replace(ARRAYS[name], reflectance=0.5, has_fresnel=False)
    frame = frame_of(array, seed=3)
    light = light_on(frame, 20_000)
    found = frame.folded(*light)
    expected = march(array, frame.centre, frame.axes, *light)

    assert expected.clearance.min() > 1e-13, (
        "a ray so near to an edge that rounding decides: choose another seed"
    )
    n_reflections = expected.n_reflections.sum(axis=0)

    assert np.array_equal(found.throughput, 0.5**n_reflections)
    is_odd = expected.n_reflections % 2 == 1
    assert np.array_equal(
        found.path, np.array([[THROUGH, STRAY_2], [STRAY_1, IMAGED]])[tuple(is_odd.astype(int))]
    )
    assert np.bincount(found.path, minlength=5)[1:5].min() > 1000

    k = 1 + n_reflections
    cosine = np.abs(light[1] @ frame.axes[2])
    apart = np.linalg.norm(found.positions - expected.positions, axis=1)
    assert (
        apart < 8 * EPS * (np.linalg.norm(light[0], axis=1) + expected.path) * k / cosine**2
    ).all()
    assert (
        np.abs(found.directions - expected.directions).max(axis=1) < 16 * EPS * k / cosine
    ).all()


def test_the_march_reflects_as_a_single_mirror_does():
    """The judge judged, by hand: in at 0.1 p from a mirror, reflected half way, out at
    0.1 p again.
    """
    array = MirrorArray("holes", pitch=1e-3, height=2e-3, ior=1.0, has_fresnel=False)
    u = np.array([1, 1, 0]) / np.sqrt(2)
    v = np.array([-1, 1, 0]) / np.sqrt(2)
    direction = unit(
        np.array([-0.2e-3 * u + [0, 0, 2e-3]])
    )  # 0.2 pitches towards the mirror while it crosses
    entry = 0.1e-3 * u + 0.5e-3 * v - [0, 0, 1e-3]
    middle = entry + direction * (1e-3 / direction[0, 2])
    found = march(array, np.zeros(3), np.eye(3), middle, direction)

    assert found.n_reflections.tolist() == [[1], [0]]
    out = unit(0.2e-3 * u + [0, 0, 2e-3])
    at_exit = found.positions[0] + out * (1e-3 / out[2])
    assert np.abs(found.directions[0] - out).max() < 1e-15
    assert np.abs(at_exit - (0.1e-3 * u + 0.5e-3 * v + [0, 0, 1e-3])).max() < 1e-18


reals = st.floats(-1e6, 1e6, allow_nan=False)
slopes = st.one_of(st.floats(-5, 5), st.floats(-1e4, 1e4), st.integers(-50, 50).map(float))


@given(q=st.one_of(reals, st.floats(-3, 3), st.integers(-700, 700).map(float)), travel=slopes)
@example(q=0.0, travel=-1e-300)
@example(q=-1e-300, travel=1.0)
@example(q=3.0, travel=-2.0)
@example(q=0.9999999999999999, travel=2e-16)
def test_a_fold_agrees_with_fifty_digits(q, travel):
    """q' is within one rounding of q + travel of the exact fold, and
    in the same slit; so is n, but at an edge itself.

    The fold is continuous where light comes out at a mirror's edge:
    there rounding may decide on one reflection more.
    """
    out, n_reflections = (float(a[0]) for a in fold(np.array([q]), np.array([travel])))
    with mpmath.workdps(50):
        unfolded = mpmath.mpf(q) + mpmath.mpf(travel)
        slit = mpmath.floor(q)
        into = mpmath.floor(unfolded)
        n = abs(into - slit)
        exact = slit + (unfolded - into if n % 2 == 0 else 1 - (unfolded - into))
        rounding = EPS * max(1, abs(q), abs(unfolded))
        assert abs(mpmath.mpf(out) - exact) <= rounding
        is_at_edge = abs(unfolded - mpmath.nint(unfolded)) <= rounding
        assert abs(n_reflections - n) <= (1 if is_at_edge else 0)
    assert np.floor(q) <= out <= np.floor(q) + 1


arrays = st.builds(
    MirrorArray,
    layout=st.sampled_from(LAYOUTS),
    pitch=st.floats(1e-5, 1e-2),
    height=st.floats(1e-5, 1e-2),
    ior=st.one_of(st.just(1.0), st.floats(1.0, 3.0)),
    reflectance=st.one_of(st.sampled_from([0.0, 1.0]), st.floats(0, 1)),
    has_fresnel=st.booleans(),
    phase=st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
)
# whole multiples of a tenth of the pitch are among them: light
# through mirrors' edges and through the centre
places = st.tuples(st.floats(-100, 100), st.floats(-100, 100)) | st.tuples(
    st.integers(-9, 9), st.integers(-9, 9)
)
azimuths = st.floats(0, 2 * np.pi) | st.sampled_from(list(np.pi / 4 * np.arange(8)))
cosines = st.floats(0, 1) | st.sampled_from([0.0, 1e-300, 1e-15, 1e-13, 1e-12, 1e-9, 1e-5, 1.0])


def one_ray(array, place, azimuth, cosine, way):
    """A frame in its own axes and a ray (1, 3) met at a place
    given in pitches along the mirrors' normals.
    """
    u, v = place
    position = array.pitch * np.array([[u - v, u + v, 0.0]]) / np.sqrt(2)
    sine = np.sqrt((1 - cosine) * (1 + cosine))
    return (
        frame_of(array),
        position,
        np.array([[sine * np.cos(azimuth), sine * np.sin(azimuth), way * cosine]]),
    )


@given(arrays, places, azimuths, cosines, st.sampled_from([1.0, -1.0]))
def test_a_plate_gives_numbers_from_grazing_to_normal(array, place, azimuth, cosine, way):
    """Nothing is NaN or infinite, directions are unit to 4 eps,
    on the right side, and throughput is from 0 to 1.
    """
    frame, position, direction = one_ray(array, place, azimuth, cosine, way)
    with np.errstate(divide="raise", invalid="raise", over="raise"):
        for light in (frame.imaged, frame.folded, frame.reflected):
            found = light(position, direction)
            assert np.isfinite(found.positions).all()
            assert np.linalg.norm(found.directions[0]) == pytest.approx(1, abs=4 * EPS)
            assert 0 <= found.throughput[0] <= 1
            if cosine > 0:
                assert np.sign(found.directions[0, 2]) == (
                    -way if light == frame.reflected else way
                )
            # along the plate light keeps its slope, whichever way it is turned
            slopes_along = np.linalg.norm([found.directions[0, :2], direction[0, :2]], axis=1)
            assert slopes_along[0] == pytest.approx(slopes_along[1], abs=4 * EPS)


@given(arrays, places, azimuths, st.floats(0.02, 1), st.sampled_from([1.0, -1.0]))
def test_light_sent_back_comes_out_where_it_came_in(array, place, azimuth, cosine, way):
    """Reversed, light takes its own way: place, direction, path
    and throughput, where it does not touch an edge.
    """
    assume(array.layout != "radial")  # there mirrors turn with the place at which light comes in
    frame, position, direction = one_ray(array, place, azimuth, cosine, way)
    size = np.abs(position).max() + (array.thickness + array.pitch) / cosine
    clear = 1e-9 * array.pitch + 128 * EPS * size / cosine**2
    assume(march(array, frame.centre, frame.axes, position, direction).clearance[0] > clear)
    there = frame.folded(position, direction)
    back = frame.folded(there.positions, -there.directions)
    assert back.path[0] == there.path[0]
    assert np.abs(back.directions + direction).max() < 32 * EPS / cosine
    assert np.abs(back.positions - position).max() < 128 * EPS * size / cosine**2
    assert back.throughput[0] == pytest.approx(there.throughput[0], rel=64 * EPS / cosine**2)


@pytest.mark.parametrize("layout", ["crossed", "holes"])
def test_the_image_sent_back_is_the_object(layout):
    """Sent back, imaged light comes out where and as it came in, with the same throughput."""
    array = MirrorArray(layout, crossing_error=0.03 if layout == "crossed" else 0.0)
    frame = frame_of(array, seed=2)
    positions, directions = light_on(frame, 2000, least=0.1)
    there = frame.imaged(positions, directions)
    back = frame.imaged(there.positions, -there.directions)
    assert np.abs(back.directions + directions).max() < 1e-14
    assert np.abs(back.throughput - there.throughput).max() < 1e-12
    assert np.abs(back.positions - positions).max() < 1e-13


@pytest.mark.parametrize("layout", LAYOUTS)
def test_each_reflection_costs_the_reflectance_and_each_face_its_fresnel_loss(layout):
    """Throughput is T^2 rho^n, with T of the textbook's angle form and n counted by the march."""
    array = MirrorArray(layout)
    frame = frame_of(array, seed=4)
    positions, directions = light_on(frame, 3000, least=0.05)
    n = march(array, frame.centre, frame.axes, positions, directions).n_reflections.sum(axis=0)
    expected = (1 - fresnel(np.abs(directions @ frame.axes[2]), array.ior)) ** 2 * 0.87**n
    assert np.abs(frame.folded(positions, directions).throughput - expected).max() < 1e-12


def fresnel(cosine, n):
    """Reflectance of power of unpolarised light, by angles."""
    a = np.arccos(cosine)
    b = np.arcsin(np.sin(a) / n)
    return 0.5 * ((np.sin(a - b) / np.sin(a + b)) ** 2 + (np.tan(a - b) / np.tan(a + b)) ** 2)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_face_reflects_what_it_does_not_transmit_as_a_mirror_there(layout):
    """Reflected light lies on the ray that a mirror at the
    near face sends back; R is Fresnel's and R + T = 1.
    """
    frame = frame_of(MirrorArray(layout, reflectance=1.0), seed=6)
    positions, directions = light_on(frame, 3000, least=0.05)
    normal = frame.axes[2]
    cosine = directions @ normal
    found = frame.reflected(positions, directions)
    to_face = frame.array.thickness / 2 / np.abs(cosine)
    face = positions - to_face[:, None] * directions

    assert (
        np.abs((face - frame.centre) @ normal + np.sign(cosine) * frame.array.thickness / 2).max()
        < 1e-14
    )

    mirrored = reflect(directions, np.broadcast_to(normal, directions.shape))
    assert np.abs(found.directions - mirrored).max() < 1e-15
    assert np.abs(np.cross(face - found.positions, mirrored)).max() < 1e-14
    assert np.abs(found.throughput - fresnel(np.abs(cosine), 1.52)).max() < 1e-12

    transmitted = np.sqrt(
        frame.folded(positions, directions).throughput
    )  # both faces, mirrors that lose nothing
    assert np.abs(found.throughput + transmitted - 1).max() < 1e-14
    assert (found.path == PlatePath.REFLECTED).all()

    bare = replace(frame, array=replace(frame.array, has_fresnel=False))
    assert (bare.reflected(positions, directions).throughput == 0).all()


def test_without_a_change_of_index_grazing_light_passes_the_faces():
    """At n = 1 a face reflects nothing, down to 1e-11 of
    grazing, however steep the Fresnel formula is there.
    """
    frame = frame_of(MirrorArray(ior=1.0))
    cosine = 10.0 ** np.linspace(-11, 0, 200)
    directions = np.stack(
        [np.sqrt((1 - cosine) * (1 + cosine)) * np.cos(0.3), 0 * cosine, cosine], axis=1
    )
    directions[:, 1] = np.sqrt((1 - cosine) * (1 + cosine)) * np.sin(0.3)
    assert np.abs(frame.reflected(np.zeros((200, 3)), directions).throughput).max() < 1e-14


@pytest.mark.parametrize("layout", ["crossed", "holes"])
@pytest.mark.parametrize("degrees", [5, 20, 45, 60, 80])
@pytest.mark.parametrize("azimuth", [0, 17, 45, 80, 200, 290])
@pytest.mark.parametrize("way", [1, -1])
def test_shares_are_those_of_the_formula_in_and_out_of_the_symmetric_plane(
    layout, degrees, azimuth, way
):
    """Pu Pv are imaged, Pu (1 - Pv) and (1 - Pu) Pv stray in one
    layer, the rest goes through: to 2 steps of phase.
    """
    array = MirrorArray(layout)
    direction = at_angle(degrees, azimuth, way)
    path = frame_of(array).folded(*all_phases(array, direction)).path
    share = np.bincount(path, minlength=5) / len(path)
    first, second = map(odd, pitches_crossed(array, direction))
    expected = (
        first * second,
        first * (1 - second),
        (1 - first) * second,
        (1 - first) * (1 - second),
    )
    assert np.abs(share[[IMAGED, STRAY_1, STRAY_2, THROUGH]] - expected).max() < 2 / GRID


@pytest.mark.parametrize("layout", ["crossed", "holes"])
@pytest.mark.parametrize(
    ("degrees", "azimuth", "way"), [(30, 0, 1), (45, 10, -1), (65, 25, 1), (48.4, 180, 1)]
)
def test_the_image_is_the_mean_of_what_the_mirrors_make_of_it(layout, degrees, azimuth, way):
    """Over all phases: mean place of the mid-air class and its
    share of light are those of `imaged`; blur is uniform.

    A mean over equal steps of phase is off by half a step an end; the blur's quantiles by two.
    Light comes out within +-p P(r) of the image along each normal, wherever it came in.
    """
    array = MirrorArray(layout, has_fresnel=False)
    frame = frame_of(array)
    positions, directions = all_phases(array, at_angle(degrees, azimuth, way))
    crossed = frame.folded(positions, directions)
    imaged = frame.imaged(positions, directions)

    assert (imaged.path == IMAGED).all()
    is_image = crossed.path == IMAGED
    assert np.abs(crossed.directions[is_image] - imaged.directions[is_image]).max() < 1e-15
    share = np.where(is_image, crossed.throughput, 0).mean()

    assert imaged.throughput == pytest.approx(np.full(len(positions), share), abs=2 / GRID)
    off = (crossed.positions - imaged.positions)[is_image] / array.pitch
    assert np.abs(off[:, 2]).max() < 1e-12
    for normal, r in zip(
        np.array([[1, 1], [-1, 1]]) / np.sqrt(2), pitches_crossed(array, directions[0]), strict=True
    ):
        blur = np.sort(off[:, :2] @ normal)
        assert np.abs(blur).max() <= odd(r) + 1e-12
        assert abs(blur.mean()) < 1 / GRID
        uniform = odd(r) * (2 * (np.arange(len(blur)) + 0.5) / len(blur) - 1)
        assert np.abs(blur - uniform).max() < 4 / GRID


@pytest.mark.parametrize(
    ("degrees", "azimuth", "way"), [(45, 0, 1), (45, 0, -1), (30, 70, 1), (70, 200, -1)]
)
def test_two_layers_shift_the_image_sideways_by_the_tangent_in_the_glass(degrees, azimuth, way):
    """Beside the ideal plate's, the image is h tan(theta in glass) off.

    One layer of holes shifts nothing.
    """
    position = np.array([[0.03, -0.02, 0.0]])
    direction = at_angle(degrees, azimuth, way)[None]
    crossed, holes = (
        frame_of(MirrorArray(layout)).imaged(position, direction) for layout in ("crossed", "holes")
    )
    ideal = plane_symmetry(direction, np.array([[0.0, 0.0, 1.0]]))
    shift = 1.25e-3 * np.tan(np.arcsin(np.sin(np.radians(degrees)) / 1.52))
    moved = (crossed.positions - position)[0]

    assert np.linalg.norm(moved) == pytest.approx(shift, rel=1e-12)
    assert np.abs(holes.positions - position).max() < 1e-17
    for found in (crossed, holes):
        assert np.abs(found.directions - ideal).max() < 1e-15
    if azimuth == 0:
        assert shift == pytest.approx(0.657e-3, abs=0.0005e-3)
        assert abs(moved[0]) < 1e-17  # across the symmetric plane


@pytest.mark.parametrize("error", [0.01, -0.05])
@pytest.mark.parametrize("way", [1, -1])
def test_layers_crossed_wrong_turn_the_image_by_twice_the_error(error, way):
    """Crossed at 90 + eps degrees light leaves turned by 2 eps about the normal.

    Against the normal by -2 eps.
    """
    frame = frame_of(MirrorArray(crossing_error=error), seed=8)
    positions, directions = light_on(frame, 1000, least=0.2)
    chosen = np.sign(directions @ frame.axes[2]) == way
    positions = positions[chosen]
    directions = directions[chosen]
    ideal = plane_symmetry(directions, np.broadcast_to(frame.axes[2], directions.shape))
    across = (ideal @ frame.axes[2])[:, None] * frame.axes[2]
    expected = across + turned(ideal - across, frame.axes[2], 2 * way * error)
    crossed = frame.folded(positions, directions)

    assert np.abs(frame.imaged(positions, directions).directions - expected).max() < 1e-14
    is_image = crossed.path == IMAGED
    assert is_image.sum() > 50
    assert np.abs(crossed.directions - expected)[is_image].max() < 1e-14


@pytest.mark.parametrize(
    ("layout", "error"), [("crossed", 0.0), ("crossed", 0.02), ("holes", 0.0), ("radial", 0.0)]
)
def test_a_plate_whose_normal_is_reversed_is_the_same_plate(layout, error):
    """Its two directions change places, phases change places and
    sign, and so do the two kinds of stray light.
    """
    array = MirrorArray(layout, phase=(0.3, -0.1), crossing_error=error)
    turned_round = replace(array, phase=(0.1, -0.3))
    frame = frame_of(array, seed=9)
    c = np.cos(error)
    s = np.sin(error)
    x, y, z = frame.axes

    # the present first layer was the second, turned by
    # the error: from it sides and mirrors are told
    side = c * x + s * y
    other = ArrayFrame(turned_round, frame.centre, np.stack([side, np.cross(-z, side), -z]))
    light = light_on(frame, 5000, least=0.1)
    one = frame.folded(*light)
    two = other.folded(*light)

    assert np.abs(one.positions - two.positions).max() < 1e-12
    assert np.abs(one.directions - two.directions).max() < 1e-13
    assert np.array_equal(one.throughput, two.throughput)
    swapped = np.arange(6)
    swapped[[STRAY_1, STRAY_2]] = STRAY_2, STRAY_1

    assert np.array_equal(one.path, swapped[two.path])
    same = frame.imaged(*light)
    reversed_ = other.imaged(*light)
    assert np.abs(same.positions - reversed_.positions).max() < 1e-12
    assert np.abs(same.directions - reversed_.directions).max() < 1e-13
    assert np.abs(same.throughput - reversed_.throughput).max() < 1e-12


def test_the_closed_form_agrees_with_a_mesh_of_all_mirrors():
    """Through Embree, the nearer a ray goes on to the mirror just
    met, the more come out the same; in the end all.

    A step off a mirror moves the ray, so a share of rays, about as large as step / pitch, passes an
    edge on the other side. The plate is 40 mm wide, so that float32 can still tell a step of 3e-5
    mm.
    """
    mesh = MirrorMesh(plate_frame(side=0.04, is_own=True), side=0.04)
    assert mesh.n_mirrors == [
        114,
        114,
    ]  # as many odd multiples of p / 2 are within +-40 mm / sqrt(2)

    light = random_light(mesh.frame, 50_000, side=0.04)
    found = [agreement(mesh, light, offset) for offset in (1e-2, 1e-3, 3e-4, 3e-5)]
    shares = [each.path for each in found]
    assert shares == sorted(shares)
    assert shares[0] < 0.99
    assert found[-1].path > 0.9997
    assert found[-1].place > 0.9997

    for each, offset in zip(found, (1e-2, 1e-3, 3e-4, 3e-5), strict=True):
        assert each.apart < 2 * offset


def test_the_frame_of_a_plate_stands_where_its_mesh_does():
    """Its centre is the middle of the extent or as told.

    Its rows are a side, the other, the normal: a right hand.
    """
    mesh = rectangle(
        np.array([0.1, 0.2, 0.3]), np.array([0, 0.6, 0.8]), np.array([1.0, 0, 0]), 0.2, 0.1
    )
    normal = np.cross([0, 0.6, 0.8], [1.0, 0, 0])
    frame = array_frame(Plate("plate", mesh, MirrorArray()), normal)

    assert np.abs(frame.centre - [0.1, 0.2, 0.3]).max() < 1e-15
    assert np.abs(frame.axes - [[0, 0.6, 0.8], [1, 0, 0], normal]).max() < 1e-14
    told = Plate(
        "plate", mesh, MirrorArray(), side=np.array([1.0, 0, 0]), centre=np.array([0.12, 0.2, 0.3])
    )
    frame = array_frame(told, normal)

    assert np.abs(frame.axes - [[1, 0, 0], np.cross(normal, [1, 0, 0]), normal]).max() < 1e-14
    assert np.abs(frame.centre - [0.12, 0.2, 0.3]).max() < 1e-15


BAD = {
    "Pitch 0 mm": {"pitch": 0.0},
    "Pitch -1 mm": {"pitch": -1e-3},
    "Pitch nan mm": {"pitch": np.nan},
    "Pitch inf mm": {"pitch": np.inf},
    "Mirror Height 0 mm": {"height": 0.0},
    "Mirror Height -2 mm": {"height": -2e-3},
    "Mirror Height nan mm": {"height": np.nan},
    "Reflectance -0.1: set it from 0.001 to 1": {"reflectance": -0.1},
    "Reflectance 1.1": {"reflectance": 1.1},
    "Reflectance nan": {"reflectance": np.nan},
    "IOR 0.9: set it above 1": {"ior": 0.9},
    "IOR nan": {"ior": np.nan},
    "IOR inf": {"ior": np.inf},
    "Crossing Error 20.: set it from -10 to 10": {"crossing_error": np.radians(20)},
    "Crossing Error nan": {"crossing_error": np.nan},
    "one layer: set Crossing Error to 0": {"crossing_error": 0.01, "layout": "holes"},
    "has one layer": {"crossing_error": 0.01, "layout": "radial"},
    "a number that is not finite": {"phase": (0.0, np.nan)},
}


def with_array(array, **options):
    bench = ball_rig(1, pixels=32, display_pixels=32, **options)
    return replace(bench, plates=(replace(bench.plates[0], array=array),))


@pytest.mark.parametrize("words", BAD)
def test_a_plate_that_cannot_be_made_is_refused_in_one_sentence(words):
    """The sentence names the plate, its fault, and the remedy."""
    with pytest.raises(RigError, match=words) as told:
        with_array(MirrorArray(**BAD[words])).check()
    sentence = str(told.value)
    assert sentence.startswith("The plate 'plate' has")
    assert ": set " in sentence or ": check " in sentence
    assert sentence.endswith(".")


def test_a_plate_smaller_than_a_pitch_is_refused_in_one_sentence():
    """It has no two mirrors: the plan says how wide it is and how far mirrors are apart."""
    with pytest.raises(
        RigError,
        match=r"'plate' is 0\.4 mm wide, less than its pitch of 0\.5 mm: scale",
    ):
        compile_plan(with_array(MirrorArray(), plate=0.4e-3), Settings())
    compile_plan(with_array(MirrorArray(), plate=0.6e-3), Settings())
    strip = rectangle(np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), 0.1, 0.3e-3)
    with pytest.raises(RigError, match=r"0\.3 mm wide, less than"):
        array_frame(Plate("plate", strip, MirrorArray()), np.array([0, 0, 1.0]))


@pytest.mark.parametrize("light", ["imaged", "folded", "reflected"])
def test_light_in_the_plates_own_plane_passes_it_by(light):
    """Exactly in the plane it meets no plate.

    A hair beside it meets it at grazing. No number is lost either way.
    """
    rig = with_array(MirrorArray())
    x, y, z = np.eye(3)
    plate = replace(rig.plates[0], mesh=rectangle(0.15 * y, x, y, 0.1, 0.1))
    rig = replace(rig, plates=(plate,))
    plan = compile_plan(rig, replace(Settings(), only_through_glass=False))
    heights = np.array([0.0, 0.0, 1e-15, 1e-12, 1e-6])
    start = np.array([[0.0, 0.08, 0.0]] * 5) + heights[:, None] * z
    directions = np.tile(y, (5, 1))
    directions[1] = unit(y + 0.3 * x)
    directions[2:] = unit(y - 100 * heights[2:, None] * z)
    with np.errstate(divide="raise", over="raise"):
        found = trace(plan, start, directions, light=light)

    assert (found.reason != Reason.ARRIVED).all()
    assert (found.plate_path[:2] == PlatePath.NONE).all()
    for values in (found.positions, found.directions, found.throughput):
        assert np.isfinite(values).all()


def test_a_viewer_in_the_plates_plane_is_told_so_in_one_sentence():
    """A solve whose sight runs along the plate has no landing, and names the remedy."""
    rig = with_array(MirrorArray(), projection="orthographic", field=1e-9)
    x, y, _ = np.eye(3)
    rig = replace(rig, plates=(replace(rig.plates[0], mesh=rectangle(0.15 * y, x, y, 0.1, 0.1)),))
    with pytest.raises(RigError, match=r"^The display stays dark: .*\.$"):
        run_steps(Session().solve(rig))


def two_plates(second_centre, second_normal):
    """Two plates with mirrors, the second where light of the
    first comes by, in a room that is the display.
    """
    x, y, z = np.eye(3)
    bench = with_array(None)
    up = unit(np.cross(second_normal, x))
    plates = (
        Plate(
            "first", rectangle(0.15 * y, x, unit(y + z), 0.4, 0.4), MirrorArray(phase=(0.1, 0.2))
        ),
        Plate(
            "second",
            rectangle(second_centre, x, up, 1.0, 1.0),
            MirrorArray(pitch=0.3e-3, height=0.6e-3),
        ),
    )
    room = box([3.0] * 3)
    inward = replace(
        room, triangles=room.triangles[:, ::-1], uv=np.tile([[0.0, 0], [1, 0], [0, 1]], (12, 1, 1))
    )
    shard = replace(bench.glasses[0], mesh=box([0.01] * 3, (0.0, -1.2, 0.0)))
    shown = replace(
        bench, glasses=(shard,), plates=plates, displays=(replace(bench.display, mesh=inward),)
    )

    return compile_plan(shown, Settings(only_through_glass=False, brightness=True))


def onto(frame, positions, directions):
    """Where light (n, 3) meets the plane of a plate, which lies ahead of it."""
    t = ((frame.centre - positions) @ frame.axes[2]) / (directions @ frame.axes[2])
    assert (t > 0).all()
    return positions + t[:, None] * directions


def slanted(n=4000):
    """Light (n, 3) from before the first plate onto its middle, within 20 degrees of +y."""
    rng = np.random.default_rng(11)
    directions = unit(
        np.stack([rng.uniform(-0.25, 0.25, n), np.ones(n), rng.uniform(-0.25, 0.25, n)], axis=1)
    )
    return rng.uniform(-0.02, 0.02, (n, 3)), directions


def test_of_two_plates_the_first_that_did_not_image_decides():
    """One behind the other: the path of the first, of the
    second where the first imaged, throughputs multiplied.
    """
    plan = two_plates(np.array([0, 0.17, 0.0]), np.array([0, -1.0, 1.0]) / np.sqrt(2))
    first, second = plan.arrays
    light = slanted()
    one = first.folded(onto(first, *light), light[1])
    two = second.folded(onto(second, one.positions, one.directions), one.directions)
    found = trace(plan, *light, light="folded")

    assert found.has_arrived.all()
    assert np.array_equal(found.plate_path, np.where(one.path == IMAGED, two.path, one.path))
    assert found.throughput == pytest.approx(one.throughput * two.throughput, rel=1e-9)
    pairs = {(int(a), int(b)) for a, b in zip(one.path, two.path, strict=True)}

    assert {
        (IMAGED, STRAY_1),
        (STRAY_1, IMAGED),
        (STRAY_1, STRAY_2),
        (STRAY_2, STRAY_1),
        (THROUGH, IMAGED),
    } <= pairs


def test_light_is_reflected_by_the_first_plate_only():
    """Light that the first's face sends onto the second goes
    through that as light does that is not reflected.
    """
    plan = two_plates(np.array([0, 0.15, 0.3]), unit(np.array([0.0, 1, 1])))
    first, second = plan.arrays
    light = slanted()
    one = first.reflected(onto(first, *light), light[1])
    two = second.folded(onto(second, one.positions, one.directions), one.directions)
    found = trace(plan, *light, light="reflected")
    assert (found.plate_path == PlatePath.REFLECTED).all()
    assert found.throughput == pytest.approx(one.throughput * two.throughput, rel=1e-9)
    assert np.abs(found.directions - two.directions).max() < 1e-12


def test_plates_in_one_plane_are_one_sheet_however_far_apart():
    """But for the float32 of Blender's places, which is
    coarser the further a plate is from the origin.
    """
    normal = np.array([0.6, 0.8, 0])
    along = np.array([0.8, -0.6, 0])
    near = make_surface(rectangle(np.zeros(3), along, [0, 0, 1], 0.1, 0.1))
    place = rectangle(100 * along, along, [0, 0, 1], 0.1, 0.1)
    rounded = replace(place, vertices=place.vertices.astype(np.float32).astype(float))
    assert np.abs(rounded.vertices @ normal).max() > 1e-7
    beside = replace(place, vertices=place.vertices + 1e-3 * normal)
    far = make_surface(rounded)
    off = make_surface(beside)
    kind = np.full(3, Kind.PLATE)
    assert find_thin_surfaces([near, far, off], kind).tolist() == [0, 0, 2]
    assert find_thin_surfaces([near, far, off], np.full(3, Kind.MIRROR)).tolist() == [0, 1, 2]
