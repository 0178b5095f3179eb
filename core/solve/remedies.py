"""Remedies for a mesh that limits the result, by the cause that was measured."""

import numpy as np

from ..base.messages import Message
from ..base.words import percent
from ..glass.meshes import find_edges, geometric_normals
from ..light.plan import Counts
from ..map.view_map import MapError
from ..rig.mesh import SAME_NORMAL
from ..rig.rig import Mesh, Rig
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
        "coarse": remedy_for_coarse(rig, mesh),
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


def remedy_for_coarse(rig: Rig, mesh: Tessellation) -> Message:
    """The remedy for a mesh that is too coarse to tell which surface was meant."""
    return Message(
        "'{name}' is too coarse to tell which surface was meant: Smooth and As Drawn land light"
        " about as far apart, and send {share} of it another way. Give it more faces, or compare"
        " both",
        name=name_of(rig, mesh.coarse.part),
        share=percent(mesh.coarse.elsewhere),
    )


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
