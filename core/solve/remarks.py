"""Remarks on a solution: each names a measured cause and its remedy."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from ..base.messages import Length, Message, joined
from ..base.numbers import number
from ..base.words import percent
from ..glass.meshes import find_edges, geometric_normals
from ..image.flat_picture import outline_in_view
from ..image.glare import Glare, Split
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
from .lateral_colour import Distances, LateralColour
from .solution import Remark, note, warning
from .tessellation import Tessellation
from .view_remarks import remarks_on_views

# This many edges between flat faces that meet at less than ROUND make a curved surface.
FACETTED = 64
ROUND = np.radians(12.0)


def remedy_for(rig: Rig, mesh: Tessellation, error: MapError) -> Message:
    """Remedy for a view that changes within pixels, by its cause."""
    if error.cut_off > max(error.facet_limited, error.unresolved - error.cut_off):
        return Message("raise Max Events")

    bends = error.facet_limited > error.unresolved
    if bends and mesh.cause == "jumps":
        return Message(
            "curved faces of '{name}' disagree at their edges; {remedy}",
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
    """Remedy for the tessellation error, by its cause."""
    if any(part.mesh.surface == "facets" for part in rig.curved_parts()):
        drawn = Message(
            "the glass is traced as drawn; subdivide it, or set its Surface to Automatic"
        )
    elif any(counts.n_doubted):
        drawn = Message("use a finer or more regular mesh")
    else:
        drawn = Message(
            "some normals contradict the shape; mark edges sharp there, or subdivide the glass"
        )

    remedies = {
        "drawn": drawn,
        "order": Message("subdivide the glass"),
        "straight": Message("add edge loops where smooth faces meet flat ones"),
        "jumps": Message(
            "curved faces of '{name}' disagree at their edges; {remedy}",
            name=name_of(rig, mesh.uneven),
            remedy=remedy_for_irregular(rig, mesh),
        ),
    }
    return remedies[mesh.cause]


def facetted_glass(rig: Rig) -> str:
    """Name of a glass whose facets represent a curved surface; '' if there is none."""
    return next((glass.name for glass in rig.glasses if is_facetted(glass.mesh)), "")


def remedy_for_irregular(rig: Rig, mesh: Tessellation) -> Message:
    """Remedy for an irregular mesh that is traced as curved."""
    part = rig.curved_parts()[mesh.uneven]
    if part.mesh.surface == "smooth":
        return Message("set its Surface to Automatic, or use a finer or more regular mesh")
    return Message("use a finer or more regular mesh")


def name_of(rig: Rig, part: int) -> str:
    """Name of a glass or mirror, by its number among both."""
    return rig.curved_parts()[part].name


def is_facetted(mesh: Mesh) -> bool:
    """Whether many flat faces meet at small angles, as on a curved surface that is shaded flat."""
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


# fraction of the viewer's light past the glass that is worth a remark
GLARE = 0.05
# linear: half a step of 8 bits, sRGB-encoded, above white
WHITE = ((1 + 0.5 / 255 + 0.055) / 1.055) ** 2.4


def on_white(rig: Rig, plan: Plan, light: NDArray[np.float32]) -> Iterator[Remark]:
    """Remark on light brighter than a display's white."""
    source = rig.display.source_for(light)
    if source.max() <= WHITE:
        return
    # np.max over a last axis of three is slow.
    brightest = np.maximum(np.maximum(source[..., 0], source[..., 1]), source[..., 2])
    bright = np.count_nonzero(brightest > WHITE) / max(np.count_nonzero(brightest > 0), 1)
    if not bright:
        return

    remedy = Message("lower the Picture Brightness of '{picture}'", picture=rig.picture.name)
    if plan.settings.brightness:
        remedy = Message("turn Brightness off, {remedy}", remedy=remedy)
    yield note(
        "{share} of the source image is brighter than white and will be clipped: {remedy}, or"
        " export OpenEXR.",
        share=percent(bright),
        remedy=remedy,
    )


def on_black(rig: Rig, light: NDArray[np.float32]) -> Iterator[Remark]:
    """Remark on darkness that this display cannot show."""
    black_level = rig.display.black_level
    if not black_level:
        return
    black = np.squeeze(rig.display.black_in(light), axis=-1) if len(rig.lit) > 1 else black_level

    # Pixels outside the picture are dark by intention.
    brightest = light.max(axis=2)
    n_wanted = np.count_nonzero(brightest > 0)
    n_dark = np.count_nonzero((brightest > 0) & (brightest < black))
    if n_dark:
        yield note(
            "{share} of the source image should be darker than the black of '{display}'"
            " ({black_level} of white). Raise the Picture Brightness of '{picture}', or use a"
            " display with a lower Black Level.",
            share=percent(n_dark / n_wanted),
            display=rig.display.name,
            black_level=percent(black_level),
            picture=rig.picture.name,
        )


