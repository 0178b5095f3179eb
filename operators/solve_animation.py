"""Solve Animation and Export Movie: the source images of all frames, as files or as a movie."""

from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy

from ..core.base.errors import ImageError, RigError
from ..core.base.messages import Message, joined
from ..core.blender.frames import folder_of, frame_files, frames_of_range
from ..core.blender.paths import absolute
from ..core.files.frame_list import frames_of
from . import choose_picture, folder, frames, long_work, needed, telling, windows
from .export import unwritable, use_bundled_modules


class OfFrames(long_work.LongWork):
    """Mix-in for an operator that solves an animation's frames."""

    bl_options = {"REGISTER"}

    frames: bpy.props.StringProperty(
        name="Frames",
        description="Numbers and ranges, such as 1-250:2 or 1,5,10-20; empty: the scene's range and"
        " step",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(
            cls, needed.lacking(context.scene) + unwritable(context.scene.kiriko.export_format)
        )

    @contextmanager
    def run_of(self, context: bpy.types.Context) -> Iterator[frames.Run]:
        """The frames that are asked for, and their folder, which goes again if it stays empty."""
        if any(window.screen.is_animation_playing for window in windows.all_windows()):
            raise RigError("The playback sets frames, too: stop it first.")
        scene = context.scene
        ours = scene.kiriko
        if not Path(ours.animation_path).name:
            raise ImageError(
                "The frames have no name: choose a file, such as //frames/source_####."
            )

        use_bundled_modules()
        numbers = frames_of(self.frames) if self.frames else frames_of_range(scene)
        path = absolute(ours.animation_path)
        place = folder_of(scene, ours.animation_path)
        files = frame_files(scene, place, path.name, ours.export_format, numbers)
        self.tally = frames.Tally()
        with folder.made(place):
            yield frames.Run(
                files, ours.export_format, ours.animation_anew, ours.animation_placeholders
            )

    def _stopped(self) -> set[str]:
        text = Message("Stopped; frames written: {n}.", n=self.tally.written)
        telling.report(self, "INFO", text)
        return {"CANCELLED"}


class KIRIKO_OT_solve_animation(OfFrames, bpy.types.Operator):
    """Write the source image of each frame to a file of its own, whatever moves"""

    bl_idname = "kiriko.solve_animation"
    bl_label = "Solve Animation"

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        with self.run_of(context) as run:
            yield from frames.solved(context, run, self.tally)
            self.level = "WARNING" if self.tally.failed or self.tally.of_movies else "INFO"
            return self.tally.told(next(iter(run.files.values())).parent)


class KIRIKO_OT_export_movie(OfFrames, bpy.types.Operator):
    """Make a movie of the animation's frames, by Blender's encoder"""

    bl_description = (
        "Make a movie of the animation's frames, by Blender's encoder, in the display's pixels and"
        " the scene's frame rate. Frames that are not there are solved first"
    )
    bl_idname = "kiriko.export_movie"
    bl_label = "Export Movie"

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        ours = context.scene.kiriko
        if not Path(ours.movie_path).name:
            raise ImageError("The movie has no path: choose a file.")
        wish = frames.Wish(
            absolute(ours.movie_path), ours.movie_codec, ours.movie_card, ours.export_overwrite
        )
        with self.run_of(context) as run, folder.made(wish.file.parent):
            yield from frames.made(context, run, wish, self.tally, Message("set Overwrite"))
            remarks = self.tally.of_movies
            if warning := choose_picture.other_rate(context):
                remarks.append(Message("But {warning}.", warning=warning))
            self.level = "WARNING" if remarks else "INFO"
            return joined([frames.told(wish, run), *remarks])
