"""Estimates of a result's own error, and of light that meets normals which contradict their face,
so that renderers bend it another way.
"""

from collections.abc import Generator
from dataclasses import dataclass, field, replace

import numpy as np

from ..base.arrays import FLOAT32, Bools, Floats, Ints
from ..base.steps import Steps, hold_progress
from ..base.vectors import dot, length_of, normalise
from ..glass.meshes import areas_of, interpolate
from ..image.picture import of_square, picture_from_view
from ..light.display import display_pixel
from ..light.optics import reflect
from ..light.plan import Plan
from ..light.ray_engine import Layer
from ..light.rays import Reason, Step, main_landings
from ..light.trace import tracing
from .tessellation import TILTED, Tessellation, tessellation, way_from

# Cycles turns a normal until light mirrored at it leaves the face at this cosine, or at so much of
# that at which it came (`ensure_valid_specular_reflection` in its bsdf_util.h)
FLATTEST = 0.01
FLATTEST_OF_COMING = 0.9
BENT = 1e-6  # light that turns by less has met a face between two equal media


def find_contradicted(plan: Plan, origins: Floats, steps: list[Step]) -> Ints:
    """For each ray (n,) the first object, among the rig's glasses, then mirrors,
    that bends it by a normal which contradicts its flat face; -1 for none.

    A normal contradicts its face, for this light, where it looks away from the light, or light
    mirrored at it would go into the face, or nearly so: there Cycles and others take another one.
    Curved faces are left out.

    Parameters
    ----------
    origins : (n, 3) m, world
    steps : as `tracing` gives them
    """
    found = np.full(len(origins), -1)
    if not plan.triangles.is_bent.any():
        return found

    held_places = [(held, held.places(len(plan.triangles))) for held in plan.layers]
    last = origins.copy()
    came = np.zeros_like(origins)
    asked = found.copy()

    def go_on(rays: Ints, directions: Floats) -> None:
        """Was light bent where it was asked?"""
        has_turned = length_of(directions - came[rays]) > BENT
        some = rays[has_turned & (asked[rays] >= 0) & (found[rays] < 0)]
        found[some] = asked[some]

    for step in steps:
        way = step.place - last[step.rays]
        moves = length_of(way) > 0
        rays, triangle, place = step.rays[moves], step.triangle[moves], step.place[moves]
        directions = normalise(way[moves])
        go_on(rays, directions)
        go_on(step.left, step.direction)

        owner = plan.parts.owner[plan.triangles.part[triangle]]
        is_bent = plan.triangles.is_bent[triangle]
        is_odd = np.zeros(len(triangle), bool)
        for held, places in held_places:
            some = np.flatnonzero(is_bent & (places[triangle] >= 0))
            number = triangle[some]
            is_odd[some] = _contradicts(
                plan, held.layer, number, places[number], place[some], directions[some]
            )
        asked[rays] = np.where(is_odd, owner, -1)
        last[rays], came[rays] = place, directions

    return found


def _contradicts(
    plan: Plan, layer: Layer, triangle: Ints, number: Ints, place: Floats, directions: Floats
) -> Bools:
    """Are normals at places (n, 3) of bent triangles (n,) such for light with directions (n, 3)?

    number : (n,) the layer's own, of the triangles
    """
    at = place if layer.motion is None else layer.motion.back(place, directions)[0]
    u, v = layer.frames.barycentric(number, at)
    shading = normalise(interpolate(plan.triangles.corner_normals[triangle], u, v))
    geometric = plan.triangles.normals[triangle]

    came = dot(directions, geometric)
    back = np.where(came < 0, 1.0, -1.0)  # times a normal: the side the light came from
    leaves = back * dot(reflect(directions, shading), geometric)
    looks_away = back * dot(directions, shading) >= 0
    is_flat = leaves < np.minimum(FLATTEST_OF_COMING * np.abs(came), FLATTEST)
    return looks_away | is_flat


# rays along each side of the viewer's image: the light through gaps is known to a thousandth or two
LEAK_SAMPLES = 96
LEAST_LOST = 1e-3  # of the picture's light: less that goes through gaps is not worth a word
ODD_SAMPLES = 48  # the same for light at normals that contradict faces: known to half a hundredth
CAUGHT_SAMPLES = 256  # rays that are followed further than Max Events
FURTHER = 4  # times as far
# surfaces: a ray that meets more, and twice as many as others do, is compared with none
MANY_EVENTS = 64
OTHERS = 95  # per cent of the light that arrives


@dataclass(frozen=True)
class Accuracy:
    """Errors of a plan that a sample of its rays tells, beside the error of the map.

    tessellation : the error that the mesh leaves open
    rounding : display px by which landings may be off because Blender rounds
    leaks : for each glass the share, 0..1, of the picture's light that goes through its gaps
    caught : share, 0..1, of the light cut off by Max Events that
        FURTHER times as many surfaces do not set free
    contradicted : for each glass, then each mirror, the share, 0..1, of the picture's light that
        it bends by normals which contradict its faces
    leaked : shares of the picture's light that goes through gaps, where nobody knows its way, by
        where it seems to end
    """

    tessellation: Tessellation
    rounding: float
    leaks: tuple[float, ...]
    caught: float
    contradicted: tuple[float, ...]
    leaked: dict[Reason, float] = field(default_factory=dict)


