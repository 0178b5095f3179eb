"""Polarised light against closed forms, and against the electric field followed forward."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.errors import RigError
from kiriko.core.base.steps import run_steps
from kiriko.core.bench.systems import SYSTEMS
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.rays import Rays, Reason, main_landings
from kiriko.core.light.trace import trace_all, tracing
from kiriko.core.rig.rig import (
    ConstantIndex,
    Glass,
    Kind,
    Mesh,
    Mirror,
    MirrorArray,
    Plate,
    Polariser,
    Retroreflector,
    WavePlate,
)
from kiriko.core.rig.settings import Settings
from known.reference_rigs import ball_rig, box, rectangle

X, Y, Z = np.eye(3)
SETTINGS = Settings(only_through_glass=False, only_through_plate=False)
BASE = ball_rig(2, pixels=64)
UP = np.pi / 2  # from X


def rig(sees=Y, shown=0.5 * Y, polarised=None, size=1.0, **parts):
    """A viewer 1 m from the origin, whose middle ray goes along `sees`, and a display whose front
    faces the origin; its u axis is X.
    """
    eye = replace(BASE.viewer, position=-sees, axes=np.array([X, np.cross(X, sees), sees]))
    facing = -shown / np.linalg.norm(shown)
    mesh = rectangle(shown, X, np.cross(facing, X), size, size)
    display = replace(BASE.display, mesh=mesh, polarised=polarised)
    return replace(
        BASE, viewers=(eye,), displays=(display,), **{"glasses": (), "plates": ()} | parts
    )


def throughput(a_rig):
    """Of the middle ray's brightest landing; 0 without one."""
    found = trace_all(compile_plan(a_rig, SETTINGS), *a_rig.viewer.rays(np.full((1, 2), 32.0)))
    return found.throughput[found.has_arrived].max(initial=0.0)


def film(y, angle=0.0, kind=Polariser, **options):
    """A polariser or wave plate whose front, as the display's, faces the viewer."""
    return kind(f"film at {y}", rectangle(y * Y, X, Z, 0.3, 0.3), angle=angle, **options)


def test_malus():
    """cos^2 of the angle between the axes of two polarisers, or of one and a polarised display;
    unpolarised light keeps a half; the extinction passes of the other polarisation.
    """
    for angle in np.radians([0, 20, 45, 70, 130]):
        malus = np.cos(angle - 0.3) ** 2
        two = rig(polarisers=(film(0.1, angle), film(0.2, 0.3)))
        assert abs(throughput(two) - malus / 2) < 1e-9
        assert abs(throughput(rig(polarised=0.3, polarisers=(film(0, angle),))) - malus) < 1e-9
        leaky = rig(polarised=0.3, polarisers=(film(0, angle, extinction=0.1),))
        assert abs(throughput(leaky) - malus - 0.1 * (1 - malus)) < 1e-9
    assert abs(throughput(rig(polarisers=(film(0),))) - 0.5) < 1e-9


def test_crossed_polarisers_block_light():
    """Nothing passes two crossed ones; a third between them, at 45 degrees, lets an eighth."""
    crossed = rig(polarisers=(film(0), film(0.2, UP)))
    found = trace_all(compile_plan(crossed, SETTINGS), *crossed.viewer.rays(np.full((1, 2), 32.0)))
    assert found.reason == Reason.BLOCKED
    assert np.isnan(found.xy).all()
    between = replace(crossed, polarisers=(*crossed.polarisers, film(0.1, UP / 2)))
    assert abs(throughput(between) - 1 / 8) < 1e-9
    assert throughput(rig(polarised=UP, polarisers=(film(0),))) == 0


