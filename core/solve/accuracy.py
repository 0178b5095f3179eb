"""Errors of a result, estimated from a sample of its rays: tessellation, rounding, leaks, bad
normals.
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
from .tessellation import TILTED, Tessellation, path_length, tessellation

# Cycles bends a shading normal until the mirrored ray leaves the face at this cosine, or at this
# fraction of the incident cosine (`ensure_valid_specular_reflection` in its bsdf_util.h).
FLATTEST = 0.01
FLATTEST_OF_COMING = 0.9
BENT = 1e-6  # below this change of direction the ray has crossed a face between two equal media


def find_contradicted(plan: Plan, origins: Floats, steps: list[Step]) -> Ints:
    """Object that bends each ray (n,) by a normal that contradicts its flat face; -1 for none.

    Objects are numbered glasses first, then mirrors; the first one on the path is reported. A
    normal contradicts its face if it points away from the incident ray, or if the mirrored ray
    would enter the face or graze it. Cycles and other renderers replace such a normal. Curved faces
    are skipped.

    Parameters
    ----------
    origins : (n, 3) m, world
    steps : from `tracing`
    """
    found = np.full(len(origins), -1)
    if not plan.triangles.is_bent.any():
        return found

    held_places = [(held, held.places(len(plan.triangles))) for held in plan.layers]
    last = origins.copy()
    came = np.zeros_like(origins)
    suspect = found.copy()

    def record_bent(rays: Ints, directions: Floats) -> None:
        """Record the suspected object of each ray that was really bent there."""
        has_turned = length_of(directions - came[rays]) > BENT
        some = rays[has_turned & (suspect[rays] >= 0) & (found[rays] < 0)]
        found[some] = suspect[some]

    for step in steps:
        way = step.place - last[step.rays]
        moves = length_of(way) > 0
        rays, triangle, place = step.rays[moves], step.triangle[moves], step.place[moves]
        directions = normalise(way[moves])
        record_bent(rays, directions)
        record_bent(step.left, step.direction)

        owner = plan.parts.owner[plan.triangles.part[triangle]]
        is_bent = plan.triangles.is_bent[triangle]
        is_odd = np.zeros(len(triangle), bool)
        for held, places in held_places:
            some = np.flatnonzero(is_bent & (places[triangle] >= 0))
            number = triangle[some]
            is_odd[some] = _contradicts(
                plan, held.layer, number, places[number], place[some], directions[some]
            )
        suspect[rays] = np.where(is_odd, owner, -1)
        last[rays], came[rays] = place, directions

    return found


def _contradicts(
    plan: Plan, layer: Layer, triangle: Ints, number: Ints, place: Floats, directions: Floats
) -> Bools:
    """Whether the normals of flat-shaded triangles contradict their faces, (n,), for incident rays.

    place, directions : (n, 3); number : (n,) the layer's own triangle numbers
    """
    at = place if layer.motion is None else layer.motion.back(place, directions)[0]
    u, v = layer.frames.barycentric(number, at)
    shading = normalise(interpolate(plan.triangles.corner_normals[triangle], u, v))
    geometric = plan.triangles.normals[triangle]

    came = dot(directions, geometric)
    back = np.where(came < 0, 1.0, -1.0)  # factor of a normal that turns it to the incident side
    leaves = back * dot(reflect(directions, shading), geometric)
    looks_away = back * dot(directions, shading) >= 0
    is_flat = leaves < np.minimum(FLATTEST_OF_COMING * np.abs(came), FLATTEST)
    return looks_away | is_flat


# Rays along each side of the viewer's image: leaks are accurate to 0.1 or 0.2 %.
LEAK_SAMPLES = 96
LEAST_LOST = 1e-3  # fraction of the picture's light below which leaks are not reported
ODD_SAMPLES = 48  # along each side, for light at contradicting normals: accurate to 0.5 %
CAUGHT_SAMPLES = 256  # rays followed beyond Max Events
FURTHER = 4  # times Max Events
# A ray with more events than this, and twice as many as most rays, is left out of comparisons.
MANY_EVENTS = 64
OTHERS = 95  # percentile of the events of arriving rays


@dataclass(frozen=True)
class Accuracy:
    """Errors that a sample of a plan's rays shows, in addition to the map's own error.

    tessellation : error due to the coarseness of the mesh
    rounding : landing error due to Blender's float32 coordinates, display px
    leaks : for each glass, fraction of the picture's light through its gaps
    caught : fraction of the light cut off by Max Events that is still inside after FURTHER times
        as many events
    contradicted : for each glass, then each mirror, fraction of the picture's light bent there by
        normals that contradict their faces
    leaked : fraction of the picture's light through gaps, by its apparent end
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

    is_cut_off : whether Max Events may cut off some of its light
    elsewhere : accuracy of the same plan with its picture elsewhere, if measured
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
    """The plan with Max Events lowered for rays that meet far more surfaces than most.

    Light held in a thin shell uses all of Max Events, and numpy follows each such ray to the end.
    On a refined surface it takes another path, so its landings could not be compared anyway.
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
    """Landing error due to Blender's float32 places and vertices, display px, approximate.

    Each part is displaced by half a step of its coordinates. Displaced vertices tilt a face in
    inverse proportion to its size; TILTED of this tilt turns the light, and its landing moves by
    this angle times the distance from the glass.
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
        off = max(off, TILTED * tilt * path_length(rig, part))

    return off / display_pixel(rig.display)


def leaks(plan: Plan) -> Steps[tuple[float, ...]]:
    """Fraction of the picture's light, 0..1, that leaks through the gaps of each glass."""
    return (yield from _leaking(plan))[0]


def _leaking(plan: Plan) -> Steps[tuple[tuple[float, ...], dict[Reason, float]]]:
    """`leaks`, and the same light by its apparent end."""
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
    """Fraction of the picture's light, 0..1, that contradicting normals bend.

    One value for each glass, then for each mirror.
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
    """Fraction, 0..1, of the light cut off by Max Events that stays inside FURTHER times as long.

    Light leaves a sound solid as it entered. Light that never leaves is held by contradicting
    faces.
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
    """Fraction of the whole light on the rays (n,) of each part, by their cover (n,)."""
    weights = np.bincount(part, cover, n_parts)
    return tuple(float(weight) for weight in weights / max(whole, 1e-300))


def _picture_rays(plan: Plan, side: int = LEAK_SAMPLES) -> tuple[tuple[Floats, Floats], Floats]:
    """Origins and directions (n, 3) of rays to the picture, and their cover (n,), 0..1.

    side : rays each way over the viewer's image, at most
    """
    viewer = plan.viewer
    along = np.arange(side) + 0.5
    xy = np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)
    xy *= np.array([viewer.width, viewer.height]) / side
    cover = picture_from_view(plan.rig.picture_place, viewer, xy, of_square(1.0)).cover
    seen = cover > 0
    return viewer.rays(xy[seen]), cover[seen]
