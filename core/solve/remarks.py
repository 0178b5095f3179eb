"""Remarks on a solution and on its light: each names the cause that was measured, and a remedy for
it.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from ..base.messages import Length, Message, joined
from ..base.numbers import number
from ..base.words import percent
from ..glass.meshes import find_edges, geometric_normals
from ..image.flat_picture import outline_in_view
from ..image.glare import Glare
from ..image.picture import cover_in_view
from ..light.display import display_pixel
from ..light.plan import Counts, Plan
from ..light.rays import REASON_WORDS, Reason
from ..map.points import areas
from ..map.view_map import MapError
from ..rig.mesh import SAME_NORMAL
from ..rig.rig import Mesh, Rig
from ..rig.settings import Settings
from ..rig.viewer import Viewer
from .accuracy import LEAST_LOST
from .channel import Channel
from .disagreement import is_sharp
from .solution import Remark, note, warning
from .tessellation import Tessellation

# edges between flat faces that meet at less than ROUND: so many stand for a curved surface
FACETTED = 64
ROUND = np.radians(12.0)


def remedy_for(rig: Rig, mesh: Tessellation, error: MapError) -> Message:
    """The remedy for a view that changes within pixels, by the cause."""
    if error.cut_off > max(error.facet_limited, error.unresolved - error.cut_off):
        return Message("raise Max Events")

    bends = error.facet_limited > error.unresolved
    if bends and mesh.cause == "jumps":
        return Message(
            "the faces of '{name}' contradict each other; {remedy}",
            name=name_of(rig, mesh.uneven),
            remedy=remedy_for_irregular(rig, mesh),
        )

    if bends and mesh.error > 0:
        return Message("use a finer mesh, or raise the viewer's resolution")

    facetted = facetted_glass(rig)
    if facetted:
        return Message(
            "shade '{name}' smooth if it is meant to be curved, or raise the viewer's resolution",
            name=facetted,
        )

    return Message("raise the viewer's resolution")


def remedy_for_mesh(rig: Rig, counts: Counts, mesh: Tessellation) -> Message:
    """The remedy for the error that a mesh leaves open, by its cause."""
    if any(part.mesh.surface == "facets" for part in (*rig.glasses, *rig.mirrors)):
        drawn = Message(
            "it is followed as drawn: subdivide the glass, or set its Surface to Automatic"
        )
    elif any(counts.n_doubted):
        drawn = Message(
            "it is followed as drawn where it is irregular or coarse: use a finer or a more"
            " regular mesh"
        )
    else:
        drawn = Message(
            "normals contradict its shape: mark edges sharp there, or subdivide the glass"
        )

    remedies = {
        "drawn": drawn,
        "order": Message("it is coarse: subdivide the glass"),
        "straight": Message(
            "its edges are straight where smooth faces meet flat ones: add loops near them"
        ),
        "jumps": Message(
            "the curved faces of '{name}' contradict each other at their edges: {remedy}",
            name=name_of(rig, mesh.uneven),
            remedy=remedy_for_irregular(rig, mesh),
        ),
    }
    return remedies[mesh.cause]


def facetted_glass(rig: Rig) -> str:
    """The name of a glass whose facets stand for a curved surface, '' where there is none."""
    return next((glass.name for glass in rig.glasses if is_facetted(glass.mesh)), "")


def remedy_for_irregular(rig: Rig, mesh: Tessellation) -> Message:
    """The remedy for an irregular mesh that is followed as curved."""
    part = (*rig.glasses, *rig.mirrors)[mesh.uneven]
    if part.mesh.surface == "smooth":
        return Message("set its Surface to Automatic, or give it a finer or a more regular mesh")
    return Message("give it a finer or a more regular mesh")


def name_of(rig: Rig, part: int) -> str:
    """The name of a glass or mirror, by its number among both."""
    return (*rig.glasses, *rig.mirrors)[part].name


def is_facetted(mesh: Mesh) -> bool:
    """Do many flat faces of a mesh meet at small angles, as of
    a curved surface that was not shaded smooth?
    """
    is_flat = np.ones(len(mesh.triangles), bool) if mesh.is_smooth is None else ~mesh.is_smooth
    if is_flat.sum() < FACETTED:
        return False

    edges = find_edges(mesh.triangles)
    normals = geometric_normals(mesh.corners)
    apart = np.linalg.norm(normals[edges.first] - normals[edges.second], axis=1)

    meets = (
        is_flat[edges.first]
        & is_flat[edges.second]
        & (apart > SAME_NORMAL)
        & (apart < 2 * np.sin(ROUND / 2))
    )

    return int(meets.sum()) >= FACETTED


# of the light that the viewer gets: more that comes beside the glass is worth a remark
GLARE = 0.05
# linear: half a step of 8 bits, sRGB-encoded, above white
WHITE = ((1 + 0.5 / 255 + 0.055) / 1.055) ** 2.4


def on_white(rig: Rig, plan: Plan, light: NDArray[np.float32]) -> Iterator[Remark]:
    """A remark on light that no display has, the picture's brightness among the remedies."""
    source = rig.display.source_for(light)
    if source.max() <= WHITE:
        return
    # rows of three are slow
    brightest = np.maximum(np.maximum(source[..., 0], source[..., 1]), source[..., 2])
    bright = np.count_nonzero(brightest > WHITE) / max(np.count_nonzero(brightest > 0), 1)
    if not bright:
        return

    remedy = Message("lower the Picture Brightness of '{picture}'", picture=rig.picture.name)
    if plan.settings.brightness:
        remedy = Message("turn Brightness off, {remedy}", remedy=remedy)
    yield note(
        "{share} of the source image is brighter than a display's white and would be clipped:"
        " {remedy}, or export OpenEXR, which keeps it.",
        share=percent(bright),
        remedy=remedy,
    )


