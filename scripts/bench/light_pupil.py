"""Sharpness through a pupil, and sharpened source images: a table of `dev.py light`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from time import perf_counter

import bpy
import numpy as np

from known import closed_forms
from known.reference_rigs import ball_rig, box, lattice_image, rectangle, zone_plate
from known.registered import registered

registered()

from kiriko.core.base.steps import run_steps  # noqa: E402 - the operators have to be there first
from kiriko.core.blender.data.camera_viewer import viewer_of  # noqa: E402
from kiriko.core.blender.preview.cycles_preview import render_preview  # noqa: E402
from kiriko.core.image.flat_picture import view_of_picture  # noqa: E402
from kiriko.core.lab.measure.places_seen import grid_on  # noqa: E402
from kiriko.core.lab.measure.sharpness import sharpness_of  # noqa: E402
from kiriko.core.light.compile_plan import compile_plan  # noqa: E402
from kiriko.core.rig.rig import ConstantIndex, Glass, Rig  # noqa: E402
from kiriko.core.rig.settings import Settings  # noqa: E402
from kiriko.core.solve import through_pupil  # noqa: E402
from kiriko.core.solve.session import Session  # noqa: E402
from kiriko.operators import work  # noqa: E402

from .runner import Row, proof  # noqa: E402

EYE = 0.004  # m, a pupil in a room
LEAST_GAIN = 2.0  # dB
MOST_OFF = 0.004  # rms of white, the noise of a render
X, Y, Z = (np.array(axis) for axis in ((1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0)))


def with_pupil(a_rig: Rig, pupil: float, **change: object) -> Rig:
    """The rig with a pupil of its viewer."""
    return replace(a_rig, viewers=(replace(a_rig.viewer, pupil=pupil, **change),))


def slab() -> Iterator[Row]:
    """Best focus and astigmatism behind 60 mm of glass, against Coddington's equations."""
    base = with_pupil(ball_rig(2), EYE, position=0 * Y, window=(-0.5, 0.5, -0.5, 0.5))
    a_rig = replace(
        base,
        glasses=(Glass("slab", box([2.0, 0.06, 2.0], 0.33 * Y), ConstantIndex(1.5)),),
        plates=(),
        displays=(replace(base.display, mesh=rectangle(0.56 * Y, X, Z, 1.0, 1.0)),),
        pictures=(replace(base.picture, mesh=rectangle(0.4 * Y, X, Z, 0.2, 0.2)),),
    )
    (found,) = run_steps(sharpness_of(compile_plan(a_rig, Settings())))
    off = 0.0
    for v, d in zip(found.vergence.reshape(-1, 2, 2), sights(a_rig), strict=True):
        cos_i = d @ Y
        cos_r = np.sqrt(1 - (1 - cos_i**2) / 1.5**2)
        air, glass = 0.5 / cos_i, 0.06 / 1.5 / cos_r
        exact = sorted([1 / (air + glass), 1 / (air + glass * (cos_i / cos_r) ** 2)])
        off = max(off, np.abs(np.sort(np.linalg.eigvals(v).real) / exact - 1).max())
    yield proof("vergence behind a slab, relative", f"{off:.1e}", off < 1e-6)


def ball() -> Iterator[Row]:
    """Vergence through a ball, against differences of exact rays."""
    a_rig = with_pupil(ball_rig(5, picture=0.02), EYE)
    (found,) = run_steps(sharpness_of(compile_plan(a_rig, Settings())))
    d, h = sights(a_rig), 1e-5
    right = closed_forms.unit(X - (d @ X)[:, None] * d)
    o = np.tile(a_rig.viewer.position, (len(d), 1))

    def slope(along: np.ndarray, by_place: bool) -> np.ndarray:
        ends = [
            closed_forms.landing(
                a_rig,
                *closed_forms.through_ball(
                    o + s * by_place * along,
                    closed_forms.unit(d + s * (not by_place) * along),
                    0.025,
                    1.49,
                ),
            )
            for s in (h, -h)
        ]
        return (ends[0] - ends[1]) / (2 * h)

    by_angle, by_place = (
        np.stack([slope(e, way) for e in (right, np.cross(right, d))], axis=2)
        for way in (False, True)
    )
    exact = np.linalg.solve(by_angle, by_place).reshape(found.vergence.shape)
    off = np.abs(found.vergence - exact).max()
    yield proof("vergence through a ball, dioptres", f"{off:.1e}", off < 1e-2)


def sights(a_rig: Rig) -> np.ndarray:
    """Directions (49, 3) in which the viewer sees points of the picture."""
    uv = grid_on(a_rig.picture_place, 7)
    return a_rig.viewer.rays(view_of_picture(a_rig.picture_place, a_rig.viewer, uv))[1]


