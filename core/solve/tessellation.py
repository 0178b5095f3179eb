"""How far off is the surface that is followed from the one that was meant?"""

from collections.abc import Callable, Generator
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np

from .. import kernel
from ..arrays import Floats, Ints
from ..glass.curved import CurvedFaces
from ..glass.paraboloids import Paraboloids
from ..light.display import display_pixel
from ..light.landings import Landings, Words, main_landings
from ..light.plan import Plan, PlannedLayer
from ..light.planning import planning
from ..light.ray_engine import Layer
from ..light.trace import Step, recording, tracing
from ..rig import Glass, Mirror, Rig, Viewer
from ..steps import Pauses, at, within
from .coarse_parts import Coarse, difference, followed, looking_for_coarse
from .undecided import undecided

SAMPLES = 32  # rays along each side of the viewer's image
# of a face's tilt: normals are means of some faces, and light turns by half of their turn
TILTED = 0.25
NOTED_ERROR_PX = 0.25  # where the surface may be further off it is worth a remark
# times the error of the order: noisy balls have 7 and
# more of it by jumps, an icosahedron once cut 1
IRREGULAR = 3.0
# times the error as drawn: noisy balls have 2.4 and more of it by jumps, coarse tori 1.1 and less
WORSE = 2.0


class Tessellation(NamedTuple):
    """About how far landings are from those of the surface that
    was meant, display px rms; all 0 where all is flat.

    Parameters
    ----------
    drawn : because facets with bent normals are no curved faces
    order : because curved faces are of degree 4
    straight : because edges next to flat faces and sharp edges are straight
    jumps : because the normals of curved faces do not agree at
        their edges: the mesh is irregular or noisy
    uneven : which of the rig's glasses, then mirrors, has most of the last; -1 for none
    as_drawn : the first as it would be if all were followed as
        drawn, asked only where jumps matter; else 0
    coarse : a part that does not tell which surface was meant: drawn is then no less than its
        error, and jumps are no more
    undecided : share of the light, 0..1, that passes two solids so near each other that it arrives
        elsewhere, or does not, where the curved faces are of degree 3 instead of 4: the solids have
        other triangles there
    """

    drawn: float = 0.0
    order: float = 0.0
    straight: float = 0.0
    jumps: float = 0.0
    uneven: int = -1
    as_drawn: float = 0.0
    undecided: float = 0.0
    coarse: Coarse = Coarse()

    @property
    def error(self) -> float:
        """All of it, display px rms."""
        return float(np.linalg.norm(self[:4]))

    @property
    def cause(self) -> str:
        """The cause of most of it: 'drawn', 'order', 'straight' or 'jumps'; 'coarse' where most is
        of a part that does not tell which surface was meant.

        On a mesh that is merely coarse normals jump as well: by no more than a few
        times the error of the order, or than its facets would be off.
        """
        if 2 * self.coarse.error > self.error:
            return "coarse"
        is_coarse = self.jumps < max(IRREGULAR * self.order, WORSE * self.as_drawn)
        return max(
            ("drawn", "order", "straight") if is_coarse else self._fields[:4],
            key=lambda name: getattr(self, name),
        )

    def limited_by(self, coarse: Coarse, rig: Rig) -> "Tessellation":
        """The same with a part of a rig that is too coarse to tell."""
        if rig.curved_parts()[coarse.part].mesh.surface == "smooth":
            return self._replace(coarse=coarse, jumps=min(self.jumps, coarse.error))
        return self._replace(coarse=coarse, drawn=max(self.drawn, coarse.error))


def _as_parabolic(plan: Plan, held: PlannedLayer) -> Layer:
    """A layer whose flat triangles with bent normals are paraboloids instead."""
    layer = held.layer
    normals = plan.triangles.corner_normals[held.numbers]
    if layer.motion is not None:
        normals = normals @ layer.motion.rotation

    faces = layer.curved or CurvedFaces.none(layer.corners)
    is_bent = plan.triangles.is_bent[held.numbers]
    bent = layer.bent(Paraboloids.beside(faces, is_bent, normals))

    # the kernel's tree is made sooner than Embree's
    if kernel.library() is not None:
        bent.asked = replace(layer.asked, given=kernel.HullEngine(layer.asked))

    return bent