def on_black(rig: Rig, light: NDArray[np.float32]) -> Iterator[Remark]:
    """A remark on darkness that this display does not have."""
    black_level = rig.display.black_level
    if not black_level:
        return

    # where nothing is wanted, as around the picture, nobody can do anything about it
    brightest = light.max(axis=2)
    n_wanted = np.count_nonzero(brightest > 0)
    n_dark = np.count_nonzero((brightest > 0) & (brightest < black_level))
    if n_dark:
        yield note(
            "{share} of the source image is wanted darker than the black of '{display}', which"
            " shines {black_level} of its white: it stays that bright. Raise the Picture"
            " Brightness of '{picture}', or take a display of less Black Level.",
            share=percent(n_dark / n_wanted),
            display=rig.display.name,
            black_level=percent(black_level),
            picture=rig.picture.name,
        )


def on_glare(plan: Plan, glare: Glare | None) -> Iterator[Remark]:
    """A remark on light that comes beside the glass."""
    if glare is None or glare.share < GLARE:
        return

    part = Message("plate") if plan.needs_plate else Message("display")
    remedy = (
        Message("cover the part of the {part} that is seen there", part=part)
        if plan.settings.suppress_glare == 1
        else Message(
            "raise Suppress Glare, or cover the part of the {part} that is seen there", part=part
        )
    )

    yield note(
        "Glare: {share} of the light that the viewer gets comes beside the glass, {where}:"
        " {remedy}.",
        share=percent(glare.share),
        where=glare.where,
        remedy=remedy,
    )


LEAST_ROUNDED_PX = 0.1  # display px: where rounding may do more than this it is worth a remark
# of the picture: where a viewer's frame cuts off more it is worth a remark; what pixels along the
# outline of a picture of few pixels show is known to half of that
LEAST_CUT = 0.01
BEYOND = 0.01  # share of what is seen that may be off by more than the tolerance without a remark
# of the picture's light: where normals contradict faces for more of it it is worth a remark; balls
# have that along their outline
LEAST_CONTRADICTED = 0.01
UNDECIDED = 0.01  # share of the light whose way may be another one
# of the light that is cut off: where more never comes free, to raise the limit does not help
MOST_CAUGHT = 0.9


def remarks_on(channels: Sequence[Channel], light: NDArray[np.float32]) -> tuple[Remark, ...]:
    """Remarks on the channels of a solution, each sentence once.

    light : (H, W, 3) that is wanted of the display's pixels, linear
    """
    remarks = list(_on_blind(channels)) if len(channels) > 1 else []
    for channel in channels:
        remarks += [remark for remark in _on_channel(channel, light) if remark not in remarks]
    plan = channels[0].plan
    remarks += _on_disagreement(plan.rig, plan.settings)
    return tuple(remarks)