@pytest.mark.parametrize("back", [Mirror, Retroreflector])
def test_a_quarter_wave_plate_before_a_mirror_turns_linear_light(back):
    """Light through a polariser, to a mirror and back has passed a plate of twice the retardance:
    1 - sin^2(2 a) sin^2(2 pi r) passes the polariser again, nothing for a = 45 degrees, r = 1/4.
    """
    field = {Mirror: "mirrors", Retroreflector: "retroreflectors"}[back]
    for angle in np.radians([0, 15, 45, 80]):
        for waves in (0.0, 0.1, 0.25, 0.5):
            parts = {
                "polarisers": (film(0.1),),
                "wave_plates": (film(0.2, angle, WavePlate, retardance=waves),),
                field: (back("back", rectangle(0.3 * Y, X, Z, 0.3, 0.3)),),
            }
            left = 1 - np.sin(2 * angle) ** 2 * np.sin(2 * np.pi * waves) ** 2
            assert abs(throughput(rig(shown=-1.5 * Y, **parts)) - left / 2) < 1e-9


def on_block(incidence, polarised, n=1.5, **parts):
    """A display seen by reflection in the top of a block of glass at z = 0."""
    block = Glass("block", box([1, 1, 0.2], (0, 0, -0.1)), ConstantIndex(n), reflects=True)
    sees = np.sin(incidence) * Y - np.cos(incidence) * Z
    return rig(sees, 0.6 * sees * [1, 1, -1], polarised, 0.1, glasses=(block,), **parts)


def test_brewster():
    """Glass reflects no p-polarised light at tan a = n; s and p follow Fresnel at other angles."""
    n = 1.5
    assert throughput(on_block(np.arctan(n), UP)) == 0
    assert abs(throughput(on_block(np.arctan(n), 0.0)) - ((n**2 - 1) / (n**2 + 1)) ** 2) < 1e-9
    for a in np.radians([35, 45, 60, 75]):
        b = np.arcsin(np.sin(a) / n)
        s, p = np.sin(a - b) / np.sin(a + b), np.tan(a - b) / np.tan(a + b)
        for turn in (0.0, 0.4, -0.4, UP):
            mixed = s**2 * np.cos(turn) ** 2 + p**2 * np.sin(turn) ** 2
            assert abs(throughput(on_block(a, turn)) - mixed) < 1e-9


def rhomb(angle, n, height=0.1):
    """Glass that light along y enters and leaves squarely, after two total reflections."""
    length = height * np.tan(angle) * (1 - np.cos(2 * angle))
    rise = length / np.tan(angle)
    outline = [(0, 0), (0, height), (length, rise), (length, rise + height)]
    vertices = np.array([(x, y, z - height / 2) for x in (-0.1, 0.1) for y, z in outline])
    faces = box([1, 1, 1]).triangles
    return Glass("rhomb", Mesh(vertices, faces), ConstantIndex(n))


def test_a_fresnel_rhomb_turns_linear_light_into_circular():
    """Each total reflection delays p against s by 2 atan(cos a sqrt(sin^2 a - n^-2) / sin^2 a);
    two of 45 degrees make a quarter wave, which an analyser of any angle and a quarter-wave plate
    before it show with the right sign.
    """
    n, turn = 1.51, np.radians(45)
    for angle in np.radians([45, 48.6, 54.6, 65]):
        each = np.arctan(np.cos(angle) * np.sqrt(np.sin(angle) ** 2 - n**-2) / np.sin(angle) ** 2)
        glass = rhomb(angle, n)
        end = ((n - 1) / (n + 1)) ** 2
        for analyser in (0.2, 0.8, -0.5):
            for waves in (0.0, 0.25):
                a_rig = rig(
                    shown=0.8 * Y,
                    polarised=turn,
                    glasses=(glass,),
                    polarisers=(film(-0.2, analyser),),
                    wave_plates=(film(-0.1, 0.0, WavePlate, retardance=waves),),
                )
                phase = -4 * each + 2 * np.pi * waves
                expected = (1 + np.sin(2 * analyser) * np.cos(phase)) / 2 * (1 - end) ** 2
                assert abs(throughput(a_rig) - expected) < 1e-9, (angle, analyser, waves)