def on_glare(plan: Plan, glare: Glare | None) -> Iterator[Remark]:
    """Remark on light past the glass."""
    if glare is None or glare.share < GLARE:
        return

    part = Message("plate") if plan.needs_plate else Message("display")
    remedy = (
        Message("cover the visible part of the {part}", part=part)
        if plan.settings.suppress_glare == 1
        else Message("raise Suppress Glare, or cover the visible part of the {part}", part=part)
    )

    yield note(
        "Glare: {share} of the viewer's light comes past the glass, {where}: {remedy}.",
        share=percent(glare.share),
        where=glare.where,
        remedy=remedy,
    )


def _on_split(split: Split | None) -> Iterator[Remark]:
    """Remark on stray light where parts split light."""
    if split is not None and split.stray >= GLARE:
        yield note(
            "{share} of the viewer's light comes by other paths than the picture's, such as a"
            " second reflection. See Simulate, or block it.",
            share=percent(split.stray),
        )


LEAST_ROUNDED_PX = 0.1  # display px of rounding error that are worth a remark
# Fraction of the picture outside the viewer's frame that is worth a remark. Along the outline of a
# picture of few pixels it is accurate to half of this.
LEAST_CUT = 0.01
LEAST_APART = 1e-3  # viewer px between colours that are worth their digits
BEYOND = 0.01  # fraction of the view that may exceed the tolerance without a remark
# Fraction of the picture's light at contradicting normals that is worth a remark. A ball has some
# along its outline.
LEAST_CONTRADICTED = 0.01
LEAST_SHOWN = 1e-6  # fraction of the picture on a display that is not dark
UNDECIDED = 0.01  # fraction of the light with an uncertain path
# fraction of the cut-off light that never leaves; above it a higher Max Events does not help
MOST_CAUGHT = 0.9


def remarks_on(
    channels: Sequence[Channel],
    light: NDArray[np.float32],
    colour: LateralColour | None = None,
) -> tuple[Remark, ...]:
    """Remarks on the channels of a solution, each sentence once.

    light : (H, W, 3) wanted of the display's pixels, linear
    colour : lateral colour; None without dispersion
    """
    remarks = list(_on_blind(channels)) if len(channels) > 1 else []
    for channel in channels:
        remarks += [remark for remark in _on_channel(channel, light) if remark not in remarks]
    plan = channels[0].plan
    remarks += _on_disagreement(plan.rig, plan.settings)
    remarks += _on_colour(colour)
    remarks += remarks_on_views(channels)
    return tuple(remarks)


def remarks_on_displays(rig: Rig, by_display: Sequence[Sequence[float]]) -> tuple[Remark, ...]:
    """Remarks on several displays and screens: what each shows, and which stay dark.

    by_display : for each channel the fraction of the picture on each; empty for a single display
    """
    if not by_display:
        return ()

    clauses = [
        Message("'{name}' {share}", name=display.name, share=percent(share))
        for display, share in zip(rig.lit, by_display[0], strict=True)
    ]
    dark = np.max(by_display, axis=0) < LEAST_SHOWN
    return (
        note("Parts of the picture by display: {shares}.", shares=joined(clauses, ", ")),
        *(
            warning(
                "'{name}' stays dark, since no viewer sees the picture on it: move it, or set its"
                " role to None.",
                name=display.name,
            )
            for display, is_dark in zip(rig.lit, dark, strict=True)
            if is_dark
        ),
    )


def _on_colour(colour: LateralColour | None) -> tuple[Remark, ...]:
    """A remark on dispersion: the number of maps, and the lateral colour."""
    if colour is None:
        return ()
    if colour.is_one_map:
        px = number(colour.apart)
        return (
            note("One map serves all colours: their light lands at most {px} px apart.", px=px),
        )
    if colour.before is None or colour.after is None:
        return ()
    return (
        note(
            "Each colour has a map of its own: with one map, red and blue would be seen up to"
            " {before} apart; now it is {after}.",
            before=_distance(colour.before),
            after=_distance(colour.after),
        ),
    )


def _distance(found: Distances) -> Message:
    """The largest distance, px, and its angle if there is one."""
    if found.largest_px < LEAST_APART:
        return Message("less than {px} px", px=number(LEAST_APART))
    px = Message("{px} px", px=number(found.largest_px))
    if found.largest_arcmin is None:
        return px
    angle = Message("{arcmin} arcmin", arcmin=number(found.largest_arcmin))
    return Message("{px} ({angle})", px=px, angle=angle)


def _on_disagreement(rig: Rig, settings: Settings) -> Iterator[Remark]:
    place = rig.picture_place
    if len(rig.viewers) < 2 or place.mesh is None or settings.disagreement != "sharp":
        return
    if not is_sharp(rig, settings):
        yield note(
            "The picture '{picture}' isn't a flat rectangle, so the viewers' pictures are blended."
            " Use a flat plane for a sharp picture.",
            picture=place.name,
        )


