"""Tessellation error: distance of landings from those of the surface the mesh approximates."""

from collections.abc import Callable, Generator
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats
from ..base.steps import Steps, hold_progress, subprogress
from ..glass.curved import CurvedFaces
from ..glass.paraboloids import Paraboloids
from ..glass.trust import PART
from ..light.compile_plan import compile_plan_steps
from ..light.plan import Counts, Plan, PlannedLayer
from ..light.ray_engine import Layer
from ..light.rays import Landings, Step, Words, main_landings
from ..light.trace import recording, tracing
from ..rig.rig import ROLES, Glass, Kind, Mirror, Rig, Viewer

SAMPLES = 32  # rays along each side of the viewer's image
# Fraction of a face's tilt: normals are means of several faces, and light turns by half as much.
TILTED = 0.25
MOSTLY = 0.5  # above this fraction of a part's smooth faces left as drawn, most of the part is
NEAR_OF_GLASS = 1e-3  # of the glass's size: closer solids may overlap with another mesh


class Tessellation(NamedTuple):
    """Landing error due to the mesh, display px rms, approximate; all 0 if everything is flat.

    Parameters
    ----------
    drawn : due to facets with bent normals that are traced as flat
    order : due to the degree, 4, of curved faces
    straight : due to straight edges next to flat faces and at sharp edges
    jumps : due to normals that disagree at the edges of curved faces (irregular or noisy mesh)
    uneven : number of the part with most jumps, glasses first, then mirrors; -1 for none
    is_irregular : jumps exceed the tolerance, and Automatic leaves most of the part as drawn
    undecided : fraction of the light, 0..1, that passes between two solids so close that faces of
        degree 3 instead of 4 change its path: the solids have different triangles there
    """

    drawn: float = 0.0
    order: float = 0.0
    straight: float = 0.0
    jumps: float = 0.0
    uneven: int = -1
    is_irregular: bool = False
    undecided: float = 0.0

    @property
    def error(self) -> float:
        """Sum of all causes, display px rms."""
        return float(np.linalg.norm(self[:4]))

    @property
    def cause(self) -> str:
        """The main cause: 'drawn', 'order', 'straight' or 'jumps'.

        Normals also jump on a mesh that is merely coarse.
        """
        if self.is_irregular:
            return "jumps"
        return max(("drawn", "order", "straight"), key=lambda name: getattr(self, name))


def _as_parabolic(plan: Plan, held: PlannedLayer) -> Layer:
    """A layer with paraboloids for its flat triangles with bent normals."""
    layer = held.layer
    normals = plan.triangles.corner_normals[held.numbers]
    if layer.motion is not None:
        normals = normals @ layer.motion.rotation

    is_bent = plan.triangles.is_bent[held.numbers]
    return layer.bent(Paraboloids.added_to(layer.curved, layer.corners, is_bent, normals))


@dataclass(eq=False)
class _Sample:
    """A sample of a viewer's rays, traced through a plan.

    every : origins and directions (n, 3)
    whole : their landings (n,)
    steps : their hits
    here : landings of the rays that arrive; only these are compared
    rays : origins and directions of these rays
    """

    plan: Plan
    every: tuple[Floats, Floats]
    whole: Landings
    steps: list[Step]
    here: Landings
    rays: list[Floats]

    def landings(
        self, layers: list[Layer], steps: list[Step] | None = None, course: Words | None = None
    ) -> Steps[Landings]:
        """Landings of the same rays through other layers, each traced while it keeps its course, if
        given.
        """
        held = tuple(
            replace(planned, layer=layer)
            for planned, layer in zip(self.plan.layers, layers, strict=True)
        )
        found = yield from tracing(replace(self.plan, layers=held), *self.rays, course, steps)
        return main_landings(found, len(self.rays[0]), self.here.branch)

    def changed(
        self, change: Callable[[CurvedFaces], CurvedFaces], steps: list[Step] | None = None
    ) -> Steps[Landings]:
        """Landings of the same rays through modified curved faces."""
        layers = [held.layer for held in self.plan.layers]
        changed_ones = [
            layer if layer.curved is None else layer.bent(change(layer.curved)) for layer in layers
        ]
        return self.landings(changed_ones, steps)