@dataclass(eq=False)
class _Sample:
    """A sample of a viewer's rays, and their way as a plan has it.

    every : origins and directions (n, 3)
    whole : their landings (n,)
    steps : where they meet surfaces
    here : landings of those that arrive; with the others nothing is compared
    rays : origins and directions of these alone
    """

    plan: Plan
    every: tuple[Floats, Floats]
    whole: Landings
    steps: list[Step]
    here: Landings
    rays: list[Floats]

    def landings(
        self, layers: list[Layer], steps: list[Step] | None = None, course: Words | None = None
    ) -> Pauses[Landings]:
        """The same rays through other layers, each as long as it is on its course, if given."""
        held = tuple(
            replace(planned, layer=layer)
            for planned, layer in zip(self.plan.layers, layers, strict=True)
        )
        found = yield from tracing(replace(self.plan, layers=held), *self.rays, course, steps)
        return main_landings(found, len(self.rays[0]), self.here.branch)

    def changed(
        self, change: Callable[[CurvedFaces], CurvedFaces], steps: list[Step] | None = None
    ) -> Pauses[Landings]:
        """The same rays through curved faces that are changed."""
        layers = [held.layer for held in self.plan.layers]
        changed_ones = [
            layer if layer.curved is None else layer.bent(change(layer.curved)) for layer in layers
        ]
        return self.landings(changed_ones, steps)


def tessellation(plan: Plan) -> Generator[float, None, Tessellation]:
    """The error that the mesh leaves open of the surface that was meant.

    It is seen from what a change of the surface does to a sample of the viewer's rays. Flat
    triangles with bent normals are compared with paraboloids; faces whose edges are held straight
    with what they would be if they were not. Curved faces are of degree 4; what degree 5 would
    change is taken to follow on the changes from 2 to 3 and from 3 to 4 as a geometric sequence.
    Where normals jump at the edges of the faces that a ray meets, its light may be turned by a part
    of that. Yields progress 0..1.
    """
    curved = [held.layer.curved for held in plan.layers if held.layer.curved is not None]
    if not (curved or plan.triangles.is_bent.any()):
        return Tessellation()

    sample = yield from at(0.0, _sampled(plan))
    yield 0.2

    found = Tessellation(drawn=(yield from at(0.2, _error_of_facets(sample))))
    if curved:
        found = yield from within(_with_curved(found, sample), 0.4, 0.8)

    if any(faces.has_straight_edges for faces in curved):
        let_go = yield from at(0.8, sample.changed(_let_go))
        found = found._replace(straight=difference(sample.here, let_go))

    is_uneven = found.cause == "jumps" and found.jumps > NOTED_ERROR_PX
    uneven = found.uneven if is_uneven else -1
    coarse = yield from at(0.9, looking_for_coarse(plan, sample.whole, sample.every, uneven))
    if coarse.part >= 0:
        found = found.limited_by(coarse, plan.rig)

    if found.cause == "jumps" and found.jumps > NOTED_ERROR_PX:
        all_drawn = yield from at(0.9, planning(followed(plan.rig, "facets"), plan.settings))
        seen = tessellation(all_drawn.seen_by(plan.viewer))
        drawn = yield from within(seen, 0.9, 1.0)
        found = found._replace(as_drawn=drawn.drawn)

    return found


def _sampled(plan: Plan) -> Pauses[_Sample]:
    """Rays spread evenly over the viewer's image, followed to the display."""
    every = _spread_rays(plan.viewer, SAMPLES)
    steps: list[Step] = []
    whole = main_landings((yield from tracing(plan, *every, steps=steps)), len(every[0]))
    here = Landings(*(getattr(whole, f.name)[whole.has_arrived] for f in fields(Landings)))

    rays = [values[here.sample] for values in every]
    return _Sample(plan, every, whole, steps, here, rays)


