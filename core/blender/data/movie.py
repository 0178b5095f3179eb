"""Movies from image files, with Blender's encoder. A scene of its own keeps the files' values
unchanged.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy

from ...base.errors import ImageError
from ...base.messages import Message
from .image import loaded
from .reports import said_by
from .temporary import mark

VIEW_TRANSFORMS = ("Standard", "Raw")  # leave encoded values unchanged
TEXT_SIZE = 0.05  # of the height of a test card


@dataclass(frozen=True)
class Codec:
    """A video codec with its container.

    label : common name
    code, container : Blender's names
    across, down : divisors of width and height
    """

    label: str
    code: str
    container: str
    suffix: str
    across: int = 2
    down: int = 2


CODECS = {
    "H264": Codec("H.264", "H264", "MPEG4", ".mp4"),
    "H265": Codec("H.265", "H265", "MPEG4", ".mp4"),
    "AV1": Codec("AV1", "AV1", "MPEG4", ".mp4"),
    "PRORES": Codec("ProRes", "PRORES", "QUICKTIME", ".mov", down=1),
    "FFV1": Codec("FFV1", "FFV1", "MKV", ".mkv", across=1, down=1),
}


@dataclass(frozen=True)
class Card:
    """A test card at the start of a movie.

    file : its image
    n : its number of frames
    lines : text over it
    """

    file: Path
    n: int
    lines: tuple[str, ...]


def available() -> tuple[str, ...]:
    """The codecs that this Blender can encode."""
    if not bpy.app.build_options.codec_ffmpeg:
        return ()
    supported = bpy.types.FFmpegSettings.bl_rna.properties["codec"].enum_items
    return tuple(name for name, codec in CODECS.items() if codec.code in supported)


def check(name: str, size: tuple[int, int]) -> None:
    """Raise ImageError if this Blender cannot encode images of a size (w, h) with a codec."""
    codec = CODECS[name]
    there = available()
    if name not in there:
        listed = ", ".join(CODECS[other].label for other in there)
        remedy = (
            Message("choose {listed}", listed=listed)
            if there
            else Message("use Blender from blender.org")
        )
        raise ImageError(
            "This Blender cannot encode {codec}: {remedy}.", codec=codec.label, remedy=remedy
        )

    if size[0] % codec.across or size[1] % codec.down:
        fits = [
            CODECS[other].label
            for other in there
            if not (size[0] % CODECS[other].across or size[1] % CODECS[other].down)
        ]
        raise ImageError(
            "{codec} cannot encode the odd size {width} x {height} pixels. Choose {others}, or"
            " change the display's resolution.",
            codec=codec.label,
            width=size[0],
            height=size[1],
            others=", ".join(fits),
        )


def encode(
    path: Path,
    files: Sequence[Path],
    name: str,
    size: tuple[int, int],
    like: bpy.types.Scene,
    card: Card | None = None,
) -> None:
    """Write a movie of image files (PNG or TIFF) in one folder, one frame each.

    Parameters
    ----------
    path : a new file, alone in its folder
    name : a key of CODECS
    size : width and height of the files, px
    like : the scene with the frame rate
    card : shown first

    Raises
    ------
    ImageError
        The movie cannot be written, or has too few frames.
    """
    check(name, size)
    n = len(files) + (0 if card is None else card.n)
    scene = mark(bpy.data.scenes.new("Kiriko Movie"))
    try:
        _set_render(scene, like, size, n)
        _set_format(scene.render.image_settings, scene.render.ffmpeg, CODECS[name])
        _set_colours(scene)
        _fill(scene, files, card, size)
        # Blender would replace # in a file name by digits of the frame
        made = path.with_name(f"movie{path.suffix}")
        scene.render.filepath = _as_it_is(made)
        bpy.ops.render.render(animation=True, scene=scene.name)
        if made.exists():
            made.rename(path)
    except RuntimeError as reason:  # Blender's reports
        why = said_by(reason).rstrip(".")
        raise ImageError(
            "The movie '{path}' cannot be written ({why}). Check the disk, or choose another"
            " codec.",
            path=path,
            why=why,
        ) from None
    finally:
        bpy.data.scenes.remove(scene)

    found = n_frames(path)
    if found != n:
        raise ImageError(
            "The movie '{path}' has {found} of {n} frames. Check the disk.",
            path=path,
            found=found,
            n=n,
        )


def _as_it_is(path: Path) -> str:
    """A path with braces escaped, which Blender from 4.5 on would read as templates."""
    text = str(path)
    if bpy.app.version < (4, 5, 0):
        return text
    return text.replace("{", "{{").replace("}", "}}")


def n_frames(path: Path) -> int:
    """The number of frames of a movie, 0 if it cannot be read."""
    with loaded(path) as image:
        is_movie = image is not None and image.source == "MOVIE" and min(image.size) > 0
        return image.frame_duration if is_movie else 0


def _set_render(
    scene: bpy.types.Scene, like: bpy.types.Scene, size: tuple[int, int], n: int
) -> None:
    """Frames, frame rate and pixels."""
    scene.frame_start, scene.frame_end, scene.frame_step = 1, n, 1
    render = scene.render
    render.fps, render.fps_base = like.render.fps, like.render.fps_base
    render.resolution_x, render.resolution_y = size
    render.resolution_percentage = 100
    render.pixel_aspect_x = render.pixel_aspect_y = 1.0
    render.use_sequencer, render.use_compositing = True, False
    render.use_border = render.use_stamp = render.use_file_extension = False
    render.dither_intensity = 0.0


def _set_format(form: Any, ffmpeg: Any, codec: Codec) -> None:
    """Container, codec and quality."""
    if hasattr(form, "media_type"):  # from 5.0 on it limits the formats
        form.media_type = "VIDEO"
    form.file_format = "FFMPEG"
    form.color_mode = "RGB"
    ffmpeg.format, ffmpeg.codec = codec.container, codec.code
    ffmpeg.constant_rate_factor = "PERC_LOSSLESS"
    ffmpeg.ffmpeg_preset = "GOOD"
    if codec.code == "PRORES":
        # Blender's default is Proxy, the coarsest; only 4444 keeps each pixel's colour
        ffmpeg.ffmpeg_prores_profile = "4444"
    ffmpeg.audio_codec = "NONE"


def _set_colours(scene: bpy.types.Scene) -> None:
    """Keep the values, which are already encoded for the display."""
    view = scene.view_settings
    for name in VIEW_TRANSFORMS:
        with suppress(TypeError):  # missing in a custom colour configuration
            view.view_transform = name
            break
    view.exposure, view.gamma, view.use_curve_mapping = 0.0, 1.0, False
    with suppress(TypeError):
        view.look = "None"


def _fill(
    scene: bpy.types.Scene, files: Sequence[Path], card: Card | None, size: tuple[int, int]
) -> None:
    """Add strips of all images, and of the card, to a scene's sequencer."""
    editor = scene.sequence_editor_create()
    strips = editor.strips if hasattr(editor, "strips") else editor.sequences  # until 4.3
    space = scene.sequencer_colorspace_settings.name
    first = 1
    if card is not None:
        first += card.n
        _add_images(strips, space, "card", [card.file], 1, card.n)
        for k, line in enumerate(card.lines):
            _add_text(strips, line, k, card.n, size[1])
    _add_images(strips, space, "frames", files, first, len(files))


def _add_images(
    strips: Any, space: str, name: str, files: Sequence[Path], first: int, n: int
) -> None:
    """Add files of one folder in sequence, n frames in all; a single file lasts for all of them.

    space : the sequencer's own colour space, which avoids a conversion
    """
    strip = strips.new_image(name, str(files[0]), channel=1, frame_start=first)
    for file in files[1:]:
        strip.elements.append(file.name)
    # renamed in 5.2
    setattr(strip, "duration" if hasattr(strip, "duration") else "frame_final_duration", n)
    with suppress(TypeError):  # the space has no name
        strip.colorspace_settings.name = space


def _add_text(strips: Any, line: str, k: int, n: int, height: int) -> None:
    """Write a line over the card: the k-th from the top."""
    length = {"length": n} if bpy.app.version >= (5, 0, 0) else {"frame_end": 1 + n}
    text = strips.new_effect(f"line {k}", "TEXT", channel=2 + k, frame_start=1, **length)
    text.text = line
    text.font_size = TEXT_SIZE * height
    text.location = (0.5, 0.6 - 1.6 * TEXT_SIZE * k)
    text.use_box = True
    text.box_color = (0.0, 0.0, 0.0, 1.0)