def _on_disagreement(rig: Rig, settings: Settings) -> Iterator[Remark]:
    place = rig.picture_place
    if len(rig.viewers) < 2 or place.mesh is None or settings.disagreement != "sharp":
        return
    if not is_sharp(rig, settings):
        yield note(
            "The picture '{picture}' is no flat rectangle, so that where the viewers disagree it is"
            " blended: choose a flat plane for one sharp picture.",
            picture=place.name,
        )


def _on_blind(channels: Sequence[Channel]) -> Iterator[Remark]:
    """On viewers that see nothing, beside others that do."""
    for channel in channels:
        is_painted = channel.accuracy.leaked.get(Reason.ARRIVED, 0.0) > 0
        if channel.picture_coverage <= 0 and not is_painted:
            yield warning(
                "The viewer '{viewer}' sees nothing of the picture, whatever is shown: move it, or"
                " turn it off in the list of viewers.",
                viewer=channel.viewer.name,
            )


def _on_channel(channel: Channel, light: NDArray[np.float32]) -> Iterator[Remark]:
    """Remarks on one channel, the gravest first."""
    plan = channel.plan
    rig = plan.rig
    accuracy = channel.accuracy
    error = channel.map_error

    yield from _on_frame(rig, plan.viewer)
    yield from _on_gaps(rig, plan, accuracy.leaks)
    yield from _on_normals(rig, plan, accuracy.contradicted)
    yield from _on_doubted(rig, plan)
    yield from _on_cut_off(plan, channel.misses, accuracy.caught)
    yield from _on_chaos(rig, error)
    yield from _beyond_tolerance(rig, accuracy.tessellation, error)
    yield from _on_the_mesh(rig, plan, accuracy.tessellation)
    yield from _on_rounding(plan, accuracy.rounding)
    yield from on_white(rig, plan, light)
    yield from on_black(rig, light)
    yield from on_glare(plan, channel.glare)


def _on_frame(rig: Rig, viewer: Viewer) -> Iterator[Remark]:
    """On the part of the picture that lies beyond the viewer's image, of which nothing else tells:
    the share that is covered is one of what the viewer looks at.
    """
    place = rig.picture_place
    if outline_in_view(place, viewer) is None:
        return

    frame = np.array([viewer.width, viewer.height])
    corners = viewer.project(place.mesh.corners.reshape(-1, 3))  # NaN behind the viewer
    if np.isnan(corners).any() or ((corners >= 0) & (corners <= frame)).all():
        return

    whole = areas(corners, np.arange(len(corners)).reshape(-1, 3)).sum()
    cut = 1 - cover_in_view(place, viewer).sum() / whole
    if cut > LEAST_CUT:
        yield warning(
            "The frame of the viewer '{viewer}' cuts off {share} of the picture: turn it to the"
            " picture, or give it a wider view.",
            viewer=viewer.name,
            share=percent(float(cut)),
        )


def _on_gaps(rig: Rig, plan: Plan, leaks: tuple[float, ...]) -> Iterator[Remark]:
    for glass, n_open, share in zip(rig.glasses, plan.counts.n_open, leaks, strict=True):
        if share > LEAST_LOST:
            yield warning(
                "{share} of the picture's light goes through gaps in the glass '{glass}'"
                " ({n} open edges): close them.",
                share=percent(share),
                glass=glass.name,
                n=n_open,
            )


def _on_normals(rig: Rig, plan: Plan, contradicted: tuple[float, ...]) -> Iterator[Remark]:
    parts = rig.curved_parts()
    for part, share, n in zip(parts, contradicted, plan.counts.n_contradicted, strict=True):
        if share > LEAST_CONTRADICTED:
            yield note(
                "{share} of the picture's light meets normals of '{part}' that contradict its"
                " faces, and lands elsewhere in renderers such as Cycles: mark edges there sharp"
                " (Shade Smooth by Angle), or subdivide.",
                share=percent(share),
                part=part.name,
            )
        elif n:
            yield note(
                "The normals of {n} smooth triangle{s} of '{part}' contradict the shape or"
                " are missing, so that light follows the flat facets there. Mark edges"
                " there sharp (Shade Smooth by Angle), or subdivide.",
                n=n,
                s="s" if n > 1 else "",
                part=part.name,
            )


