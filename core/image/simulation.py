"""Stray light, dimming and blur of the viewer's image by a plate's mirrors, by sampling."""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Bools, Floats, Ints
from ..base.steps import subprogress
from ..base.vectors import dot
from ..light.beams import in_quilt
from ..light.plan import Plan
from ..light.plate import PlatePath
from ..light.rays import PlateLight, are_main, main_landings
from ..light.trace import TRACED_AT_ONCE, trace
from ..rig.mesh import Mesh
from ..rig.pupil import focus_of, in_pupil, rays_through

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear Rec.709
N_PLATE_RAYS = 4096  # rays for estimating brightness and blur
DERIVATIVE_STEP_PX = 0.05  # viewer px, for derivatives of the view map
# inverse powers of the plastic number: an even sequence in a square
EVEN_STEP = np.array([0.7548776662466927, 0.5698402909980532])
# spread by a slit, w / p, and the share of light below: all but 0.2 % of it
SLIT = np.linspace(-50.0, 50.0, 20001)
SPREAD = np.cumsum(np.sinc(SLIT) ** 2)
SPREAD /= SPREAD[-1]
# one in so many rays is followed via the plate's faces after two for each pixel found no light
SELDOM = 8


OTHER_PATH = len(PlatePath)  # light by other paths than the picture's, if parts split light


@dataclass(frozen=True, eq=False)
class Simulation:
    """The image seen through a plate's mirrors.

    Parameters
    ----------
    image : (h, w, 3) linear, row 0 at the top
    error : standard error of a pixel's luminance, rms over the image
    luminance : mean over the image for each PlatePath, and of all light by OTHER_PATH
    luminance_error : its standard errors
    spp : rays a viewer pixel, an even number
    """

    image: NDArray[np.float32]
    error: float
    luminance: dict[int, float]
    luminance_error: dict[int, float]
    spp: int


def by_path(luminance: dict[int, float]) -> dict[str, float]:
    """Luminance of a simulation by the names of the paths at plates, which add up to its mean."""
    return {path.name.lower(): luminance[path] for path in PlatePath}


def simulate_colours(
    plans: Sequence[Plan],
    source: NDArray[np.float32],
    spp: int,
    has_diffraction: bool = False,
) -> Generator[float, None, Simulation]:
    """`simulate` for plans of different colours, whose light adds up."""
    found = []
    for k, plan in enumerate(plans):
        steps = simulate(plan, source, spp, k, has_diffraction)
        found.append((yield from subprogress(steps, k / len(plans), (k + 1) / len(plans))))
    paths = found[0].luminance
    return Simulation(
        image=np.sum([one.image for one in found], axis=0),
        error=float(np.linalg.norm([one.error for one in found])),
        luminance={path: sum(one.luminance[path] for one in found) for path in paths},
        luminance_error={
            path: float(np.linalg.norm([one.luminance_error[path] for one in found]))
            for path in paths
        },
        spp=found[0].spp,
    )


