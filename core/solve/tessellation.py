"""How far off is the surface that is followed from the one that was meant?"""

from collections.abc import Callable, Generator
from dataclasses import fields, replace
from typing import NamedTuple

import numpy as np

from .. import kernel
from ..arrays import Bools, Floats, Ints
from ..glass.curved import CurvedFaces
from ..glass.paraboloids import Paraboloids
from ..kinds import Kind
from ..light.display import display_pixel
from ..light.landings import Landings
from ..light.plan import Plan, PlannedLayer
from ..light.planning import planning
from ..light.ray_engine import Layer
from ..light.trace import Step, tracing
from ..rig import ROLES, Glass, Mirror, Rig, Viewer
from ..steps import Pauses, at, within

SAMPLES = 32  # rays along each side of the viewer's image
# of a face's tilt: normals are means of some faces, and light turns by half of their turn
TILTED = 0.25
COARSE = 0.25  # display px: where the surface may be further off than this it is worth a remark
# times the error of the order: noisy balls have 7 and
# more of it by jumps, an icosahedron once cut 1
IRREGULAR = 3.0
# times the error as drawn: noisy balls have 2.4 and more of it by jumps, coarse tori 1.1 and less
WORSE = 2.0
NEAR = 1e-3  # of the glass's size


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

    @property
    def error(self) -> float:
        """All of it, display px rms."""
        return float(np.linalg.norm(self[:4]))

    @property
    def cause(self) -> str:
        """The cause of most of it: 'drawn', 'order', 'straight' or 'jumps'.

        On a mesh that is merely coarse normals jump as well: by no more than a few
        times the error of the order, or than its facets would be off.
        """
        is_coarse = self.jumps < max(IRREGULAR * self.order, WORSE * self.as_drawn)
        return max(
            ("drawn", "order", "straight") if is_coarse else self._fields[:4],
            key=lambda name: getattr(self, name),
        )


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


def _difference(one: Landings, other: Landings) -> float:
    """Distance of landings on the same branch, rms in display px; 0 where there are none."""
    same = one.has_arrived & other.has_arrived & (one.branch == other.branch)
    return (
        float(np.sqrt(((one.xy - other.xy)[same] ** 2).sum(axis=1).mean())) if same.any() else 0.0
    )


def tessellation(plan: Plan) -> Generator[float, None, Tessellation]:
    """The error that the mesh leaves open of the surface that was meant.

    It is seen from what a change of the surface does to a sample of the viewer's rays. Flat
    triangles with bent normals are compared with paraboloids; faces whose edges are held straight
    with what they would be if they were not. Curved faces are of degree 4; what degree 5 would
    change is taken to follow on the changes from 2 to 3 and from 3 to 4 as a geometric sequence.
    Where normals jump at the edges of the faces that a ray meets, its light may be turned by a part
    of that. Yields progress 0..1.
    """
    has_curved = any(held.layer.curved is not None for held in plan.layers)
    if not (has_curved or plan.triangles.is_bent.any()):
        return Tessellation()
    every = _sample(plan.viewer, SAMPLES)
    ways: tuple[list[Step], list[Step]] = [], []
    whole = yield from at(0.0, tracing(plan, *every, steps=ways[0]))
    here = Landings(*(getattr(whole, f.name)[whole.has_arrived] for f in fields(Landings)))
    rays = [values[here.sample] for values in every]  # with the others nothing is compared
    is_met = np.zeros(len(plan.triangles), bool)
    for step in ways[0]:
        is_met[step.triangle] = True
    is_drawn = [
        bool((plan.triangles.is_bent & is_met)[held.numbers].any()) and held.layer.has_engine
        for held in plan.layers
    ]
    yield 0.2

    def landings(layers: list[Layer], steps: list[Step] | None = None) -> Pauses[Landings]:
        held = zip(plan.layers, layers, strict=True)
        layers_of = tuple(replace(planned, layer=layer) for planned, layer in held)
        return tracing(replace(plan, layers=layers_of), *rays, steps=steps)

    def changed(
        change: Callable[[CurvedFaces], CurvedFaces], steps: list[Step] | None = None
    ) -> Pauses[Landings]:
        layers = [held.layer for held in plan.layers]
        changed_ones = [
            layer if layer.curved is None else layer.bent(change(layer.curved)) for layer in layers
        ]
        return landings(changed_ones, steps)

    found = Tessellation()
    if any(is_drawn):
        drawn = zip(plan.layers, is_drawn, strict=True)
        layers = [_as_parabolic(plan, held) if so else held.layer for held, so in drawn]
        found = found._replace(drawn=_difference(here, (yield from at(0.2, landings(layers)))))
    if has_curved:
        square = yield from at(0.4, changed(lambda curved: curved.lowered(2)))
        cubic = yield from at(0.6, changed(lambda curved: curved.lowered(3), ways[1]))
        yield 0.8
        last = _difference(here, cubic)
        before = _difference(cubic, square)
        found = found._replace(
            order=last * min(1.0, last / before) if before else last,
            undecided=_undecided(plan, (here, cubic), (every[0], rays[0]), ways),
        )
        jumps, uneven = _turned_by_jumps(plan, ways[0], here.sample)
        found = found._replace(jumps=jumps, uneven=uneven)
    curved = (held.layer.curved for held in plan.layers)
    if any(faces is not None and faces.has_straight_edges for faces in curved):
        found = found._replace(straight=_difference(here, (yield from at(0.8, changed(_let_go)))))
    if found.cause == "jumps" and found.jumps > COARSE:
        plan_as_drawn = yield from at(0.9, planning(_drawn(plan.rig), plan.settings))
        seen = tessellation(plan_as_drawn.seen_by(plan.viewer))
        drawn = yield from within(seen, 0.9, 1.0)
        found = found._replace(as_drawn=drawn.drawn)
    return found


