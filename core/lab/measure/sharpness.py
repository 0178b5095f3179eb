"""Sharpness of a picture through a viewer's pupil: vergence, spot and contrast, over the picture.

A place s of the pupil sees a point of the display in the direction theta(s), both across the ray
through the pupil's middle. The derivative V = -d theta / d s, 2 x 2 in dioptres, is the point's
*vergence*: a point at the distance a in air has V = 1 / a in all directions. Half the trace of V is
the best focus, the difference of its eigenvalues the astigmatism. An eye that focuses on the
picture sees the point as a *spot*: the places of its image through all parts of the pupil. The
contrast of a grating, as seen, is the magnitude of the spot's Fourier transform (Goodman,
Introduction to Fourier Optics, 6.4); MTF50 is the frequency of half contrast.

Two eyes converge where their lines of sight meet. Shibata, Kim, Hoffman and Banks (The zone of
comfort, Journal of Vision 11(8):11, 2011, doi 10.1167/11.8.11) had observers view conflicts between
this distance and the focus; a conflict beyond about half a dioptre becomes uncomfortable.
"""

from collections.abc import Generator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.arrays import Floats
from ...base.errors import RigError
from ...base.messages import Message
from ...base.numbers import number
from ...base.steps import hold_progress
from ...base.vectors import dot, normalise
from ...bench.part_sizes import plane_of
from ...image.flat_picture import view_of_picture
from ...light.plan import Plan
from ...rig.pupil import even_places, focus_of, pinhole_at
from ...rig.rig import Rig, Viewer
from ...rig.viewer import ARCMIN
from ..drawing.svg import FONT, document, text_at
from .places_seen import Observer, grid_of, grid_on, place_of_shown, places_of_shown, places_shown
from .two_eyes import embedded, nearest_between, pair_of
from .viewer_errors import N_POINTS

N_PLACES = 64  # of a pupil; half contrast is a phase of about one radian across a spot
LINEAR = 0.02  # of a pupil's diameter, step of the derivative
N_DIRECTIONS, N_FREQUENCIES = 12, 400  # of gratings
COMFORT = 0.5  # dioptres; source above
FILE = "sharpness.svg"
WIDTH, GAP, TOP = 480, 30, 70  # px, of a drawing
LARGEST = 0.35  # rms of the largest spot drawn, in steps of the grid


@dataclass(frozen=True, eq=False)
class Sharpness:
    """Sharpness for one viewer at n x n points of the picture, from the top; NaN if unseen.

    vergence : (n, n, 2, 2) dioptres, across the line of sight, right and up
    picture : (n, n) dioptres, of the picture's own points
    spot : (n, n, k, 2) arcmin, right and up, places of the pupil about their mean
    converged : (n, n) dioptres, at which two eyes converge; None unless the viewers are a pair
    """

    viewer: str
    vergence: Floats
    picture: Floats
    spot: Floats
    converged: Floats | None

    @property
    def best_focus(self) -> Floats:
        """Dioptres (n, n)."""
        return np.trace(self.vergence, axis1=2, axis2=3) / 2

    @property
    def rms(self) -> Floats:
        """Rms radius (n, n) of the spots, arcmin."""
        return np.sqrt((self.spot**2).sum(axis=3).mean(axis=2))

    @property
    def mtf50(self) -> Floats:
        """Lowest frequency (n, n), cycles per degree, of half contrast in any direction."""
        angle = np.pi * np.arange(N_DIRECTIONS) / N_DIRECTIONS
        along = self.spot @ np.stack([np.cos(angle), np.sin(angle)]) / 60
        worst = np.full(self.picture.shape, np.inf)
        # half contrast of a disc is at 0.25 / rms, of two points at 0.17 / rms
        step = 0.5 / N_FREQUENCIES / np.maximum(self.rms / 60, np.finfo(float).tiny)
        for k in range(1, N_FREQUENCIES + 1):
            phase = 2 * np.pi * (k * step)[..., None, None] * along
            contrast = np.abs(np.exp(1j * phase).mean(axis=2)).min(axis=2)
            worst = np.where((contrast <= 0.5) & np.isinf(worst), k * step, worst)
        return np.where(np.isnan(self.rms), np.nan, worst)

    def as_data(self) -> dict[str, Any]:
        """Record for a report, with rows from the top; None for unseen points."""
        fields = {
            "best_focus_dioptres": self.best_focus,
            "focus_error_dioptres": self.best_focus - self.picture,
            "spot_rms_arcmin": self.rms,
            "mtf50_per_degree": self.mtf50,
        }
        if self.converged is not None:
            fields["focus_less_convergence_dioptres"] = self.best_focus - self.converged
        found: dict[str, Any] = {"viewer": self.viewer}
        for name, values in fields.items():
            seen = values[np.isfinite(values)]
            found[f"mean_{name}"] = float(seen.mean()) if len(seen) else None
            found[name] = [[x if np.isfinite(x) else None for x in row] for row in values.tolist()]
        return found