def _error_of_facets(sample: _Sample) -> Pauses[float]:
    """Because facets with bent normals are no curved faces, display px rms."""
    plan = sample.plan
    is_met = np.zeros(len(plan.triangles), bool)
    for step in sample.steps:
        is_met[step.triangle] = True

    is_bent = plan.triangles.is_bent & is_met
    is_drawn = [bool(is_bent[held.numbers].any()) and held.layer.has_engine for held in plan.layers]
    if not any(is_drawn):
        return 0.0

    layers = [
        _as_parabolic(plan, held) if so else held.layer
        for held, so in zip(plan.layers, is_drawn, strict=True)
    ]
    # a ray that has left its way tells nothing, and may go on for long
    _, course = yield from recording(plan, *sample.rays)
    return difference(sample.here, (yield from sample.landings(layers, course=course)))


def _with_curved(found: Tessellation, sample: _Sample) -> Generator[float, None, Tessellation]:
    """With the errors of curved faces, by their degree and their normals; yields progress 0..1."""
    steps: list[Step] = []
    square = yield from at(0.0, sample.changed(lambda curved: curved.lowered(2)))
    cubic = yield from at(0.5, sample.changed(lambda curved: curved.lowered(3), steps))
    yield 1.0

    last = difference(sample.here, cubic)
    before = difference(cubic, square)
    ways = sample.steps, steps
    origins = sample.every[0], sample.rays[0]
    jumps, uneven = _turned_by_jumps(sample.plan, sample.steps, sample.here.sample)

    return found._replace(
        order=last * min(1.0, last / before) if before else last,
        undecided=undecided(sample.plan, (sample.here, cubic), origins, ways),
        jumps=jumps,
        uneven=uneven,
    )


def _spread_rays(viewer: Viewer, side: int) -> tuple[Floats, Floats]:
    """Origins and directions (side^2, 3) of rays spread evenly over the viewer's image."""
    x, y = ((np.arange(side) + 0.5) / side * size for size in (viewer.width, viewer.height))
    return viewer.rays(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))


def _turned_by_jumps(plan: Plan, steps: list[Step], arrived: Ints) -> tuple[float, int]:
    """By how much, display px rms, jumping normals move the
    landings of rays that arrived, and most by which part.

    Normals are off by about as much as they jump at the edges of a face.
    """
    parts = plan.rig.curved_parts()
    ways = np.array([way_from(plan.rig, part) for part in parts])
    n_rays = int(arrived.max(initial=-1)) + 1
    squares = np.zeros((len(parts), n_rays))

    for held in plan.layers:
        curved = held.layer.curved
        if curved is None:
            continue

        place = held.places(len(plan.triangles))
        for step in steps:
            some = (place[step.triangle] >= 0) & (step.rays < n_rays)
            rays = step.rays[some]
            met = step.triangle[some]
            owner = plan.parts.owner[plan.triangles.part[met]]
            np.add.at(
                squares, (owner, rays), (TILTED * ways[owner] * curved.jumps(place[met])) ** 2
            )

    if not len(arrived):
        return 0.0, -1

    by_part = np.sqrt(squares[:, arrived].mean(axis=1)) / display_pixel(plan.rig.display)
    return float(np.linalg.norm(by_part)), int(np.argmax(by_part))


def _let_go(curved: CurvedFaces) -> CurvedFaces:
    """Curved faces whose straight edges are not held straight."""
    coefficients = curved.coefficients.copy()
    held = np.flatnonzero(curved.bent_row >= 0)
    coefficients[held] = curved.bent[curved.bent_row[held]]
    return replace(curved, coefficients=coefficients)


def way_from(rig: Rig, part: Glass | Mirror) -> float:
    """Length, m, of the way of light from a part of the rig
    to the display, over the plate where there is one.
    """
    stops = (part, *rig.plates[:1], rig.display)
    middles = np.array([stop.mesh.bounds.mean(axis=0) for stop in stops])
    return float(np.linalg.norm(np.diff(middles, axis=0), axis=1).sum())