def _on_doubted(rig: Rig, plan: Plan) -> Iterator[Remark]:
    counts = plan.counts
    parts = rig.curved_parts()

    for part, n, m in zip(parts, counts.n_doubted, counts.n_curved, strict=True):
        if n and m:
            yield note(
                "The mesh of '{part}' is too irregular or too coarse to tell the curved"
                " surface in {drawn} of its smooth faces, which are followed as drawn;"
                " {curved} are followed as curved.",
                part=part.name,
                drawn=percent(n / (n + m)),
                curved=percent(m / (n + m)),
            )
        elif n:
            yield note(
                "'{part}' is followed as drawn: its mesh is too irregular or too coarse to tell"
                " the curved surface.",
                part=part.name,
            )


def _on_cut_off(plan: Plan, misses: dict[str, float], caught: float) -> Iterator[Remark]:
    share = misses.get(REASON_WORDS[Reason.CUT_OFF], 0.0)
    most = plan.settings.max_events
    if share <= LEAST_LOST:
        return

    if caught > MOST_CAUGHT:
        yield warning(
            "{share} of the picture's light is caught in the glass, however high Max Events"
            " is: look for faces that lie in one another, or for a hollow that touches the"
            " outside.",
            share=percent(share),
        )
    else:
        yield warning(
            "{share} of the picture's light meets more than {most} surfaces and is cut off:"
            " raise Max Events.",
            share=percent(share),
            most=most,
        )


def _on_chaos(rig: Rig, error: MapError) -> Iterator[Remark]:
    if error.sampled <= BEYOND:
        return

    n = error.most_samples
    rays = (
        Message("one ray stands for a viewer pixel")
        if n == 1
        else Message("up to {n} rays stand for a viewer pixel", n=n)
    )

    text = Message(
        "Light is chaotic, or has more borders than Effort allows for, in {share} of the view:"
        " {rays} there, {n} in all. Four times the Effort takes up to four times as many rays,"
        " and up to a third off the error.",
        share=percent(error.sampled),
        rays=rays,
        n=error.n_samples,
    )

    facetted = facetted_glass(rig)
    if facetted:
        text = joined(
            [text, Message("Shade '{name}' smooth if it is meant to be curved.", name=facetted)]
        )

    yield Remark(text, is_warning=True)


def _beyond_tolerance(rig: Rig, mesh: Tessellation, error: MapError) -> Iterator[Remark]:
    beyond = error.facet_limited + error.unresolved - error.noise
    if beyond > BEYOND:
        yield warning(
            "{share} of the view is off by more than the tolerance, or lost, where it"
            " changes within a viewer pixel: {remedy}.",
            share=percent(beyond),
            remedy=remedy_for(rig, mesh, error),
        )

    if mesh.undecided > UNDECIDED:
        yield warning(
            "{share} of the light meets gaps or overlaps of glass that are thinner than the"
            " mesh's own error, and may go another way: use the same mesh for faces that"
            " touch, or move them apart.",
            share=percent(mesh.undecided),
        )


def _on_the_mesh(rig: Rig, plan: Plan, mesh: Tessellation) -> Iterator[Remark]:
    if mesh.error <= plan.settings.tolerance:
        return

    yield note(
        "The mesh costs up to about {error} display pixels, for {remedy}.",
        error=number(mesh.error),
        remedy=remedy_for_mesh(rig, plan.counts, mesh),
    )


def _on_rounding(plan: Plan, rounded: float) -> Iterator[Remark]:
    touching = plan.merge_distance
    if max(rounded, touching / display_pixel(plan.rig.display)) > LEAST_ROUNDED_PX:
        yield note(
            "Blender rounds places: landings may be off by {error} display pixels, and glass"
            " nearer than {gap} touches. Move the rig to the origin, and the origins of its"
            " objects to their middles.",
            error=number(rounded),
            gap=Length(touching),
        )