def in_blender(pupil: float) -> tuple[Rig, Callable[[np.ndarray], np.ndarray]]:
    """A cube of glass that shows grey rings, and its render in Cycles with depth of field."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.mesh.primitive_cube_add(size=0.05)
    bpy.context.object.kiriko.use_ior = True
    bpy.ops.kiriko.add_rig(
        viewer_resolution=96, display_resolution=(96, 96), field=0.04, picture_size=0.03
    )
    image = bpy.data.images["Kiriko Lattice"]
    rings = 0.25 + 0.5 * zone_plate(image.size[0], 16)
    rings[..., 3] = 1
    image.pixels.foreach_set(rings.ravel())
    image.update()
    scene = bpy.context.scene
    viewer_of(scene).kiriko.pupil = 1e3 * pupil
    bpy.context.view_layer.update()
    reading = work.read(bpy.context)

    def render(source: np.ndarray) -> np.ndarray:
        return render_preview(scene, reading, source, samples=256, fresnel=False)[..., :3]

    return reading.rig, render


def cycles(pupil: float) -> Callable[[], Iterator[Row]]:
    """The seen image and the gain of Sharpen in Cycles."""

    def rows() -> Iterator[Row]:
        a_rig, render = in_blender(pupil)
        session, off = Session(), {}
        for sharpen in (False, True):
            solution = run_steps(session.solve(a_rig, Settings(sharpen=sharpen)))
            image = render(solution.source)
            seen = run_steps(solution.seeing_with_pupil(solution.source))
            apart, pinhole = (rms(image - one) for one in (seen, solution.seen()))
            if not sharpen:
                found = f"{apart:.4f}, pinhole {pinhole:.4f}"
                yield proof(
                    f"{1e3 * pupil:g} mm: off from Cycles, of white", found, apart < MOST_OFF
                )
            off[sharpen] = rms((image - solution.ideal())[18:78, 18:78])
        gain = 20 * np.log10(off[False] / off[True])
        yield proof(f"{1e3 * pupil:g} mm: gain in Cycles, dB", f"{gain:.1f}", gain >= LEAST_GAIN)

    return rows


def rms(off: np.ndarray) -> float:
    """Root of the mean square."""
    return float(np.sqrt((off**2).mean()))


def gain(pixels: int, pupil: float, image: np.ndarray) -> Callable[[], Iterator[Row]]:
    """PSNR, SSIM, ringing and seconds of Sharpen for the reference ball."""

    def rows() -> Iterator[Row]:
        base = ball_rig(5, pixels=pixels, display_pixels=pixels, field=0.044, image=image)
        session, a_rig = Session(), with_pupil(base, pupil)
        run_steps(session.solve(a_rig, Settings()))
        start = perf_counter()
        found = run_steps(session.solve(a_rig, Settings(sharpen=True)))
        seconds = perf_counter() - start
        sharp = found.sharpened
        before, after = sharp.before[0], sharp.after[0]
        text = (
            f"{before.psnr:.1f} to {after.psnr:.1f} dB, SSIM {before.ssim:.4f} to {after.ssim:.4f},"
            f" ringing {after.ringing:.1e}, {len(found.views[0].batches)} places,"
            f" {sharp.n_steps} steps, {seconds:.1f} s"
        )
        is_kept = after.psnr - before.psnr >= LEAST_GAIN
        yield proof(f"ball, {pixels} px, {1e3 * pupil:g} mm", text, is_kept)

    return rows


def places() -> Iterator[Row]:
    """Error of the seen image by the number of places in a wide pupil, and what Sharpen gains with
    them, both as seen from 256.
    """
    a_rig = with_pupil(
        ball_rig(5, pixels=128, display_pixels=128, field=0.044, image=zone_plate(512, 16)), 0.02
    )
    judge = run_steps(seen_from(256, Session()).solve(a_rig))
    exact = run_steps(judge.seeing_with_pupil(judge.source))
    for n in (4, 8, 16, 32, 64):
        session = seen_from(n, Session())
        solution = run_steps(session.solve(a_rig))
        off = rms(run_steps(solution.seeing_with_pupil(solution.source)) - exact)
        start = perf_counter()
        sharp = run_steps(session.solve(a_rig, Settings(sharpen=True)))
        seconds = perf_counter() - start
        best = run_steps(judge.seeing_with_pupil(sharp.source))
        inside = np.s_[32:96, 32:96]
        before, after = (
            -20 * np.log10(rms((image - judge.ideal())[inside])) for image in (exact, best)
        )
        text = f"{off:.1e} of white; {before:.1f} to {after:.1f} dB, {seconds:.1f} s"
        yield proof(f"20 mm, {n} places", text, n < 16 or off < 1e-3)


def seen_from(n: int, session: Session) -> Session:
    """The session, once all further solves take so many places of a pupil."""
    through_pupil.LEAST_PLACES = through_pupil.MOST_PLACES = n
    return session


CASES: dict[str, Callable[[], Iterator[Row]]] = {
    "pupil: slab": slab,
    "pupil: ball": ball,
    "pupil: 4 mm in Cycles": cycles(EYE),
    "pupil: 30 mm in Cycles": cycles(0.03),
    "sharpen: 256 px": gain(256, EYE, zone_plate(1024, 20)),
    "sharpen: 512 px": gain(512, EYE, zone_plate(1024, 40)),
    "sharpen: pinhole": gain(256, 0.0, zone_plate(1024, 20)),
    "sharpen: 30 mm": gain(256, 0.03, zone_plate(1024, 20)),
    "sharpen: dots": gain(256, EYE, lattice_image()),
    "pupil: places": places,
}
