"""Simulate: the viewer's image of the source image, with all effects of the plate's mirrors."""

from collections.abc import Generator
from dataclasses import replace

import bpy
import numpy as np

from ..core.base.errors import RigError
from ..core.base.messages import Message, joined
from ..core.base.numbers import number
from ..core.base.words import percent
from ..core.blender.data.image import pixels_from_image
from ..core.blender.data.rigs import name_of_view
from ..core.blender.data.stored_records import Sentences
from ..core.blender.result.write_result import replace_image
from ..core.image.simulation import OTHER_PATH, Simulation, simulate_colours
from ..core.light.plan import Plan
from ..core.light.plate import STRAY_PATHS, PlatePath
from ..core.rig.joined_display import sections_of, size_of
from ..core.rig.rig import Rig
from ..core.rig.settings import Settings
from ..core.solve.channel import channel_keys
from . import long_work, needed, watch, work
from .windows import show_image

NAME = "Kiriko Seen"


class KIRIKO_OT_simulate(long_work.LongWork, bpy.types.Operator):
    """Simulate the view with all stray light, dimness and blur of plates and half mirrors"""

    bl_idname = "kiriko.simulate"
    bl_label = "Simulate"
    bl_options = {"REGISTER", "UNDO"}

    samples: bpy.props.IntProperty(
        name="Samples",
        description="Rays per pixel. Four times as many halve the noise",
        default=16,
        min=2,
        max=65536,
    )

    diffraction: bpy.props.BoolProperty(
        name="Diffraction",
        description="Include the blur by diffraction at the mirrors of plates",
        default=True,
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        scene = context.scene
        reasons = (
            needed.unsolved(scene) + needed.missing_parts(scene) + needed.no_stray_light(scene)
        )
        return needed.can_run(cls, reasons)

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        scene = context.scene
        rig = work.read(context).rig
        source = scene.kiriko.result.source
        is_changed = watch.has_changed(context)
        rig.check()

        if tuple(source.size) != size_of(sections_of(rig.outputs)):
            raise RigError(
                "The source image has {width} x {height} pixels, but '{display}' has"
                " {display_width} x {display_height}: solve again.",
                width=source.size[0],
                height=source.size[1],
                display=rig.display.name,
                display_width=rig.display.width,
                display_height=rig.display.height,
            )

        width, height = rig.display.image_size
        shown = pixels_from_image(source)[:height, :width]
        yield 0.0
        plans = plans_to_simulate(rig, work.settings_of(scene))
        found = yield from simulate_colours(plans, shown, self.samples, self.diffraction)
        result = scene.kiriko.result
        name = name_of_view(scene, NAME, rig)
        result.seen = image = replace_image(result.seen, name, found.image)
        show_image(image, result)
        text = Message(
            "The image '{image}' shows what the viewer sees{more}.",
            image=image.name,
            more=simulation_report(found, rig),
        )
        result.seen_summary = text
        earlier = Sentences.read(result.sentences).by_text
        result.sentences = Sentences({**earlier, str(text): text}).text()
        if not is_changed:
            return text

        self.level = "WARNING"
        return joined([text, watch.CHANGED])


def plans_to_simulate(rig: Rig, settings: Settings) -> list[Plan]:
    """Plans of the first viewer with Brightness, one for each colour that glass treats in its own
    way.
    """
    bright = replace(settings, brightness=True)
    keys = channel_keys(replace(rig, viewers=rig.viewers[:1]), bright)
    return [work.session().plan(rig, key.of(bright)) for key in keys]


def simulation_report(found: Simulation, rig: Rig) -> str:
    """Fractions of stray light, and the noise."""
    whole = sum(found.luminance[path] for path in PlatePath)
    if not whole:
        return Message(": nothing")

    parts = {Message("by other paths than the picture's"): (OTHER_PATH,)}
    if rig.plates:
        parts[Message("stray light of the plate")] = STRAY_PATHS
        parts[Message("past the plate")] = (PlatePath.NONE,)
    words = []

    for word, paths in parts.items():
        light = sum(found.luminance[path] for path in paths)
        error = np.linalg.norm([found.luminance_error[path] for path in paths])

        if light > 0:
            words.append(
                Message(
                    "{share} (+- {error}) of it {word}",
                    share=percent(light / whole),
                    error=percent(float(error) / whole),
                    word=word,
                )
            )

    words.append(Message("noise {error} of white", error=number(found.error)))
    return joined(["", *words], ", ")
