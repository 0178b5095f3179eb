"""Remarks on a solution: each names the cause that was measured, and a remedy for it."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..glass.meshes import SAME_NORMAL, find_edges, geometric_normals
from ..image.glare import Glare
from ..light.display import display_pixel
from ..light.landings import REASON_WORDS, Reason
from ..light.plan import Plan
from ..map.view_map import MapError
from ..rig import Mesh, Rig
from ..words import millimetres, number, percent
from .channel import Channel
from .tessellation import COARSE, Tessellation

# share of the picture's light: less that goes through gaps or is cut off is not worth a remark
LEAST_LOST = 1e-3
ROUNDED = 0.1  # display px: where rounding may do more than this it is worth a remark
BEYOND = 0.01  # share of what is seen that may be off by more than the tolerance without a remark
UNDECIDED = 0.01  # share of the light whose way may be another one
# edges between flat faces that meet at less than ROUND: so many stand for a curved surface
FACETTED = 64
ROUND = np.radians(12.0)
# of the light that is cut off: where more never comes free, to raise the limit does not help
MOST_CAUGHT = 0.9
# of the light that the viewer gets: more that comes beside the glass is worth a remark
GLARE = 0.05
# linear: half a step of 8 bits, sRGB-encoded, above white
WHITE = ((1 + 0.5 / 255 + 0.055) / 1.055) ** 2.4


@dataclass(frozen=True)
class Remark:
    """A note to the user.

    text : with {} where the length stands
    is_warning : does it tell of light that is lost or goes another way?
    length : m
    """

    text: str
    is_warning: bool = False
    length: float | None = None

    def told(self, length_text: Callable[[float], str] = millimetres) -> str:
        """The sentence, with the length in words as a function of metres has it."""
        return (
            self.text if self.length is None else self.text.replace("{}", length_text(self.length))
        )


def remarks_on(channels: Sequence[Channel], source: NDArray[np.float32]) -> tuple[Remark, ...]:
    """Remarks on the channels of a solution, each sentence once.

    source : (H, W, 3) linear
    """
    remarks: list[Remark] = []
    for channel in channels:
        remarks += [remark for remark in _on_channel(channel, source) if remark not in remarks]
    return tuple(remarks)


def _on_channel(channel: Channel, source: NDArray[np.float32]) -> Iterator[Remark]:
    """Remarks on one channel, the gravest first."""
    plan = channel.plan
    rig = plan.rig
    accuracy = channel.accuracy
    error = channel.map_error
    yield from _on_gaps(rig, plan, accuracy.leaks)
    yield from _on_normals(rig, plan)
    yield from _on_doubted(rig, plan)
    yield from _on_cut_off(plan, channel.misses, accuracy.caught)
    yield from _on_chaos(rig, plan, error)
    yield from _beyond_tolerance(rig, accuracy.tessellation, error)
    yield from _on_the_mesh(rig, plan, accuracy.tessellation)
    yield from _on_rounding(plan, accuracy.rounding)
    yield from _on_white(rig, plan, source)
    yield from _on_glare(plan, channel.glare)


def _on_gaps(rig: Rig, plan: Plan, leaks: tuple[float, ...]) -> Iterator[Remark]:
    for glass, n_open, share in zip(rig.glasses, plan.n_open, leaks, strict=True):
        if share > LEAST_LOST:
            yield Remark(
                f"{percent(share)} of the picture's light goes through gaps in the glass"
                f" '{glass.name}' ({n_open} open edges): close them.",
                is_warning=True,
            )


def _on_normals(rig: Rig, plan: Plan) -> Iterator[Remark]:
    for part, n in zip((*rig.glasses, *rig.mirrors), plan.n_contradicted, strict=True):
        if n:
            faces = f"{n} smooth triangle{'s' if n > 1 else ''} of '{part.name}'"
            yield Remark(
                f"The normals of {faces} contradict the shape or are missing: followed flat. Mark"
                " edges there sharp (Shade Smooth by Angle), or subdivide."
            )


def _on_doubted(rig: Rig, plan: Plan) -> Iterator[Remark]:
    for part, n, m in zip((*rig.glasses, *rig.mirrors), plan.n_doubted, plan.n_curved, strict=True):
        why = "too irregular or too coarse to tell the curved surface"
        if n and m:
            drawn, curved = (percent(share / (n + m)) for share in (n, m))
            yield Remark(
                f"'{part.name}' is followed as drawn where its mesh is {why}: {drawn};"
                f" {curved} as curved."
            )
        elif n:
            yield Remark(f"'{part.name}' is followed as drawn: its mesh is {why}.")


def _on_cut_off(plan: Plan, misses: dict[str, float], caught: float) -> Iterator[Remark]:
    share = misses.get(REASON_WORDS[Reason.CUT_OFF], 0.0)
    most = plan.settings.max_events
    if share <= LEAST_LOST:
        return
    if caught > MOST_CAUGHT:
        text = (
            f"{percent(share)} of the picture's light is caught in the glass, however high Max"
            " Events is: look for faces of it that lie in one another, or for a hollow that"
            " touches its outside."
        )
    else:
        text = (
            f"{percent(share)} of the picture's light meets more than {most} surfaces and is cut"
            f" off: raise Max Events."
        )
    yield Remark(text, is_warning=True)


def _on_chaos(rig: Rig, plan: Plan, error: MapError) -> Iterator[Remark]:
    if error.sampled > BEYOND:
        n = plan.settings.samples_along**2
        rays = (
            "one ray stands for a viewer pixel"
            if n == 1
            else f"up to {n} rays stand for a viewer pixel"
        )
        text = (
            f"Light is chaotic in {percent(error.sampled)} of what is seen: {rays} there,"
            f" {error.n_samples} in all. Four times the Effort takes four times as many, and"
            f" halves their noise."
        )
        smooth = _to_shade_smooth(rig)
        if smooth:
            text += f" {smooth[0].upper()}{smooth[1:]}."
        yield Remark(text, is_warning=True)


def _beyond_tolerance(rig: Rig, mesh: Tessellation, error: MapError) -> Iterator[Remark]:
    beyond = error.facet_limited + error.unresolved - error.noise
    if beyond > BEYOND:
        yield Remark(
            f"{percent(beyond)} of what is seen is off by more than the tolerance, or lost, where"
            f" the view through the"
            f" glass changes within a viewer pixel: {_remedy(rig, mesh, error)}.",
            is_warning=True,
        )
    if mesh.undecided > UNDECIDED:
        yield Remark(
            f"{percent(mesh.undecided)} of the light meets gaps or overlaps of glass that are"
            " thinner than its mesh is exact, and may go another way: use the same mesh for"
            " faces that touch, or move them apart.",
            is_warning=True,
        )


def _remedy(rig: Rig, mesh: Tessellation, error: MapError) -> str:
    """The remedy for a view that changes within pixels, by the cause."""
    if error.cut_off > max(error.facet_limited, error.unresolved - error.cut_off):
        return "raise Max Events"
    bends = error.facet_limited > error.unresolved
    if bends and mesh.cause == "jumps" and mesh.jumps > COARSE:
        return (
            f"the faces of '{_name(rig, mesh.uneven)}' contradict each other:"
            f" {_for_irregular(rig, mesh)}"
        )
    if bends and mesh.error > 0:
        return "use a finer mesh, or raise the viewer's resolution"
    smooth = _to_shade_smooth(rig)
    return (
        f"{smooth}, or raise the viewer's resolution" if smooth else "raise the viewer's resolution"
    )


def _to_shade_smooth(rig: Rig) -> str:
    """The remedy where the facets of a glass stand for a curved surface.

    Nothing where there is none.
    """
    facetted = next((glass for glass in rig.glasses if is_facetted(glass.mesh)), None)
    return "" if facetted is None else f"shade '{facetted.name}' smooth if it is meant to be curved"


def _for_irregular(rig: Rig, mesh: Tessellation) -> str:
    """The remedy for an irregular mesh that is followed as curved."""
    part = (*rig.glasses, *rig.mirrors)[mesh.uneven]
    change = "set its Surface to Automatic, or " if part.mesh.surface == "smooth" else ""
    return f"{change}give it a finer or a more regular mesh"


def _name(rig: Rig, part: int) -> str:
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


def _on_the_mesh(rig: Rig, plan: Plan, mesh: Tessellation) -> Iterator[Remark]:
    if mesh.error <= COARSE:
        return
    if any(part.mesh.surface == "facets" for part in (*rig.glasses, *rig.mirrors)):
        drawn = "it is followed as drawn: subdivide the glass, or set its Surface to Automatic"
    elif any(plan.n_doubted):
        drawn = (
            "it is followed as drawn where it is irregular or coarse: use a finer or a more"
            " regular mesh"
        )
    else:
        drawn = "normals contradict its shape: mark edges sharp there, or subdivide the glass"
    remedies = {
        "drawn": drawn,
        "order": "it is coarse: subdivide the glass",
        "straight": "its edges are straight where smooth faces meet flat ones: add loops near them",
        "jumps": f"the curved faces of '{_name(rig, mesh.uneven)}' contradict each other at their"
        f" edges:"
        f" {_for_irregular(rig, mesh)}",
    }
    yield Remark(
        f"The mesh costs up to about {number(mesh.error)} display pixels, for"
        f" {remedies[mesh.cause]}."
    )


def _on_rounding(plan: Plan, rounded: float) -> Iterator[Remark]:
    touching = plan.merge_distance
    if max(rounded, touching / display_pixel(plan.rig.display)) > ROUNDED:
        yield Remark(
            f"Blender rounds places: landings may be off by {number(rounded)} display pixels, and"
            f" glass nearer than"
            " {} touches. Move the rig to the origin, and the origins of its objects to their"
            " middles.",
            length=touching,
        )


def _on_white(rig: Rig, plan: Plan, source: NDArray[np.float32]) -> Iterator[Remark]:
    # rows of three are slow
    brightest = np.maximum(np.maximum(source[..., 0], source[..., 1]), source[..., 2])
    bright = np.count_nonzero(brightest > WHITE) / max(np.count_nonzero(brightest > 0), 1)
    if bright > 0:
        others = "turn Brightness off, " if plan.settings.brightness else ""
        yield Remark(
            f"{percent(bright)} of the source image is brighter than a display's white and would"
            f" be clipped: {others}make the image of '{rig.picture.name}' darker in an image"
            " editor, or export OpenEXR, which keeps it."
        )


def _on_glare(plan: Plan, glare: Glare | None) -> Iterator[Remark]:
    if glare is None or glare.share < GLARE:
        return
    cover = "cover what is seen of the plate there"
    remedy = cover if plan.settings.suppress_glare == 1 else f"raise Suppress Glare, or {cover}"
    yield Remark(
        f"Glare: {percent(glare.share)} of the light that the viewer gets comes beside the glass,"
        f" {glare.where}: {remedy}."
    )
