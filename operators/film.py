"""The frame rate and the frame range of a scene, beside those of the film that is its picture."""

from math import isclose

import bpy

from ..core.base.messages import Message, as_message
from ..core.blender import plane
from ..core.blender.moving import Timing, rate_of
from . import needed, telling
from .needed import the_picture

NO_FILM = Message("The picture is not a film")


def film_shown(context: bpy.types.Context) -> tuple[bpy.types.Image, Timing] | None:
    """The film that is the picture, and when it plays; None if there is none."""
    picture = the_picture(context)
    return None if picture is None else plane.film_of(picture)


def other_rate(context: bpy.types.Context) -> Message | None:
    """A warning that the film plays at another speed in this scene; None if it does not."""
    film = film_shown(context)
    rate = rate_of(film[0]) if film else 0.0
    own = context.scene.render.fps / context.scene.render.fps_base
    if not rate or isclose(rate, own, rel_tol=1e-3):
        return None
    return Message(
        "the film '{film}' runs at {rate:.4g} frames per second and the scene at {own:.4g}, so it"
        " plays {times:.2g} times as fast; press {button} to change the scene",
        film=film[0].name,
        rate=rate,
        own=own,
        times=own / rate,
        button=as_message(KIRIKO_OT_use_film.bl_label),
    )


class KIRIKO_OT_use_film(bpy.types.Operator):
    """Give the scene the frame rate and the frame range of the film that is the picture"""

    bl_idname = "kiriko.use_film"
    bl_label = "Use Film's Rate and Range"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(cls, [] if film_shown(context) else [NO_FILM])

    def execute(self, context: bpy.types.Context) -> set[str]:
        with telling.told(self):
            image, timing = film_shown(context)
            scene = context.scene
            if rate := rate_of(image):
                scene.render.fps = max(round(rate), 1)
                scene.render.fps_base = scene.render.fps / rate
            scene.frame_start = timing.frame_start
            scene.frame_end = timing.frame_start + timing.frame_duration - 1
            telling.report(
                self,
                "INFO",
                Message(
                    "The scene runs at {rate:.4g} frames per second, from frame {first} to {last}.",
                    rate=scene.render.fps / scene.render.fps_base,
                    first=scene.frame_start,
                    last=scene.frame_end,
                ),
            )
            return {"FINISHED"}
        return {"CANCELLED"}
