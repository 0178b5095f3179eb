"""Remarks on the scene as it was read."""

from collections.abc import Iterable

import bpy

from ..base.messages import Message
from .parts import Part
from .shapes import CURVED


def renders_differ(owner: bpy.types.Object, scene: bpy.types.Scene) -> bool:
    """Do modifiers make another shape in renders than in the
    viewport, whose shape is the one that is read?
    """
    return any(
        m.show_viewport != m.show_render
        or (m.show_viewport and m.type in {"SUBSURF", "MULTIRES"} and m.levels != m.render_levels)
        for m in owner.modifiers
    ) or (
        scene.render.use_simplify
        and any(m.type in {"SUBSURF", "MULTIRES"} for m in owner.modifiers)
    )


def modifier_notes(parts: list[Part]) -> list[str]:
    """Notes on curved parts whose vertices a modifier leaves beside the surface that is meant."""
    drawn = dict.fromkeys(
        (part.drawn, part.mesh.surface)
        for part in parts
        if part.role in CURVED
        and part.mesh.surface != "facets"
        and part.mesh.is_smooth is not None
        and part.drawn is not None
    )
    return [
        Message(
            "The modifier '{modifier}' of '{name}' leaves the vertices off the curved"
            " surface: {remedy}.",
            modifier=m.name,
            name=o.name,
            remedy=remedy,
        )
        for o, surface in drawn
        for m in o.modifiers
        if m.show_viewport and (remedy := remedy_of(m, surface))
    ]


def remedy_of(modifier: bpy.types.Modifier, surface: str) -> str:
    """The remedy for a modifier that leaves vertices beside the surface.

    An empty text for others.
    """
    if (
        modifier.type == "SUBSURF"
        and modifier.subdivision_type == "CATMULL_CLARK"
        and not modifier.use_limit_surface
    ):
        return Message("turn on its Use Limit Surface")

    is_collapsed = (
        modifier.type == "DECIMATE" and modifier.decimate_type == "COLLAPSE" and modifier.ratio < 1
    )
    if (modifier.type == "REMESH" or is_collapsed) and surface == "smooth":
        return Message("turn it off, or set the object's Surface to Automatic")

    return ""


def scene_notes(
    depsgraph: bpy.types.Depsgraph,
    scene: bpy.types.Scene,
    parts: list[Part],
    cameras: Iterable[bpy.types.Object],
) -> list[str]:
    """Notes on settings of the scene as a whole that Kiriko does not follow."""
    notes = []
    if depsgraph.mode == "VIEWPORT":
        notes += [
            Message(
                "'{name}' has another shape in renders than in the viewport (modifiers): using"
                " the viewport's.",
                name=o.name,
            )
            for o in dict.fromkeys(part.owner for part in parts)
            if renders_differ(o, scene)
        ]

    notes += [
        Message(
            "The viewer '{viewer}' has depth of field: solved as a pinhole.", viewer=camera.name
        )
        for camera in cameras
        if camera.type == "CAMERA" and camera.data.dof.use_dof
    ]

    return notes