def in_words(figures: dict[str, Any]) -> Message:
    """A sentence on the record of a viewer, and one if its focus is uncomfortable for two eyes."""
    text = Message(
        "'{viewer}' focuses best {error:+.2f} dioptres from the picture. Focused on the picture,"
        " spots are {rms} arcmin rms, and contrast is halved at {mtf50} cycles per degree.",
        viewer=figures["viewer"],
        error=figures["mean_focus_error_dioptres"] or 0.0,
        rms=number(figures["mean_spot_rms_arcmin"] or 0.0),
        mtf50=number(figures["mean_mtf50_per_degree"] or np.inf),
    )
    conflict = abs(figures.get("mean_focus_less_convergence_dioptres") or 0.0)
    if conflict <= COMFORT:
        return text
    return Message(
        "{text} Focus and convergence differ by {conflict:.2f} dioptres; above {most:g} this is"
        " uncomfortable.",
        text=text,
        conflict=conflict,
        most=COMFORT,
    )


def check_pupils(rig: Rig) -> None:
    """Raise RigError unless a viewer has a pupil and the picture is a flat rectangle."""
    if not any(viewer.pupil for viewer in rig.viewers):
        raise RigError("No viewer has a pupil: set its diameter.")
    plane_of(rig)


def sharpness_of(plan: Plan, n: int = N_POINTS) -> Generator[float, None, list[Sharpness]]:
    """Sharpness of n x n points of a picture for each viewer with a pupil; yields progress 0..1.

    Display pixels are taken as infinitely small.

    Raises
    ------
    RigError : no viewer has a pupil, or the picture is not a flat rectangle
    """
    rig = plan.rig
    check_pupils(rig)
    uv = grid_on(rig.picture_place, n)
    looks = [Observer(plan.seen_by(viewer), viewer.weight) for viewer in rig.viewers]
    shown = yield from hold_progress(0.0, places_shown(looks, uv))
    converged = yield from hold_progress(0.1, _converged(plan, uv, shown))
    found = []
    for k, viewer in enumerate(rig.viewers):
        if viewer.pupil:
            steps = _sharpness(plan.seen_by(viewer), uv, shown, converged)
            found.append((yield from hold_progress(0.2 + 0.8 * k / len(rig.viewers), steps)))
    yield 1.0
    return found


def _converged(plan: Plan, uv: Floats, shown: Floats) -> Generator[int, None, Floats | None]:
    """Dioptres (n,) at which a pair of eyes converges; None for other viewers."""
    try:
        eyes = pair_of(plan.rig)
    except RigError:
        return None
    sights = []
    for eye in eyes:
        view = yield from place_of_shown(plan.seen_by(eye), uv, shown)
        sights.append(eye.rays(view)[1])
    meet = nearest_between(*(eye.position for eye in eyes), *sights)
    away = meet - (eyes[0].position + eyes[1].position) / 2
    return np.sign(dot(away, sights[0] + sights[1])) / np.sqrt(dot(away, away))