def _drawn(rig: Rig) -> Rig:
    """A rig whose curved parts are followed as drawn."""
    drawn = {
        role.field: tuple(
            replace(part, mesh=replace(part.mesh, surface="facets")) for part in rig.of(role)
        )
        for role in ROLES
        if role.is_curved
    }
    return replace(rig, **drawn)


def _sample(viewer: Viewer, side: int) -> tuple[Floats, Floats]:
    """Origins and directions (side^2, 3) of rays spread evenly over the viewer's image."""
    x, y = ((np.arange(side) + 0.5) / side * size for size in (viewer.width, viewer.height))
    return viewer.rays(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))


def _undecided(
    plan: Plan,
    landings: tuple[Landings, Landings],
    origins: tuple[Floats, Floats],
    ways: tuple[list[Step], list[Step]],
) -> float:
    """Share of the light that arrives elsewhere by another
    degree, having passed near two solids on either way.
    """
    here, other = landings
    is_changed = other.branch != here.branch
    if not is_changed.any():
        return 0.0
    with np.errstate(invalid="ignore"):
        off = np.abs(other.xy - here.xy).max(axis=1)
        is_changed &= ~(other.has_arrived & (off <= plan.settings.tolerance))
    is_near = _passes_near(plan, origins[0], ways[0])[here.sample] | _passes_near(
        plan, origins[1], ways[1]
    )
    return float((is_changed & is_near).mean())


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
        place = np.full(len(plan.triangles), -1)
        place[held.numbers] = np.arange(len(held.numbers))
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


def _passes_near(plan: Plan, origins: Floats, steps: list[Step]) -> Bools:
    """Which rays (n,) meet two solids one after the other
    within NEAR of the glass's size of each other?
    """
    size = max(float(np.ptp(glass.mesh.bounds, axis=0).max()) for glass in plan.rig.glasses)
    last = origins.copy()
    solid = np.full(len(origins), -1)
    is_near = np.zeros(len(origins), bool)
    for step in steps:
        part = plan.triangles.part[step.patch]  # a patch has the number of one of its triangles
        part = np.where(plan.parts.kind[part] == Kind.GLASS, part, -1)
        is_other = (part >= 0) & (solid[step.rays] >= 0) & (part != solid[step.rays])
        is_near[step.rays] |= is_other & (
            np.linalg.norm(step.place - last[step.rays], axis=1) < NEAR * size
        )
        last[step.rays], solid[step.rays] = step.place, part
    return is_near


def _let_go(curved: CurvedFaces) -> CurvedFaces:
    """Curved faces whose straight edges are not held straight."""
    coefficients = curved.coefficients.copy()
    held = np.flatnonzero(curved.bent_row >= 0)
    coefficients[held] = curved.bent[curved.bent_row[held]]
    return replace(curved, coefficients=coefficients)


def way_from(rig: Rig, part: Glass | Mirror) -> float:
    """Length, m, of the way of light from a part of the rig over the plate to the display."""
    plate, display = (other.mesh.bounds.mean(axis=0) for other in (rig.plates[0], rig.display))
    return float(
        np.linalg.norm(part.mesh.bounds.mean(axis=0) - plate) + np.linalg.norm(plate - display)
    )
