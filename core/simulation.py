"""What the viewer sees through the mirrors of a real plate: stray light, dimness and blur; by samples."""

from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .plan import Plan
from .plate import PlatePath
from .rig import Bools
from .trace import CHUNK, Landings, PlateLight, trace

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear Rec.709
SAMPLED = 2048  # rays from which brightness and blur are told
STEP = 0.05  # viewer px, for derivatives of the view map


@dataclass(frozen=True, eq=False)
class Simulation:
    """The seen image by way of a plate's mirrors.

    Parameters
    ----------
    image : (h, w, 3) linear, row 0 at the top
    error : standard error of a pixel's luminance, rms over the image
    luminance : mean over the image, for each PlatePath by which light came
    spp : rays a viewer pixel
    n_rays : rays traced
    """

    image: NDArray[np.float32]
    error: float
    luminance: dict[PlatePath, float]
    spp: int
    n_rays: int


def simulate(plan: Plan, source: NDArray[np.float32], spp: int, seed: int = 0) -> Generator[float, None, Simulation]:
    """Follow rays from everywhere in the viewer's image the way that the plate's mirrors send them.

    All light counts, that which comes past the glass too, with what glass and plate leave of it. What each face of the
    plate reflects is a ray of its own.

    Parameters
    ----------
    source : (H, W, 3) what the display shows, linear, row 0 at the top
    spp : rays a viewer pixel, at a random place in each of as many parts of it
    """
    viewer, display = plan.rig.viewer, plan.rig.display
    plan = replace(plan, settings=replace(plan.settings, brightness=True, only_through_glass=False))
    has_faces = any(array.array.has_fresnel for array in plan.arrays.values())
    lights: list[PlateLight] = ["crossed", "reflected"] if has_faces else ["crossed"]
    texels = source.reshape(-1, source.shape[2])[:, :3].astype(float)
    n = viewer.width * viewer.height
    total, squares = np.zeros((3, n)), np.zeros(n)
    luminance = dict.fromkeys(PlatePath, 0.0)
    random = np.random.default_rng(seed)
    across = int(np.ceil(np.sqrt(spp)))
    n_done, n_rays, n_all = 0, 0, spp * n
    for k in range(spp):
        if k == 1 and not luminance[PlatePath.REFLECTED]:
            lights = ["crossed"]  # of a ray a pixel none got there by the plate's faces
        for first in range(0, n, CHUNK):
            pixels = np.arange(first, min(first + CHUNK, n))
            # the pixel is cut in parts, which take turns; where there are more parts than rays they are drawn by lot
            part = (k if across**2 == spp else random.integers(across**2, size=len(pixels))) + np.zeros(len(pixels))
            inside = (np.stack([part % across, part // across], axis=1) + random.random((len(pixels), 2))) / across
            rays = viewer.rays(np.stack([pixels % viewer.width, pixels // viewer.width], axis=1) + inside)
            seen = np.zeros((len(pixels), 3))
            for light in lights:
                landings = trace(plan, *rays, light=light)
                n_rays += len(pixels)
                is_seen, index = _texels(landings, display.width, display.height)
                if light == "reflected":  # by ideal plates nothing is
                    is_seen &= landings.plate_path == PlatePath.REFLECTED
                colours = texels[index[is_seen]] * landings.throughput[is_seen, None]
                seen[is_seen] += colours
                bright = np.bincount(landings.plate_path[is_seen], colours @ LUMINANCE, len(PlatePath))
                for path in PlatePath:
                    luminance[path] += bright[path] / n_all
            total[:, first : first + len(pixels)] += seen.T
            squares[first : first + len(pixels)] += (seen @ LUMINANCE) ** 2
            n_done += len(pixels)
            yield n_done / n_all
    mean = LUMINANCE @ total / spp
    variance = np.maximum(squares / spp - mean**2, 0.0) / max(spp - 1, 1)
    image = (total / spp).T.reshape(viewer.height, viewer.width, 3).astype(np.float32)
    return Simulation(image, float(np.sqrt(variance.mean())), luminance, spp, n_rays)


def _texels(landings: Landings, width: int, height: int) -> tuple[Bools, NDArray[np.int64]]:
    """Which landings (n,) are on the display's image, and at which of its pixels, row by row."""
    with np.errstate(invalid="ignore"):
        is_seen = landings.has_arrived & (landings.xy >= 0).all(axis=1) & (landings.xy < (width, height)).all(axis=1)
        column, row = np.where(is_seen[:, None], landings.xy, 0).astype(np.int64).T
    return is_seen, row * width + column


@dataclass(frozen=True)
class PlateView:
    """What mirrors make of the picture's light, over what is seen of it.

    Parameters
    ----------
    brightness : mean share of the light that images, 0..1; least and most of it
    blur : rms by which the mirrors' pitch moves what is seen, viewer px; None where it is not known
    """

    brightness: float
    least: float
    most: float
    blur: float | None


def plate_view(plan: Plan, seed: int = 0) -> PlateView | None:
    """Brightness and blur, from a sample of the viewer's rays; None where the plates are ideal or nothing is seen."""
    if not plan.arrays:
        return None
    viewer, size = plan.rig.viewer, (plan.rig.display.width, plan.rig.display.height)
    bright = replace(plan, settings=replace(plan.settings, brightness=True))
    view = np.random.default_rng(seed).uniform(0, (viewer.width, viewer.height), (SAMPLED, 2))
    steps = STEP * np.array([[0.5, 0], [-0.5, 0], [0, 0.5], [0, -0.5]])
    here = trace(bright, *viewer.rays(view))
    is_seen, _ = _texels(here, *size)
    if not is_seen.any():
        return None
    view = view[is_seen]
    # what the plate leaves of the light: all that is left, by what is left of it with an ideal plate
    without = trace(replace(bright, arrays={}), *viewer.rays(view)).throughput
    share = here.throughput[is_seen] / np.where(without > 0, without, 1.0)
    around = [trace(plan, *viewer.rays(view + step)) for step in steps]
    real = trace(plan, *viewer.rays(view), light="crossed")
    moved = real.xy - here.xy[is_seen]
    j = np.stack([around[0].xy - around[1].xy, around[2].xy - around[3].xy], axis=2) / STEP
    is_one = (real.plate_path == PlatePath.IMAGED) & np.isfinite(moved).all(axis=1)
    for other in around:
        is_one &= other.branch == here.branch[is_seen]
    det = j[:, 0, 0] * j[:, 1, 1] - j[:, 0, 1] * j[:, 1, 0]
    is_one &= np.abs(det) > 0
    back = np.linalg.solve(j[is_one], moved[is_one][:, :, None])[:, :, 0]
    return PlateView(
        brightness=float(share.mean()),
        least=float(share.min()),
        most=float(share.max()),
        blur=float(np.sqrt((back**2).sum(axis=1).mean())) if len(back) else None,
    )
