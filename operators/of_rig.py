"""Operators that end later than they begin, by a dialogue or a render: meanwhile another rig may
have become the active one, since another object was selected.
"""

import bpy

from ..core.base.errors import RigError
from ..core.base.messages import as_message
from ..core.blender.rigs import rig_uid, rigs
from .choose_rig import choose


class OfRig:
    """Mix-in for an operator that ends with the scene and the rig with which it began."""

    _began_with: tuple[int, int] | None = None  # session uids of the scene and its rig

    def begin_with(self, scene: bpy.types.Scene) -> None:
        """Note the scene and its active rig."""
        self._began_with = scene.session_uid, rig_uid(scene)

    def end_with(self, context: bpy.types.Context | None = None) -> None:
        """Have that rig be the active one again; nothing where the operator only ran through.

        context : which has to show that scene; None: any

        Raises
        ------
        RigError
            The rig or the scene is gone, or another scene is shown.
        """
        if self._began_with is None:
            return
        scene, (_, uid) = self.own_scene(), self._began_with
        if context is not None and context.scene != scene:
            raise RigError(
                "{button} began in the scene '{scene}', and another one is shown: begin again.",
                button=as_message(self.bl_label),
                scene=scene.name,
            )
        if rig_uid(scene) == uid:
            return
        rig = next((rig for rig in rigs(scene) if rig.session_uid == uid), None)
        if rig is None:
            raise RigError(
                "The rig with which {button} began is gone: begin again.",
                button=as_message(self.bl_label),
            )
        choose(scene, rig)

    def own_scene(self) -> bpy.types.Scene:
        """The scene with which it began; RigError where that is gone."""
        uid = self._began_with[0]
        scene = next((scene for scene in bpy.data.scenes if scene.session_uid == uid), None)
        if scene is None:
            raise RigError(
                "The scene with which {button} began is gone: begin again.",
                button=as_message(self.bl_label),
            )
        return scene