def test_unpolarised_light_keeps_its_fresnel_transmittance():
    """A wave plate of no retardance changes no share of light at one face; a slab at an angle
    passes (Ts^2 + Tp^2) / 2, more than the square of the mean.
    """
    nothing = (film(-0.5, 0.3, WavePlate, retardance=0.0),)
    for a in np.radians([0, 20, 50, 70]):
        plain, polarised = on_block(a, None), on_block(a, None, wave_plates=nothing)
        assert abs(throughput(plain) - throughput(polarised)) < 1e-12

        b = np.arcsin(np.sin(a) / 1.5)
        s, p = (np.sin(a - b) / np.sin(a + b), np.tan(a - b) / np.tan(a + b)) if a else (0.2, 0.2)
        slab = Glass("slab", box([3, 3, 0.02]), ConstantIndex(1.5))
        sees = np.sin(a) * Y - np.cos(a) * Z
        through = rig(sees, 0.6 * sees, glasses=(slab,), wave_plates=nothing)
        assert abs(throughput(through) - ((1 - s**2) ** 2 + (1 - p**2) ** 2) / 2) < 1e-9


def forward(plan, o, d):
    """Throughput of one ray by the electric field, a vector in space, from the display on."""
    steps = []
    end = main_landings(run_steps(tracing(plan, o[None], d[None], steps=steps)), 1)
    met = [step for step in steps if len(step.rays)]
    triangles = [int(step.triangle[0]) for step in met]
    places = [o, *(step.place[0] for step in met)]
    if end.n_events[0] > len(met):  # the display beyond a plate
        places, triangles = [*places, end.positions[0]], [*triangles, -1]
    light = -np.diff(np.array(places), axis=0)[::-1]
    light /= np.linalg.norm(light, axis=1, keepdims=True)
    normals = plan.triangles.normals[triangles][::-1]
    parts = plan.triangles.part[triangles][::-1]

    turn = plan.rig.display.polarised + UP
    absorbing = np.cos(turn) * X + np.sin(turn) * np.cross(normals[0], X)
    field = np.cross(light[0], absorbing).astype(complex)
    field /= np.linalg.norm(field)
    is_inside = False
    for k, before, after in zip(range(1, len(parts)), light, light[1:], strict=False):
        kind, element = plan.parts.kind[parts[k]], plan.parts.elements[parts[k]]
        normal = -np.sign(normals[k] @ before) * normals[k]
        if kind in {Kind.POLARISER, Kind.WAVE_PLATE}:
            first = np.cross(before, element.axis)
            first /= np.linalg.norm(first)
            second = np.cross(before, first)
            field = (
                element.over * (field @ first) * first + element.along * (field @ second) * second
            )
        elif kind == Kind.PLATE:  # two mirrors at right angles
            for mirror in np.cross(normal, [X, np.cross(normal, X)]):
                mirror = mirror / np.linalg.norm(mirror)
                field = -(field - 2 * (field @ mirror) * mirror)
        elif kind == Kind.MIRROR:
            field = -(field - 2 * (field @ normal) * normal)
        else:
            n = element.ior.at(0)
            n1, n2 = (n, 1) if is_inside else (1, n)
            s = np.cross(before, normal)
            s /= np.linalg.norm(s)
            c1 = -before @ normal
            c2 = np.sqrt(1 - (n1 / n2) ** 2 * (1 - c1**2) + 0j)
            over, along = field @ s, field @ np.cross(before, s)
            if after @ normal > 0:
                over *= (n1 * c1 - n2 * c2) / (n1 * c1 + n2 * c2)
                along *= (n2 * c1 - n1 * c2) / (n2 * c1 + n1 * c2)
            else:
                over *= 2 * n1 * c1 / (n1 * c1 + n2 * c2)
                along *= 2 * n1 * c1 / (n2 * c1 + n1 * c2)
                over, along = (x * np.sqrt(n2 * c2 / (n1 * c1)) for x in (over, along))
                is_inside = not is_inside
            field = over * s + along * np.cross(after, s)
    return float(np.sum(np.abs(field) ** 2)), end