def _sharpness(
    plan: Plan, uv: Floats, shown: Floats, converged: Floats | None
) -> Generator[int, None, Sharpness]:
    """Sharpness for a plan's viewer of display px (n, 2) that show places uv (n, 2)."""
    viewer, place = plan.viewer, plan.rig.picture_place
    focus = focus_of(place, viewer)
    near = LINEAR * viewer.pupil * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
    pupil = np.concatenate([near, even_places(viewer, N_PLACES)])
    eyes = [pinhole_at(viewer, one, focus) for one in pupil]
    view = yield from places_of_shown(plan, eyes, uv, shown)
    rays = [one.rays(xy) for one, xy in zip(eyes[:5], view, strict=False)]
    across = _across(viewer, rays[0][1])

    def slope(which: int) -> Floats:  # of origins or directions, across the line of sight
        steps = [rays[k][which] - rays[k + 1][which] for k in (1, 3)]
        return np.stack([np.einsum("nij,nj->ni", across, step) for step in steps], axis=2)

    vergence = -slope(1) @ np.linalg.inv(slope(0))
    # as the whole pupil projects them: the places that a pinhole in its middle sees
    angles = [np.einsum("nij,nj->ni", across, viewer.rays(xy)[1]) for xy in view[5:]]
    spot = ARCMIN * np.stack(angles, axis=1)
    straight, directions = viewer.rays(view_of_picture(place, viewer, uv))
    plane = plane_of(plan.rig)
    normal = normalise(np.cross(*plane.sides))
    picture = (directions @ normal) / ((plane.middle - straight) @ normal)
    n = round(len(uv) ** 0.5)
    return Sharpness(
        viewer=viewer.name,
        vergence=vergence.reshape(n, n, 2, 2),
        picture=picture.reshape(n, n),
        spot=(spot - spot.mean(axis=1, keepdims=True)).reshape(n, n, -1, 2),
        converged=None if converged is None else converged.reshape(n, n),
    )


def _across(viewer: Viewer, directions: Floats) -> Floats:
    """Unit vectors (n, 2, 3) to the right and up, across directions (n, 3)."""
    right = viewer.axes[0] - dot(directions, viewer.axes[0])[:, None] * directions
    right = normalise(right)
    return np.stack([right, np.cross(right, directions)], axis=1)


def as_svg(rig: Rig, found: list[Sharpness]) -> str:
    """Drawing with a panel for each viewer: spots, all to one scale, over the picture; rms in
    arcmin, and the error of the focus in dioptres.
    """
    across, up = np.linalg.norm(plane_of(rig).sides, axis=1)
    size = np.array([WIDTH, WIDTH * up / across])
    scale = LARGEST * size.min() / max(len(found[0].rms) * np.nanmax([x.rms for x in found]), 1e-9)
    parts = []
    for column, one in enumerate(found):
        n = len(one.rms)
        error = (one.best_focus - one.picture).ravel()
        parts += [f'<g transform="translate({GAP + column * (WIDTH + GAP)} {TOP})">']
        parts += [text_at((0, -9), one.viewer, size=14), embedded(rig, size)]
        spots = zip(grid_of(n), one.rms.ravel(), error, one.spot.reshape(n * n, -1, 2), strict=True)
        for (u, v), rms, off, spot in spots:
            if not np.isfinite(rms):
                continue
            x, y = (u, 1 - v) * size
            parts += [
                f'<circle cx="{x + scale * a:.2f}" cy="{y - scale * b:.2f}" r="1"/>'
                for a, b in spot
            ]
            parts.append(
                text_at((x, y + 0.42 * size[1] / n), f"{number(rms)}' {off:+.2f} D", size=9)
            )
        parts.append("</g>")
    width = GAP + len(found) * (WIDTH + GAP)
    title = "Spots through the pupil that focuses on the picture, arcmin rms; error of the focus"
    parts.append(text_at((GAP, 28), title, size=15))
    return document((width, round(size[1] + TOP + GAP)), f'font-family="{FONT}"', parts)