def tessellation(plan: Plan) -> Generator[float, None, Tessellation]:
    """Error between the traced surface and the one the mesh approximates; yields progress 0..1.

    The surface is changed and a sample of the viewer's rays traced again. Flat triangles with bent
    normals are compared with paraboloids, and straight edges with free ones. Curved faces have
    degree 4: the effect of degree 5 is extrapolated from the changes from 2 to 3 and from 3 to 4 as
    a geometric sequence. If normals jump at the edges of the faces that a ray hits, each face's own
    normals are compared with the common ones.
    """
    curved = [held.layer.curved for held in plan.layers if held.layer.curved is not None]
    if not (curved or plan.triangles.is_bent.any()):
        return Tessellation()

    sample = yield from hold_progress(0.0, _sampled(plan))
    yield 0.2

    found = Tessellation(drawn=(yield from hold_progress(0.2, _error_of_facets(sample))))
    if curved:
        found = yield from subprogress(_with_curved(found, sample), 0.4, 0.8)

    if any(faces.has_straight_edges for faces in curved):
        freed = yield from hold_progress(0.8, sample.changed(_free))
        found = found._replace(straight=difference(sample.here, freed))

    if found.jumps <= plan.settings.tolerance:
        return found
    counts, part = plan.counts, found.uneven
    if plan.rig.curved_parts()[part].mesh.surface != "automatic":
        automatic = yield from hold_progress(
            0.9, compile_plan_steps(_by_automatic(plan.rig, part), plan.settings)
        )
        counts = automatic.counts
    return found._replace(is_irregular=_is_mostly_drawn(counts, part))


def _sampled(plan: Plan) -> Steps[_Sample]:
    """Rays spread evenly over the viewer's image, traced to the display."""
    every = _spread_rays(plan.viewer, SAMPLES)
    steps: list[Step] = []
    whole = main_landings((yield from tracing(plan, *every, steps=steps)), len(every[0]))
    here = Landings(*(getattr(whole, f.name)[whole.has_arrived] for f in fields(Landings)))

    rays = [values[here.sample] for values in every]
    return _Sample(plan, every, whole, steps, here, rays)


def _error_of_facets(sample: _Sample) -> Steps[float]:
    """Error due to flat facets with bent normals, display px rms."""
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
    # Custom normals are exact. Mean normals are not, so paraboloids refract by their own.
    parts = plan.rig.curved_parts()
    has_means = np.array([part.mesh.has_mean_normals for part in parts] + [False])
    is_mean = has_means[plan.parts.owner[plan.triangles.part]]
    is_bent = plan.triangles.is_bent.copy()
    for held, so in zip(plan.layers, is_drawn, strict=True):
        is_bent[held.numbers[is_mean[held.numbers]]] &= not so
    changed = replace(plan, triangles=replace(plan.triangles, is_bent=is_bent))

    # A ray off its course has no information, and may go on for long.
    _, course = yield from recording(plan, *sample.rays)
    found = yield from replace(sample, plan=changed).landings(layers, course=course)
    return difference(sample.here, found)


def _with_curved(found: Tessellation, sample: _Sample) -> Generator[float, None, Tessellation]:
    """Add the errors of curved faces by degree and normals; yields progress 0..1."""
    own = yield from hold_progress(0.0, sample.changed(CurvedFaces.by_own_normals))
    steps: list[Step] = []
    square = yield from hold_progress(0.3, sample.changed(lambda curved: curved.lowered(2)))
    cubic = yield from hold_progress(0.6, sample.changed(lambda curved: curved.lowered(3), steps))
    yield 1.0

    last = difference(own, cubic)
    before = difference(cubic, square)
    # The two sides of an edge differ by twice their distance from the mean.
    jumps = 2 * float(np.sqrt(PART.squared_error)) * difference(sample.here, own)

    return found._replace(
        order=last * min(1.0, last / before) if before else last,
        undecided=_undecided(sample, cubic, steps),
        jumps=jumps,
        uneven=_most_moved(sample, own) if jumps else -1,
    )


def _spread_rays(viewer: Viewer, side: int) -> tuple[Floats, Floats]:
    """Origins and directions (side^2, 3) of rays spread evenly over the viewer's image."""
    x, y = ((np.arange(side) + 0.5) / side * size for size in (viewer.width, viewer.height))
    return viewer.rays(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))