def _on_blind(channels: Sequence[Channel]) -> Iterator[Remark]:
    """Remarks on viewers that see nothing although others do."""
    for channel in channels:
        is_painted = channel.accuracy.leaked.get(Reason.ARRIVED, 0.0) > 0
        if channel.picture_coverage <= 0 and not is_painted:
            yield warning(
                "The viewer '{viewer}' can't see the picture: move it, or turn it off in the list"
                " of viewers.",
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
    yield from _on_split(channel.split)


def _on_frame(rig: Rig, viewer: Viewer) -> Iterator[Remark]:
    """Remark on the part of the picture outside the viewer's frame, which coverage ignores."""
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
            "The frame of the viewer '{viewer}' cuts off {share} of the picture: aim it at the"
            " picture, or widen its view.",
            viewer=viewer.name,
            share=percent(float(cut)),
        )


def _on_gaps(rig: Rig, plan: Plan, leaks: tuple[float, ...]) -> Iterator[Remark]:
    for glass, n_open, share in zip(rig.glasses, plan.counts.n_open, leaks, strict=True):
        if share > LEAST_LOST:
            yield warning(
                "{share} of the picture's light leaks through gaps in '{glass}' ({n} open edges)."
                " Close them.",
                share=percent(share),
                glass=glass.name,
                n=n_open,
            )


def _on_normals(rig: Rig, plan: Plan, contradicted: tuple[float, ...]) -> Iterator[Remark]:
    parts = rig.curved_parts()
    for part, share, n in zip(parts, contradicted, plan.counts.n_contradicted, strict=True):
        if share > LEAST_CONTRADICTED:
            yield note(
                "{share} of the picture's light hits normals of '{part}' that contradict its"
                " faces; renderers such as Cycles bend it differently. Mark edges sharp (Shade"
                " Smooth by Angle), or subdivide.",
                share=percent(share),
                part=part.name,
            )
        elif n:
            yield note(
                "The normals of {n} smooth triangle{s} of '{part}' are missing or contradict the"
                " shape, so flat facets are traced. Mark edges sharp (Shade Smooth by Angle), or"
                " subdivide.",
                n=n,
                s="s" if n > 1 else "",
                part=part.name,
            )


def _on_doubted(rig: Rig, plan: Plan) -> Iterator[Remark]:
    counts = plan.counts
    parts = rig.curved_parts()

    for part, n, m in zip(parts, counts.n_doubted, counts.n_curved, strict=True):
        if n:
            yield note(
                "The mesh of '{part}' is too irregular or coarse for a curved surface: {drawn} of"
                " its smooth faces are traced as drawn.",
                part=part.name,
                drawn=percent(n / (n + m)),
            )


def _on_cut_off(plan: Plan, misses: dict[str, float], caught: float) -> Iterator[Remark]:
    share = misses.get(REASON_WORDS[Reason.CUT_OFF], 0.0)
    most = plan.settings.max_events
    if share <= LEAST_LOST:
        return

    if caught > MOST_CAUGHT:
        yield warning(
            "{share} of the picture's light never leaves the glass. Check for overlapping faces,"
            " or for a hollow that touches the outside.",
            share=percent(share),
        )
    else:
        yield warning(
            "{share} of the picture's light needs more than {most} events and is cut off: raise"
            " Max Events.",
            share=percent(share),
            most=most,
        )


def _on_chaos(rig: Rig, error: MapError) -> Iterator[Remark]:
    if error.sampled <= BEYOND:
        return

    text = Message(
        "{share} of the view is undersampled, with up to {n} rays a pixel. Raise Effort: four"
        " times as much removes up to a third of the error and traces up to four times as many"
        " rays.",
        share=percent(error.sampled),
        n=error.most_samples,
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
            "{share} of the view exceeds the tolerance or is lost, because the light's path"
            " changes within a pixel: {remedy}.",
            share=percent(beyond),
            remedy=remedy_for(rig, mesh, error),
        )

    if mesh.undecided > UNDECIDED:
        yield warning(
            "{share} of the light crosses gaps or overlaps thinner than the mesh's error, so its"
            " path is uncertain. Use identical faces where glass touches, or move the glass apart.",
            share=percent(mesh.undecided),
        )


def _on_the_mesh(rig: Rig, plan: Plan, mesh: Tessellation) -> Iterator[Remark]:
    if mesh.error <= plan.settings.tolerance:
        return

    yield note(
        "The mesh causes errors of up to about {error} display pixels: {remedy}.",
        error=number(mesh.error),
        remedy=remedy_for_mesh(rig, plan.counts, mesh),
    )


def _on_rounding(plan: Plan, rounded: float) -> Iterator[Remark]:
    touching = plan.merge_distance
    if max(rounded, touching / display_pixel(plan.rig.display)) > LEAST_ROUNDED_PX:
        yield note(
            "Blender rounds coordinates: landings may be off by {error} display pixels, and glass"
            " closer than {gap} counts as touching. Move the rig to the world origin, and object"
            " origins to their geometry.",
            error=number(rounded),
            gap=Length(touching),
        )
