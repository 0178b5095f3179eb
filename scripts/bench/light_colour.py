"""Colour: dispersion, primaries of displays, absorbing glass: a table of `dev.py light`.

`closed forms`: landings of each primary through a slab and a ball, against Snell's law with the
index of its wavelength. `catalogue`: indices and Abbe numbers against published ones. `fringes`:
a lattice of 7 x 7 dots, 1165 px across, rendered by Cycles with one index a render: distance of the
red dots from the blue ones, with one map for all colours and with a map for each. `tint`: the light
that Cycles renders through an absorbing ball, over that of a clear one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from time import perf_counter

import bpy
import numpy as np

from known.closed_forms import abbe_number, landing, through_ball, through_slab
from known.reference_rigs import ball_rig, box
from known.reference_rigs import rig as rig_of
from known.registered import registered
from paper.lattice import framed, measuring_width

registered()

from kiriko.core.base.steps import run_steps  # noqa: E402 - the operators have to be there first
from kiriko.core.blender.preview.cycles_preview import render_preview  # noqa: E402
from kiriko.core.blender.read.scene import Reading  # noqa: E402
from kiriko.core.image.seen_image import dot_centroids, ideal_image  # noqa: E402
from kiriko.core.light.compile_plan import compile_plan  # noqa: E402
from kiriko.core.light.rays import main_landings  # noqa: E402
from kiriko.core.light.trace import trace_all  # noqa: E402
from kiriko.core.rig.catalogue import GLASSES  # noqa: E402
from kiriko.core.rig.dispersion import SRGB_PRIMARIES, ConstantIndex  # noqa: E402
from kiriko.core.rig.rig import Rig  # noqa: E402
from kiriko.core.rig.settings import Settings  # noqa: E402
from kiriko.core.solve.session import Session  # noqa: E402
from kiriko.core.solve.solution import Solution  # noqa: E402
from kiriko.operators import work  # noqa: E402

from .runner import MISSED, Row  # noqa: E402

CLOSED = 1e-9  # m
MOST_FRINGE = 0.05  # px of 1165
MOST_TINT = 0.01  # of a colour's light
SAMPLES = 8  # of a viewer pixel in Cycles
# index at 587.6 nm and Abbe number, as published with the coefficients
PUBLISHED = {
    "N-BK7, K9": (1.5168, 64.17),
    "N-SF11": (1.78472, 25.68),
    "Fused Silica": (1.45846, 67.82),
    "Casting Resin (CR-39)": (1.498, 59.3),
}


def _row(what: str, found: str, is_kept: bool) -> Row:
    return {"what": what, "found": found, "kept": "kept" if is_kept else MISSED}


def closed_forms() -> Iterator[Row]:
    """Landings of each primary against closed forms, in m on the display."""
    index = GLASSES["Acrylic"].dispersion
    for shape in ("slab", "ball"):
        bare = rig_of(box([0.06, 0.02, 0.06])) if shape == "slab" else ball_rig(6)
        a_rig = replace(bare, glasses=(replace(bare.glasses[0], ior=index),))
        xy = np.random.default_rng(1).uniform(160, 352, (4000, 2))
        o, d = a_rig.viewer.rays(xy)
        for wavelength in SRGB_PRIMARIES:
            n = index.at(wavelength)
            front = np.array([0, -1.0, 0])
            out = (
                through_slab(o, d, front, 0.01 * front, 0.02, n)
                if shape == "slab"
                else through_ball(o, d, 0.025, n)
            )
            found = main_landings(
                trace_all(compile_plan(a_rig, Settings(wavelength=wavelength)), o, d), len(xy)
            )
            off = np.abs(found.xy - landing(a_rig, *out))[found.has_arrived] * 0.05 / 512
            what = f"{shape}, {1e9 * wavelength:.0f} nm, index {n:.5f}"
            yield _row(what, f"off by {off.max():.1e} m at most", off.max() < CLOSED)


def catalogue() -> Iterator[Row]:
    """Index and Abbe number of catalogued glass against published ones."""
    for name, (nd, abbe) in PUBLISHED.items():
        found = GLASSES[name].dispersion
        n, v = found.at(587.5618e-9), abbe_number(found)
        is_kept = abs(n - nd) < 1e-5 and abs(v - abbe) < 0.02
        yield _row(name, f"nd {n:.5f} ({nd}), V {v:.2f} ({abbe})", is_kept)


def built(dispersion: str, degrees: float | None = None, picture: float = 0.03) -> Reading:
    """A rig with a ball, or a cube turned by so many degrees, of a catalogued dispersion.

    picture : m, side; light through a strong ball misses the plate from the corners of a large one
    """
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    options = {"field": 0.05, "picture_size": picture, "display_size": 0.05}
    if degrees is not None:
        turn = 0.0, 0.0, np.radians(degrees)
        bpy.ops.mesh.primitive_cube_add(size=1, scale=(0.05,) * 3, rotation=turn)
    bpy.ops.kiriko.add_rig(display_resolution=(1024, 1024), **options)
    for thing in bpy.context.scene.objects:
        if thing.kiriko.role == "GLASS":
            thing.kiriko.use_ior, thing.kiriko.ior = True, GLASSES[dispersion].ior
            thing.kiriko.dispersion = dispersion
    return work.read(bpy.context)


def solved(rig: Rig, **settings: object) -> tuple[Solution, float]:
    """A solution in a new session, and its seconds."""
    started = perf_counter()
    found = run_steps(Session().solve(rig, Settings(**settings)))
    return found, perf_counter() - started


def dots_of(reading: Reading, source: np.ndarray, colour: int, wanted: tuple) -> np.ndarray:
    """Centroids (49, 2), px of the frame, of the dots in one colour of a Cycles render with the
    index of this colour.

    wanted : size of the frame, its part to render, and the ideal places of the dots in it
    """
    glasses = tuple(
        replace(one, ior=ConstantIndex(one.ior.at(SRGB_PRIMARIES[colour])))
        for one in reading.rig.glasses
    )
    (width, height), crop, places = wanted
    left, right = ((x + 0.01) / width for x in (crop[0], crop[2]))
    low, high = (1 - (y - 0.01) / height for y in (crop[3], crop[1]))
    render = render_preview(
        bpy.context.scene,
        replace(reading, rig=replace(reading.rig, glasses=glasses)),
        source,
        size=(width, height),
        border=(left, right, low, high),
        samples=SAMPLES,
        fresnel=False,
    )[..., colour]
    y, x = np.nonzero(render > 0.02 * render.max())
    points = np.stack([x, y], axis=1) + 0.5
    nearest = np.linalg.norm(points[:, None] - places[None], axis=2).argmin(axis=1)
    weight = render[y, x]
    total = np.bincount(nearest, weight, len(places))
    sums = [np.bincount(nearest, weight * points[:, k], len(places)) for k in (0, 1)]
    return np.stack(sums, axis=1) / total[:, None]


def fringes(dispersion: str, picture: float = 0.03) -> Iterator[Row]:
    """Distance of red dots from blue ones in Cycles, before and after."""
    reading = built(dispersion, picture=picture)
    each, seconds = solved(reading.rig)
    one, of_one = solved(reading.rig.in_one_colour(SRGB_PRIMARIES[1]), wavelength=SRGB_PRIMARIES[1])
    viewer, ideal = reading.rig.viewer, each.ideal()
    width = measuring_width(reading, ideal)
    height = round(width * viewer.height / viewer.width)
    y, x = np.nonzero(ideal[..., 0] > 1e-3)
    scale, margin = width / viewer.width, 24
    crop = (
        max(0, int(x.min() * scale) - margin),
        max(0, int(y.min() * scale) - margin),
        min(width, int((x.max() + 1) * scale) + margin),
        min(height, int((y.max() + 1) * scale) + margin),
    )
    places = dot_centroids(ideal_image(reading.rig.picture, framed(viewer, width, crop)))
    wanted = (width, height), crop, places.reshape(-1, 2)
    found = []
    for solution in (one, each):
        red, blue = (dots_of(reading, solution.source, colour, wanted) for colour in (0, 2))
        found.append(np.linalg.norm(red - blue, axis=1))
    before, after = found
    words = (
        f"mean {before.mean():.3f} px, largest {before.max():.3f} before;"
        f" mean {after.mean():.4f}, largest {after.max():.4f} after"
    )
    yield _row(f"ball of {dispersion}, fringes", words, after.max() < MOST_FRINGE)
    own = each.colour
    words = f"{own.before.largest_px * scale:.3f} before, {own.after.largest_px * scale:.1e} after"
    yield _row("by Kiriko's report", words, True)
    words = f"{each.n_rays} rays, {seconds:.2f} s; one map {one.n_rays} rays, {of_one:.2f} s"
    yield _row("cost", words, True)


def tint() -> Iterator[Row]:
    """Light through an absorbing ball and slab in Cycles, over that through a clear one."""
    for degrees in (None, 0.0):
        reading = built("Acrylic", degrees)
        flat = np.full((1024, 1024, 3), 0.5, np.float32)
        shares = []
        for absorption in ((0.0, 0.0, 0.0), (5.0, 20.0, 60.0)):
            rig = reading.rig
            glasses = tuple(
                replace(one, absorption=absorption, ior=ConstantIndex(1.49)) for one in rig.glasses
            )
            tinted = replace(reading, rig=replace(rig, glasses=glasses))
            solution, _ = solved(tinted.rig, brightness=True)
            size = {"size": (64, 64), "samples": 256}
            render = render_preview(bpy.context.scene, tinted, flat, **size)[24:40, 24:40, :3]
            seen = solution.seen(flat)
            h, w = (3 * n // 8 for n in seen.shape[:2])
            middle = seen[h : seen.shape[0] - h, w : seen.shape[1] - w]
            shares.append((render.mean(axis=(0, 1)), middle.mean(axis=(0, 1))))
        cycles, ours = (shares[1][k] / shares[0][k] for k in (0, 1))
        off = np.abs(cycles - ours)
        words = ", ".join(f"{a:.4f} ({b:.4f})" for a, b in zip(ours, cycles, strict=True))
        shape = "ball" if degrees is None else "cube"
        yield _row(f"tinted {shape}, light left (Cycles)", words, off.max() < MOST_TINT)


CASES: dict[str, Callable[[], Iterator[Row]]] = {
    "colour: closed forms": closed_forms,
    "colour: catalogue": catalogue,
    "colour: ball": lambda: fringes("Acrylic"),
    "colour: strong ball": lambda: fringes("Polycarbonate", picture=0.024),
    "colour: tint": tint,
}