def test_rows_backward_are_fields_forward():
    """Skew rays by tilted films, a rhomb, a mirror and a plate have the throughput of the electric
    field that the display sends along them.
    """
    tilted = {"right": (X + 0.1 * Y) / 1.01**0.5, "up": (Z - 0.3 * Y) / 1.09**0.5}
    sheet = rectangle(-0.3 * Y, **tilted, width=0.3, height=0.3)
    parts = {
        "polarisers": (Polariser("sheet", sheet, 0.3, 0.05),),
        "wave_plates": (film(-0.2, 0.7, WavePlate, retardance=0.2),),
        "glasses": (rhomb(np.radians(52), 1.5),),
        "mirrors": (Mirror("mirror", rectangle(0.6 * Y + 0.15 * Z, X, Y + Z, 0.6, 0.6)),),
        "plates": (Plate("plate", rectangle(0.6 * Y + 0.7 * Z, X, Y + 0.2 * Z, 0.9, 0.9)),),
    }
    a_rig = rig(shown=0.5 * Y + 1.2 * Z, polarised=0.9, **parts)
    a_rig = replace(a_rig, viewers=(replace(a_rig.viewer, window=(-0.05, 0.05, -0.05, 0.05)),))
    plan = compile_plan(a_rig, SETTINGS)
    shares = []
    for o, d in zip(
        *a_rig.viewer.rays(np.random.default_rng(0).uniform(16, 48, (60, 2))), strict=True
    ):
        expected, end = forward(plan, o, d)
        if end.has_arrived[0]:
            assert end.n_events[0] == 9
            assert abs(end.throughput[0] - expected) < 1e-9
            shares.append(expected)
    assert len(shares) > 40
    assert np.ptp(shares) > 0.01


def test_mirrors_of_a_plate_polarise_as_the_ideal_plate():
    """Imaged light has two reflections at right angles, which turn it about the plate's normal."""
    sheet = Polariser("sheet", rectangle(-0.5 * Y, X, Z, 0.3, 0.3), 0.3)
    shown = replace(BASE.displays[0], polarised=0.5)
    o, d = BASE.viewer.rays(np.random.default_rng(1).uniform(16, 48, (300, 2)))
    settings = Settings(only_through_glass=False, brightness=True)
    shares = []
    for array in (None, MirrorArray(reflectance=1.0, has_fresnel=False)):
        plates = tuple(replace(one, array=array) for one in BASE.plates)
        plain = replace(BASE, glasses=(), plates=plates)
        films = replace(plain, polarisers=(sheet,), displays=(shown,))
        found = [trace_all(compile_plan(one, settings), o, d) for one in (plain, films)]
        assert all(one.has_arrived.all() for one in found)
        shares.append(found[1].throughput / found[0].throughput)
    assert shares[0].max() < 0.97
    np.testing.assert_allclose(shares[1], shares[0], atol=1e-12)


def brightness(kind, **changes):
    """Mean throughput of the light of a system's middle."""
    system = replace(SYSTEMS[kind].make(), **changes)
    at = system.viewer.width / 2 + np.random.default_rng(0).uniform(-40, 40, (200, 2))
    found = trace_all(compile_plan(system, SETTINGS), *system.viewer.rays(at))
    main = main_landings(found, 200)
    assert main.has_arrived.all()
    return main.throughput


def test_airr():
    """A half mirror shows R T = 0.25 at best; a reflective polariser and a quarter-wave film show
    all light of a polarised display, and half of another one's.
    """
    np.testing.assert_allclose(brightness("AIRR"), 0.25, rtol=1e-12)
    polarised = brightness("AIRR_POLARISED")
    assert polarised.max() <= 1 + 1e-9
    assert polarised.mean() > 0.99
    dull = replace(SYSTEMS["AIRR_POLARISED"].make().displays[0], polarised=None)
    assert brightness("AIRR_POLARISED", displays=(dull,)).mean() == pytest.approx(0.5, abs=0.005)