def simulate(
    plan: Plan,
    source: NDArray[np.float32],
    spp: int,
    seed: int = 0,
    has_diffraction: bool = False,
) -> Generator[float, None, Simulation]:
    """Follow rays from the whole viewer image through the plate's actual mirrors.

    All display light in the colours of the plan counts, even past glass and plate, with its
    throughput. Light reflected by the first plate's face is a separate ray.

    Parameters
    ----------
    plan : compiled with Brightness if glass absorbs
    source : (H, W, 3 or 4) the display's image, linear, row 0 at the top
    spp : rays a viewer pixel, rounded up to even: the error is estimated from the difference of two
        half images
    has_diffraction : spread light as the plates' slits do
    """
    viewer = plan.viewer
    plan = replace(plan, settings=replace(plan.settings, brightness=True, only_through_glass=False))
    has_faces = any(array.array.has_fresnel for array in plan.arrays)
    shown = plan.rig.display.light_of(source[..., :3])
    texels = shown.reshape(-1, 3) * np.array(plan.settings.colours)
    n = viewer.width * viewer.height
    passes = 2 * ((max(spp, 1) + 1) // 2)
    halves = np.zeros((2, 3, n))
    by_pass = np.zeros((passes, len(PlatePath) + 1))
    random = np.random.default_rng(seed)
    start = random.random((2, n, 2))
    focus = focus_of(plan.rig.place_of(viewer), viewer) if viewer.pupil else None

    for k in range(passes):
        has_shown = by_pass[:, PlatePath.REFLECTED].any()
        share = 1.0 if has_shown or k < 2 else 1.0 / SELDOM

        for first in range(0, n, TRACED_AT_ONCE):
            pixels = np.arange(first, min(first + TRACED_AT_ONCE, n))
            inside = (start[k % 2, pixels] + (k // 2) * EVEN_STEP) % 1.0
            xy = np.stack([pixels % viewer.width, pixels // viewer.width], axis=1) + inside
            if has_diffraction and plan.arrays:
                xy = _diffracted(plan, xy, random)
            if focus is None:
                sent = viewer.rays(xy)
            else:
                places = in_pupil(viewer, random.random((len(xy), 2)))
                sent = rays_through(viewer, xy, places, focus)

            kinds: list[tuple[PlateLight, Ints, float]] = [("folded", np.arange(len(pixels)), 1.0)]
            if has_faces:
                some = np.flatnonzero(random.random(len(pixels)) < share)
                kinds.append(("reflected", some, 1.0 / share))
            for light, some, weight in kinds:
                views = plan.rig.display.views
                dither = 0.0 if views is None else random.random((len(some), 2)) - 0.5
                those = tuple(of_ray[some] for of_ray in sent)
                rays, colours, path, is_main = _shown(plan, those, light, texels, dither)
                colours *= weight
                # a ray that splits adds all its light
                of_chunk = halves[k % 2][:, first : first + len(pixels)]
                for channel in range(3):
                    of_chunk[channel] += np.bincount(some[rays], colours[:, channel], len(pixels))
                bright = dot(colours, LUMINANCE) / n
                by_pass[k] += np.bincount(path, bright, OTHER_PATH + 1)
                by_pass[k, OTHER_PATH] += bright[~is_main].sum()
            yield (k * n + first + len(pixels)) / (passes * n)

    halves *= 2.0 / passes
    image = halves.mean(axis=0).T.reshape(viewer.height, viewer.width, 3).astype(np.float32)
    apart = LUMINANCE @ (halves[0] - halves[1])
    # passes of one half avoid each other, so assuming independence is conservative
    spread = by_pass.std(axis=0, ddof=1) / np.sqrt(passes)
    return Simulation(
        image=image,
        error=float(np.sqrt((apart**2).mean()) / 2),
        luminance=dict(enumerate(by_pass.mean(axis=0).tolist())),
        luminance_error=dict(enumerate(spread.tolist())),
        spp=passes,
    )


def _diffracted(plan: Plan, xy: Floats, random: np.random.Generator) -> Floats:
    """Viewer px (n, 2) moved at random, as the slits of plates spread the light that arrives there.

    A slit as wide as the pitch p spreads light of the wavelength w: its direction changes along the
    mirrors' normal by x w / p with a density of sinc^2 x (Born and Wolf, Principles of Optics,
    8.5.1). An image at the distance l from the plate is displaced by l times this. The image is in
    the picture's plane, and l is measured along the line of sight, without glass. Lines of sight
    that miss a plate keep their light.
    """
    viewer, place = plan.viewer, plan.rig.place_of(plan.viewer)
    if place.mesh is None:
        return xy
    origins, directions = viewer.rays(xy)
    away = focus_of(place, replace(viewer, focus=None)) / (directions @ viewer.axes[2])
    at = origins + away[:, None] * directions
    plates = [plate for plate in plan.rig.plates if plate.array is not None]
    for plate, array in zip(plates, plan.arrays, strict=True):
        normal = array.axes[2]
        ahead = ((array.centre - origins) @ normal) / (directions @ normal)
        met = origins + ahead[:, None] * directions
        is_through = (ahead > 0) & _is_on(plate.mesh, met)
        turns = np.interp(random.random((len(xy), 2)), SPREAD, SLIT)
        turns *= plan.settings.wavelength / array.array.pitch * (ahead - away)[:, None]
        moved = np.einsum("nk,nkj->nj", turns, array.mirror_normals(met))
        at += np.where(is_through[:, None], moved, 0.0)
    return viewer.project(at)


def _is_on(mesh: Mesh, places: Floats) -> Bools:
    """Whether places (n, 3) of a flat mesh's plane are on one of its triangles."""
    found = np.zeros(len(places), bool)
    for a, b, c in mesh.corners:
        normal = np.cross(b - a, c - a)
        sides = [
            np.cross(end - start, places - start) @ normal
            for start, end in ((a, b), (b, c), (c, a))
        ]
        found |= np.min(sides, axis=0) >= 0
    return found


def _shown(
    plan: Plan,
    rays: tuple[Floats, ...],
    light: PlateLight,
    texels: Floats,
    dither: Floats | float,
) -> tuple[Ints, Floats, Ints, Bools]:
    """Display light of rays for one kind of light: indices (m,) of lit points, colours (m, 3),
    PlatePath (m,), and whether by the path of the picture (m,), if parts split light.

    rays : origins and directions (n, 3)
    texels : (H * W, 3) of the display, row by row
    dither : as for `in_quilt`, equal for all landings of a ray
    """
    display = plan.rig.display
    landings = trace(plan, *rays, light=light)
    is_seen, index = landings.pixels(display.width, display.height)
    if display.views is not None:
        is_seen, index = in_quilt(plan, landings, is_seen, index, dither[landings.sample])
    if light == "reflected":  # ideal plates reflect nothing
        is_seen &= landings.plate_path == PlatePath.REFLECTED

    colours = texels[index[is_seen]] * landings.throughput[is_seen, None]
    is_main = are_main(landings, len(rays[0]))[is_seen]
    return landings.sample[is_seen], colours, landings.plate_path[is_seen], is_main


@dataclass(frozen=True)
class PlateView:
    """The effect of mirrors on the picture's light, over the visible part of the display.

    Parameters
    ----------
    brightness : mean share of imaged light, 0..1; least and most over the image
    blur : rms displacement of the image by the mirrors' pitch, viewer px; None if undefined
    brightness_error, blur_error : standard errors from the sampling
    """

    brightness: float
    least: float
    most: float
    blur: float | None
    brightness_error: float
    blur_error: float | None


def plate_view(plan: Plan, seed: int = 0) -> Generator[float, None, PlateView | None]:
    """Brightness and blur from a sample of the viewer's rays; None if the plates are ideal or
    nothing is seen.

    Yields progress 0..1.
    """
    if not plan.arrays:
        return None

    viewer = plan.viewer
    size = (viewer.width, viewer.height)
    bright = replace(plan, settings=replace(plan.settings, brightness=True))
    view = np.random.default_rng(seed).uniform(0, size, (N_PLATE_RAYS, 2))
    here = main_landings(trace(bright, *viewer.rays(view)), len(view))
    is_seen, _ = here.pixels(plan.rig.display.width, plan.rig.display.height)
    if not is_seen.any():
        return None

    # the plate's transmission: light relative to an ideal plate
    yield 0.2
    view = view[is_seen]
    elements = tuple(None if one in plan.arrays else one for one in plan.parts.elements)
    without = replace(bright, parts=replace(bright.parts, elements=elements))
    ideal = trace(without, *viewer.rays(view))
    without = main_landings(ideal, len(view)).throughput
    share = here.throughput[is_seen] / np.where(without > 0, without, 1.0)

    yield 0.3
    back = yield from _moved(plan, view, here.xy[is_seen], here.branch[is_seen])
    square = (back**2).sum(axis=1)
    blur = float(np.sqrt(square.mean())) if len(square) else None
    return PlateView(
        brightness=float(share.mean()),
        least=float(share.min()),
        most=float(share.max()),
        blur=blur,
        brightness_error=float(share.std() / np.sqrt(len(share))),
        blur_error=float(square.std() / np.sqrt(len(square)) / (2 * blur)) if blur else None,
    )


def _moved(
    plan: Plan, view: Floats, xy: Floats, branch: np.ndarray
) -> Generator[float, None, Floats]:
    """Displacement (m, 2), viewer px, by mirrors at viewer px (n, 2) landing at xy (n, 2).

    Derived from the view map's derivatives, for imaged light on a smooth part of the map. Yields
    progress 0.3..1.
    """
    viewer = plan.viewer
    steps = DERIVATIVE_STEP_PX * np.array([[0.5, 0], [-0.5, 0], [0, 0.5], [0, -0.5]])
    around = []
    for step in steps:
        found = trace(plan, *viewer.rays(view + step))
        around.append(main_landings(found, len(view), branch))
        yield 0.3 + 0.15 * len(around)

    right, left, below, above = (landings.xy for landings in around)
    j = np.stack([right - left, below - above], axis=2) / DERIVATIVE_STEP_PX
    determinant = j[:, 0, 0] * j[:, 1, 1] - j[:, 0, 1] * j[:, 1, 0]

    real = main_landings(trace(plan, *viewer.rays(view), light="folded"), len(view), branch)
    is_valid = real.plate_path == PlatePath.IMAGED
    for other in (real, *around):
        is_valid &= other.branch == branch
    is_valid &= np.abs(determinant) > 0

    # the inverse of j times the displacement on the display
    j = j[is_valid]
    dx, dy = (real.xy - xy)[is_valid].T
    back = np.stack([j[:, 1, 1] * dx - j[:, 0, 1] * dy, j[:, 0, 0] * dy - j[:, 1, 0] * dx], axis=1)
    return back / determinant[is_valid, None]
