"""Render pictures: another scene, as each viewer sees it, is what this viewer shall see."""

from collections.abc import Generator

import bpy

from ..core.base.errors import RigError
from ..core.base.messages import Message
from ..core.blender.scene import read_viewers
from ..core.blender.viewer import frame_of, seats_of
from ..core.blender.viewer_render import eye_of, remove_unused, render_for
from ..core.rig.viewers import check_together
from . import needed, viewer_images
from .long_work import LongWork

NO_OTHER = Message("There is no other scene: make one of what the viewers shall see")


class KIRIKO_OT_render_pictures(LongWork, bpy.types.Operator):
    """Render another scene from a copy of each viewer's camera: each viewer shall see its own"""

    bl_idname = "kiriko.render_pictures"
    bl_label = "Render Pictures"
    bl_options = {"REGISTER", "UNDO"}

    scene: bpy.props.StringProperty(
        name="Scene",
        description="The scene that is rendered, by its own settings; empty: the only other one",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        missing = [] if len(bpy.data.scenes) > 1 else [NO_OTHER]
        if not seats_of(context.scene):
            missing.append(needed.NEEDED["VIEWER"])
        return needed.can_run(cls, missing)

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        scene, other = context.scene, self._other(context.scene)
        context.view_layer.update()
        depsgraph = context.evaluated_depsgraph_get()
        # refuses those that are none, or twice there
        check_together(read_viewers(depsgraph, scene), (), has_mirrors=True)
        eyes = [eye_of(one.camera, depsgraph) for one in seats_of(scene)]

        images: dict[str, bpy.types.Image] = {}
        is_done = False
        try:
            yield 0.0
            for n, eye in enumerate(eyes):
                image = render_for(other, eye, frame_of(eye.camera, scene.render))
                images[eye.camera.name] = image
                yield (n + 1) / len(eyes)
            _replace(scene, images)
            is_done = True
        finally:
            if not is_done:
                bpy.data.batch_remove(list(images.values()))

        return Message(
            "Viewers that see '{scene}' now, each as rendered from its camera: {n}.",
            n=len(images),
            scene=other.name,
        )

    def _other(self, scene: bpy.types.Scene) -> bpy.types.Scene:
        """The scene to be rendered; RigError where none is meant, or it cannot be changed."""
        others = [one for one in bpy.data.scenes if one != scene]
        found = [one for one in others if one.name == self.scene] if self.scene else others
        if len(found) != 1:
            raise RigError(
                "Which scene the viewers shall see is not clear: name one of the other {n}.",
                n=len(others),
            )
        if not found[0].is_editable:
            raise RigError("{reason}.", reason=needed.LINKED)
        return found[0]


def _replace(scene: bpy.types.Scene, images: dict[str, bpy.types.Image]) -> None:
    """Give viewers their images; those that were rendered before, also for eyes that are
    gone, go, if nobody else has them.
    """
    viewer_images.give(scene, images)
    remove_unused()
    for name, image in images.items():
        image.name = name