def test_koizumi_and_sano_remove_the_ground_image():
    """The display's light past the mirror under it forms a second image over the table, at its
    mirror image in the plate: all of its light without films, below 0.04 % with them. The wanted
    image keeps Fresnel's share of s-polarised light.
    """
    system = SYSTEMS["KOIZUMI_SANO"].make()
    bare = replace(system, polarisers=(), wave_plates=())
    eye = system.viewer.position
    off = np.random.default_rng(0).uniform(-0.025, 0.025, (300, 3)) * [1, 0, 1]

    def seen(a_rig, height):
        """Throughput of points about a height above the table; 0 for those that end."""
        aims = off + height * Z - eye
        aims /= np.linalg.norm(aims, axis=1, keepdims=True)
        found = trace_all(compile_plan(a_rig, SETTINGS), np.tile(eye, (300, 1)), aims)
        shares = np.zeros(300)
        np.maximum.at(shares, found.sample, found.has_arrived * found.throughput)
        return shares, aims

    wanted, aims = seen(system, 0.05)
    a = np.arccos(-aims[:, 2])
    b = np.arcsin(np.sin(a) / 1.5)
    np.testing.assert_allclose(wanted, (np.sin(a - b) / np.sin(a + b)) ** 2, rtol=0.02)
    assert seen(bare, 0.05)[0].mean() < 0.01 * wanted.mean()  # p-polarised, near Brewster's angle
    np.testing.assert_allclose(seen(bare, 0.23)[0], 1.0)
    assert seen(system, 0.23)[0].max() < 4e-4


def test_other_rigs_carry_no_polarisation():
    """Without a part that polarises, rays have no rows, and the plan lists polarisation as left
    out; a wave plate of no retardance changes no landing.
    """
    plan = compile_plan(BASE, Settings())
    assert "polarisation" in plan.left_out
    assert not plan.is_polarised
    o, d = BASE.viewer.rays(np.random.default_rng(0).uniform(0, 64, (500, 2)))
    assert Rays(o, d, None, False).row is None
    plate = WavePlate("film", rectangle(-0.5 * Y, X, Z, 1, 1), 0.0, 0.0)
    carried = compile_plan(replace(BASE, wave_plates=(plate,)), Settings())
    assert "polarisation" in carried.used
    assert any("compiled kernel (polarisation)" in str(name) for name in carried.left_out)
    found, expected = (trace_all(one, o, d) for one in (carried, plan))
    np.testing.assert_allclose(found.xy, expected.xy, atol=1e-6)
    assert np.array_equal(found.reason, expected.reason)


def test_impossible_films_are_one_sentence():
    """Seen edge-on, bent, or with numbers that are not finite."""
    edge = Polariser("sheet", rectangle(0 * X, Y, Z, 0.1, 0.1))
    with pytest.raises(RigError, match="The polariser 'sheet' is edge-on to the viewer 'viewer'"):
        rig(polarisers=(edge,)).check()
    flat = rectangle(0 * X, X, Z, 0.1, 0.1)
    bent = replace(flat, vertices=flat.vertices + np.diag([0.01, 0, 0, 0])[:, [3, 0, 3]])
    with pytest.raises(RigError, match="'sheet' is not a flat plane: replace it"):
        compile_plan(rig(polarisers=(Polariser("sheet", bent),)), SETTINGS)
    with pytest.raises(RigError, match="wave plate 'film' has a number that is not finite"):
        rig(wave_plates=(WavePlate("film", flat, 0.0, float("nan")),)).check()
    with pytest.raises(RigError, match="Extinction 2: set it from 0 to 1"):
        rig(polarisers=(Polariser("sheet", flat, 0.0, 2.0),)).check()