def _most_moved(sample: _Sample, own: Landings) -> int:
    """Number of the part that moves most light if its faces use their own normals."""
    plan, here = sample.plan, sample.here
    alike = _have_same_branch(here, own)
    moved = np.zeros(len(sample.every[0]))
    moved[here.sample[alike]] = ((own.xy - here.xy)[alike] ** 2).sum(axis=1)

    by_part = np.zeros(len(plan.rig.curved_parts()))
    for held in plan.layers:
        curved = held.layer.curved
        if curved is None:
            continue
        is_given = np.zeros(len(plan.triangles), bool)
        is_given[held.numbers[curved.triangle]] = curved.normal_row >= 0
        for step in sample.steps:
            some = is_given[step.triangle]
            owner = plan.parts.owner[plan.triangles.part[step.triangle[some]]]
            np.add.at(by_part, owner, moved[step.rays[some]])

    return int(np.argmax(by_part))


def _free(curved: CurvedFaces) -> CurvedFaces:
    """Curved faces with their straight edges freed."""
    coefficients = curved.coefficients.copy()
    held = np.flatnonzero(curved.bent_row >= 0)
    coefficients[held] = curved.bent[curved.bent_row[held]]
    return replace(curved, coefficients=coefficients)


def difference(one: Landings, other: Landings) -> float:
    """Rms distance of landings on the same branch, display px; 0 if there are none."""
    same = _have_same_branch(one, other)
    return (
        float(np.sqrt(((one.xy - other.xy)[same] ** 2).sum(axis=1).mean())) if same.any() else 0.0
    )


def _have_same_branch(one: Landings, other: Landings) -> Bools:
    """Whether landings arrive on the same branch."""
    return one.has_arrived & other.has_arrived & (one.branch == other.branch)


def _undecided(sample: _Sample, other: Landings, other_steps: list[Step]) -> float:
    """Fraction of the light that changes its path with the degree, near two close solids.

    other : landings with curved faces of another degree
    other_steps : hits of these rays
    """
    here = sample.here
    is_changed = other.branch != here.branch
    if not is_changed.any():
        return 0.0

    with np.errstate(invalid="ignore"):
        off = np.abs(other.xy - here.xy).max(axis=1)
        is_changed &= ~(other.has_arrived & (off <= sample.plan.settings.tolerance))

    is_near = _passes_near(sample.plan, sample.every[0], sample.steps)[here.sample]
    is_near |= _passes_near(sample.plan, sample.rays[0], other_steps)
    return float((is_changed & is_near).mean())


def _passes_near(plan: Plan, origins: Floats, steps: list[Step]) -> Bools:
    """Whether rays (n,) hit two solids in succession within NEAR_OF_GLASS of the glass's size."""
    sizes = [float(np.ptp(glass.mesh.bounds, axis=0).max()) for glass in plan.rig.glasses]
    size = max(sizes, default=0.0)
    last = origins.copy()
    solid = np.full(len(origins), -1)
    is_near = np.zeros(len(origins), bool)

    for step in steps:
        part = plan.triangles.part[step.patch]  # a patch has the number of one of its triangles
        part = np.where(plan.parts.kind[part] == Kind.GLASS, part, -1)
        is_other = (part >= 0) & (solid[step.rays] >= 0) & (part != solid[step.rays])
        is_near[step.rays] |= is_other & (
            np.linalg.norm(step.place - last[step.rays], axis=1) < NEAR_OF_GLASS * size
        )
        last[step.rays], solid[step.rays] = step.place, part

    return is_near


def _is_mostly_drawn(counts: Counts, part: int) -> bool:
    """Whether most of a part is left as drawn; parts are numbered glasses first, then mirrors."""
    n_doubted = counts.n_doubted[part]
    return n_doubted > MOSTLY * (n_doubted + counts.n_curved[part])


def _by_automatic(rig: Rig, part: int) -> Rig:
    """The rig with the given curved part on Automatic."""
    chosen = rig.curved_parts()[part]
    changed = replace(chosen, mesh=replace(chosen.mesh, surface="automatic"))
    fields = {
        role.field: tuple(changed if one is chosen else one for one in rig.of(role))
        for role in ROLES
        if role.is_curved
    }
    return replace(rig, **fields)


def path_length(rig: Rig, part: Glass | Mirror) -> float:
    """Length, m, of the light path from a part to the display, by way of the plate if there is
    one.
    """
    stops = (part, *rig.plates[:1], rig.display)
    middles = np.array([stop.mesh.bounds.mean(axis=0) for stop in stops])
    return float(np.linalg.norm(np.diff(middles, axis=0), axis=1).sum())