def measure(
    plan: Plan, is_cut_off: bool = True, elsewhere: Accuracy | None = None
) -> Generator[float, None, Accuracy]:
    """Accuracy of a plan; yields progress 0..1.

    is_cut_off : may some of its light be cut off by Max Events?
    elsewhere : of the same plan with its picture elsewhere, if that is known
    """
    bounded = yield from hold_progress(0.0, _bounded(plan))
    if elsewhere is None:
        found = yield from tessellation(bounded)
        rounding = rounding_error(plan)
    else:
        found, rounding = elsewhere.tessellation, elsewhere.rounding
    open_light, leaked = yield from hold_progress(1.0, _leaking(plan))
    odd_light = yield from hold_progress(1.0, contradicted(bounded))
    caught_light = 0.0
    if is_cut_off:
        caught_light = yield from hold_progress(1.0, caught(plan))
    return Accuracy(found, rounding, open_light, caught_light, odd_light, leaked)


def _bounded(plan: Plan) -> Steps[Plan]:
    """A plan in which rays are given up that meet far more surfaces than others.

    Light held within a thin shell meets as many as Max Events allows, and by numpy each takes its
    time. Its landings would be compared with none: on another surface it goes another way.
    """
    settings = plan.settings
    if settings.max_events <= MANY_EVENTS:
        return plan

    landings = yield from tracing(plan, *_picture_rays(plan, ODD_SAMPLES)[0])
    n_met = landings.n_events[landings.has_arrived]
    others = int(np.percentile(n_met, OTHERS)) if len(n_met) else 0
    most = min(settings.max_events, max(MANY_EVENTS, 2 * others))
    return replace(plan, settings=replace(settings, max_events=most))


def rounding_error(plan: Plan) -> float:
    """About how far landings may be off because Blender keeps
    places and vertices as float32, display px.

    Each part is shifted by half a step of its place. Vertices that are off tilt the faces between
    them, by the more the smaller those are: light is turned by TILTED of it, and lands beside by
    that times its way from the glass.
    """
    rig = plan.rig
    off = (
        FLOAT32
        / 4
        * max(
            float(np.abs(part.mesh.bounds).max())
            for part in (*rig.glasses, *rig.plates, rig.display)
        )
    )

    for part in rig.curved_parts():
        if not part.mesh.rounding:
            continue

        corners = part.mesh.corners
        area = areas_of(corners)
        edge = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
        has_area = area > 0
        if not has_area.any():
            continue

        tilt = part.mesh.rounding * float(np.average(1 / edge[has_area], weights=area[has_area]))
        off = max(off, TILTED * tilt * way_from(rig, part))

    return off / display_pixel(rig.display)


def leaks(plan: Plan) -> Steps[tuple[float, ...]]:
    """For each glass of a plan the share, 0..1, of the light that
    carries the picture and goes through its gaps.
    """
    return (yield from _leaking(plan))[0]


def _leaking(plan: Plan) -> Steps[tuple[tuple[float, ...], dict[Reason, float]]]:
    """The same, and the shares by where such light seems to end."""
    n_glasses = len(plan.rig.glasses)
    if not plan.open_parts:
        return (0.0,) * n_glasses, {}

    rays, cover = _picture_rays(plan)
    landings = main_landings((yield from tracing(plan, *rays)), len(cover))
    leaked = landings.leak >= 0
    weight = cover[leaked] / max(cover.sum(), 1e-300)
    shares = _shares(plan.parts.owner[landings.leak[leaked]], cover[leaked], n_glasses, cover.sum())
    by_reason = np.bincount(landings.reason[leaked], weight, len(Reason))
    return shares, {reason: float(by_reason[reason]) for reason in Reason}


def contradicted(plan: Plan) -> Steps[tuple[float, ...]]:
    """For each glass, then each mirror, of a plan the share, 0..1, of the light that
    carries the picture and is bent there by normals which contradict the faces.
    """
    n_parts = len(plan.rig.curved_parts())
    if not plan.triangles.is_bent.any():
        return (0.0,) * n_parts

    rays, cover = _picture_rays(plan, ODD_SAMPLES)
    steps: list[Step] = []
    yield from tracing(plan, *rays, steps=steps)
    part = find_contradicted(plan, rays[0], steps)
    odd = part >= 0
    return _shares(part[odd], cover[odd], n_parts, cover.sum())


def caught(plan: Plan) -> Steps[float]:
    """Share, 0..1, of the light cut off by Max Events that does
    not come free within FURTHER times as many surfaces.

    Light comes into a whole solid as it goes out: light that never
    does so is held by faces that contradict each other.
    """
    (origins, directions), _ = _picture_rays(plan)
    landings = yield from tracing(plan, origins, directions)
    cut_off = np.unique(landings.sample[landings.reason == Reason.CUT_OFF])
    if not len(cut_off):
        return 0.0

    some = cut_off[
        np.linspace(0, len(cut_off) - 1, min(len(cut_off), CAUGHT_SAMPLES)).astype(np.int64)
    ]
    settings = replace(plan.settings, max_events=FURTHER * plan.settings.max_events)
    further = yield from tracing(replace(plan, settings=settings), origins[some], directions[some])
    return len(np.unique(further.sample[further.reason == Reason.CUT_OFF])) / len(some)


def _shares(part: Ints, cover: Floats, n_parts: int, whole: float) -> tuple[float, ...]:
    """The share of the whole light that each part has of rays (n,) with a cover (n,)."""
    weights = np.bincount(part, cover, n_parts)
    return tuple(float(weight) for weight in weights / max(whole, 1e-300))


def _picture_rays(plan: Plan, side: int = LEAK_SAMPLES) -> tuple[tuple[Floats, Floats], Floats]:
    """Origins and directions (n, 3) of rays on which a viewer sees the picture,
    at most `side` each way, and how much each sees of it, 0..1.
    """
    viewer = plan.viewer
    along = np.arange(side) + 0.5
    xy = np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)
    xy *= np.array([viewer.width, viewer.height]) / side
    cover = picture_from_view(plan.rig.picture_place, viewer, xy, of_square(1.0)).cover
    seen = cover > 0
    return viewer.rays(xy[seen]), cover[seen]
