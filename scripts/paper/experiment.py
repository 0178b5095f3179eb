"""The paper's three photographs, re-traced.

Dots are found by re-tracing, so amounts may be large.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from kiriko.core.base.arrays import Floats
from kiriko.core.base.errors import RigError
from kiriko.core.image.ideal_image import ideal_image
from kiriko.core.image.seen_image import lattice_shift
from kiriko.core.lab.calibrate.misalignment import Bench
from kiriko.core.light.compile_plan import make_plan
from kiriko.core.light.trace import trace_all
from kiriko.core.rig.rig import WAVELENGTH, PicturePlace, Rig
from kiriko.core.rig.settings import Settings

from .solves import solve
from .suspects import CONDITIONS, Photograph, Setup, Suspect, as_planned

ACROSS = 1165  # viewer px from the first to the last dot
DOTS = 7  # each way
PIXELS = 971  # of images in which dots are measured: half of the photographs' do


def framed(rig: Rig) -> Rig:
    """The rig, its viewer's image of such a size that the dots
    are ACROSS pixels from the first to the last.
    """
    viewer = rig.viewer
    across = np.ptp(viewer.project(dots(rig.picture_place))[:, 0])
    width = round(viewer.width * ACROSS / across)
    return replace(
        rig,
        viewers=(replace(viewer, width=width, height=round(width * viewer.height / viewer.width)),),
    )


def dots(place: PicturePlace) -> Floats:
    """Places (49, 3) of the dots of the lattice on a flat picture, m.

    Row by row from the top left.
    """
    at = (np.arange(DOTS) + 0.5) / DOTS
    u, v = (x.ravel() for x in np.meshgrid(at, 1 - at))
    uv = place.mesh.uv.reshape(-1, 2)
    places = place.mesh.corners.reshape(-1, 3)
    affine, *_ = np.linalg.lstsq(np.column_stack([uv, np.ones(len(uv))]), places, rcond=None)
    return np.column_stack([u, v, np.ones(len(u))]) @ affine


class Experiment:
    """Three photographs of the lattice, re-traced.

    Parameters
    ----------
    rig : as planned, with the lattice as its picture

    Attributes
    ----------
    planned : the setup when nothing is off
    """

    def __init__(self, rig: Rig) -> None:
        self.rig = framed(rig)
        self.dots = dots(rig.picture_place)
        self.wanted = self.rig.viewer.project(self.dots)
        self.planned = as_planned(self.rig)
        self._start = [self.wanted] * len(CONDITIONS)
        self._kept = {}
        self._start = [
            self._seen(k, photograph) for k, photograph in enumerate(self.planned.photographs)
        ]

    def moves(self, setup: Setup) -> Floats:
        """Displacement (3, 49, 2) of the dots, viewer px; NaN
        where one is not seen or leaves its way.
        """
        found = []
        for k, photograph in enumerate(setup.photographs):
            if (k, photograph) not in self._kept:
                self._kept[k, photograph] = self._seen(k, photograph)
            found.append(self._kept[k, photograph] - self.wanted)
        return setup.scale * np.stack(found)

    def changed(self, some: Sequence[Suspect], amounts: Sequence[float]) -> Setup:
        """With amounts of suspects, in tolerances."""
        setup = self.planned
        for suspect, amount in zip(some, amounts, strict=True):
            setup = suspect.changed(setup, float(amount * suspect.tolerance)) if amount else setup
        return setup

    def off(self, some: Sequence[Suspect], amounts: Sequence[float]) -> Floats:
        """Displacement (3, 49, 2), NaN all over where there is no such bench."""
        try:
            return self.moves(self.changed(some, amounts))
        except RigError:
            return np.full((len(CONDITIONS), len(self.wanted), 2), np.nan)

    def _seen(self, k: int, photograph: Photograph) -> Floats:
        """Where the dots (49, 2) of one photograph are seen: first
        the middle one, then all from where that went.
        """
        made_for = photograph.made_for
        middle = [len(self.wanted) // 2]
        plan = make_plan(made_for, Settings(only_through_glass=False))
        shown = trace_all(plan, *made_for.viewer.rays(made_for.viewer.project(self.dots))).xy
        start = self._start[k]
        start = start + _found(photograph.bench, start[middle], shown[middle]) - start[middle]
        return _found(photograph.bench, start, shown)

    def photographed(self, setup: Setup, pixels: int = PIXELS) -> Floats:
        """Displacement (3, 49, 2) of the dots' centroids in images
        of the seen image, as `dev.py paper` measures it.

        The images are of so many pixels in width, and what is
        found counts in those of the photographs.
        """
        wanted = ideal_image(self.rig.picture, _coarse(self.rig, pixels).viewer)
        found = []
        for photograph in setup.photographs:
            is_bare = all(glass.ior.at(WAVELENGTH) == 1 for glass in photograph.made_for.glasses)
            source = solve(
                _coarse(photograph.made_for, pixels), only_through_glass=not is_bare
            ).source
            seen = solve(_coarse(photograph.bench, pixels)).seen(source)
            found.append(lattice_shift(seen, wanted).shift.reshape(-1, 2))
        return setup.scale * self.rig.viewer.width / pixels * np.stack(found)


def _coarse(rig: Rig, pixels: int) -> Rig:
    """Its viewer's image, as large as before, of so many pixels in width."""
    height = round(pixels * rig.viewer.height / rig.viewer.width)
    return replace(rig, viewers=(replace(rig.viewer, width=pixels, height=height),))


def _found(bench: Rig, start: Floats, shown: Floats) -> Floats:
    """Where points shown at display px (n, 2) are seen (n, 2), from viewer px (n, 2) on."""
    return Bench(bench, Settings(), start, []).seen(np.empty(0), display=shown)
