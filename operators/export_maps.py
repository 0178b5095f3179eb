"""Export of maps: files with which other programs warp any picture or film for the display."""

import json
import sys
from collections.abc import Callable, Generator
from contextlib import ExitStack
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import bpy

from ..core.base.errors import ImageError
from ..core.base.fingerprint import fingerprint
from ..core.base.messages import Message, joined
from ..core.base.numbers import number
from ..core.base.steps import subprogress
from ..core.blender.data.paths import absolute
from ..core.files import disk, image_io
from ..core.lab.farm import extension
from ..core.lab.warp.map_files import (
    CONVENTION,
    MOST_OVERSCAN,
    SIDECAR,
    TIMES,
    MapOptions,
    check_memory,
    description,
    earlier_files,
    maps_of,
    memory_needed,
    names_of,
    remove_earlier,
    suffixes,
    wavelengths_for,
    write_maps,
)
from ..core.rig.joined_display import sections_of
from ..core.rig.rig import Rig
from ..core.rig.settings import Settings
from . import folder, needed, work
from .export import use_bundled_modules
from .to_file import IntoFolder
from .wrapping import sentence

ABOUT = "Kiriko: the position in the picture that each pixel shows; s, t from the lower left"
SOLVED, MAPPED = 0.4, 0.95  # progress, approximate
FORMAT_ITEMS = (
    (
        "EXR",
        "OpenEXR",
        "warp.exr and view.exr, 32-bit: for Nuke, Natron, Fusion, TouchDesigner and Map UV",
    ),
    (
        "FFMPEG",
        "ffmpeg",
        "x.pgm and y.pgm for ffmpeg's filter remap, with the command in maps.json",
    ),
    ("OBJ", "OBJ Mesh", "warp.obj: the display's plane with the places in the picture as its UV"),
    ("DATA", "Warp Mesh .data", "warp.data: Paul Bourke's format, a regular grid"),
    ("NPZ", "OpenCV", "warp.npz: map_x and map_y for cv2.remap"),
    ("PNG", "16-bit PNG", "warp.png: red and green are the place; for programs that read no EXR"),
)


def exported(
    context: bpy.types.Context, target: Path, options: MapOptions, overwrite: bool, remedy: str
) -> Generator[float, None, dict[str, Any]]:
    """Write the maps of the scene's rig to a folder, all or none.

    Yields progress 0..1, returns the contents of maps.json; `remedy` ends the sentence about
    existing files.
    """
    options.check()
    use_bundled_modules()
    options = writable(options)

    scene = context.scene
    rig = work.read(context).rig
    rig.check()
    options.check_for(rig.picture_place)
    check_memory(rig, options)
    if bpy.app.background:
        size = memory_needed((rig.display.width, rig.display.height), options)
        sys.stdout.write(f"Kiriko: {_memory(size)}\n")
    settings = work.settings_of(scene)
    wavelengths = wavelengths_for(rig, settings.wavelength)
    seen_by = [(viewer.name, wavelength) for wavelength in wavelengths for viewer in rig.viewers]
    of_channels = suffixes(seen_by)
    names = [names_of(suffix, options) for suffix in of_channels]
    files = [name for forms in names for of_form in forms.values() for name in of_form]
    if not overwrite:
        folder.refuse_existing(target, [*files, SIDECAR], remedy)

    entries: list[dict[str, Any]] = []
    earlier = earlier_files(target)

    with ExitStack() as stack:
        # Made only when there is something to write, so that a killed process leaves nothing
        # behind.
        new = cache(lambda: stack.enter_context(disk.together(target)))
        n, each = len(wavelengths), len(rig.viewers)
        for k, wavelength in enumerate(wavelengths):
            of_it = names[k * each : (k + 1) * each]
            one = rig.in_one_colour(wavelength)
            steps = _written(new, one, replace(settings, wavelength=wavelength), options, of_it)
            entries += yield from subprogress(steps, MAPPED * k / n, MAPPED * (k + 1) / n)
        # Write nothing if undo or another file has removed the scene in the meantime.
        about = {**_about(scene, rig, settings, options), "maps": entries}
        disk.write_text(new() / SIDECAR, json.dumps(about, indent=2) + "\n")

    remove_earlier(target, earlier, files)
    return about


def _written(
    new: Callable[[], Path],
    rig: Rig,
    settings: Settings,
    options: MapOptions,
    names: list[dict[str, tuple[str, ...]]],
) -> Generator[float, None, list[dict[str, Any]]]:
    """Write the maps of a rig at one wavelength, by viewer name, to a folder made by `new`.

    Yields progress 0..1, returns the entries of maps.json.
    """
    solution = yield from subprogress(work.session().solve(rig, settings), 0.0, SOLVED)
    entries = []
    n = len(names)
    for k, (channel, forms) in enumerate(zip(solution.channels, names, strict=True)):
        start, stop = (SOLVED + (1 - SOLVED) * i / n for i in (k, k + 1))
        maps = yield from subprogress(maps_of(channel, options), start, stop)
        write_maps(new(), forms, maps, ABOUT)
        entries.append(description(channel, maps, forms))
        yield stop
    return entries


def writable(options: MapOptions) -> MapOptions:
    """The options, limited to formats that this Blender's Python can write.

    Raises
    ------
    ImageError : it can write none of them
    """
    if image_io.has_openimageio() or "EXR" not in options.formats:
        return options
    others = tuple(form for form in options.formats if form != "EXR")
    if not others:
        raise ImageError(
            "This Blender's Python has no OpenImageIO, which writes .exr: choose other formats, or"
            " {remedy}.",
            remedy=image_io.REMEDY,
        )
    return replace(options, formats=others)


def left_out(options: MapOptions) -> list[Message]:
    """A sentence on the wanted format that `writable` leaves out."""
    if image_io.has_openimageio() or "EXR" not in options.formats:
        return []
    return [Message("This Blender can't write .exr: OpenImageIO is missing.")]


def _memory(size: float) -> Message:
    return Message("Needs about {gb} GB of memory.", gb=number(size / 1e9))


def files_in(about: dict[str, Any]) -> list[str]:
    """Files named in maps.json."""
    return [name for one in about["maps"] for names in one["files"].values() for name in names]


def _about(
    scene: bpy.types.Scene, rig: Rig, settings: Settings, options: MapOptions
) -> dict[str, Any]:
    """maps.json without the maps themselves."""
    place, display = rig.picture_place, rig.display
    return {
        "kiriko": extension.manifest()["version"],
        "blender": bpy.app.version_string,
        "file": Path(bpy.data.filepath).name,
        "scene": scene.name,
        "rig": fingerprint(replace(rig, pictures=(place,)), settings.of_optics),
        "display": {"name": display.name, "size": [display.width, display.height]},
        "sections": [section._asdict() for section in sections_of(rig.lit)],
        "picture": {
            "name": place.name,
            "size": [place.width, place.height],
            "is_on": "the viewer's own pixels" if place.mesh is None else "a plane",
        },
        "overscan_percent": options.overscan,
        "convention": list(CONVENTION),
    }


class KIRIKO_OT_export_maps(IntoFolder, bpy.types.Operator):
    """Write warp maps, for other programs"""

    bl_description = (
        "Write warp maps, with which other programs make source images of other pictures or movies"
        " in the place of this one"
    )
    bl_idname = "kiriko.export_maps"
    bl_label = "Export Maps"
    bl_options = {"REGISTER"}

    formats: bpy.props.EnumProperty(
        name="Formats",
        items=FORMAT_ITEMS,
        options={"ENUM_FLAG"},
        default={"EXR"},
    )
    overscan: bpy.props.FloatProperty(
        name="Overscan",
        description="Margin around the picture in the images to warp, at each side",
        subtype="PERCENTAGE",
        min=0.0,
        max=MOST_OVERSCAN,
    )
    times: bpy.props.EnumProperty(
        name="ffmpeg Size",
        description="Size of the maps for ffmpeg, relative to the display. Larger is smoother and"
        " slower",
        items=[(str(n), f"{n} x", "") for n in TIMES],
        default="2",
    )
    mesh_step: bpy.props.FloatProperty(
        name="Mesh Step",
        description="Distance between mesh vertices in display pixels. Smaller is more exact",
        subtype="PIXEL",
        default=8.0,
        min=1.0,
        soft_max=128.0,
    )
    overwrite: bpy.props.BoolProperty(
        name="Overwrite",
        description="Replace existing files",
        options={"SKIP_SAVE"},
    )
    in_dialogue = ("formats", "overscan", "times", "mesh_step", "overwrite")

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.column().prop(self, "formats")  # a row has no room for the names
        for name in ("overscan", "times", "mesh_step"):
            layout.prop(self, name)
        layout.prop(self, "overwrite")
        for display in needed.parts(context.scene).get("DISPLAY", ()):
            size = memory_needed(display.kiriko.resolution, self._options())
            sentence(layout, context, _memory(size))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        use_bundled_modules()
        if not (self.properties.is_property_set("formats") or image_io.has_openimageio()):
            self.formats = {"PNG"}
        return super().invoke(context, event)

    def _options(self) -> MapOptions:
        return MapOptions(
            formats=tuple(name for name, *_ in FORMAT_ITEMS if name in self.formats),
            overscan=self.overscan,
            times=int(self.times),
            mesh_step=self.mesh_step,
        )

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        if not self.directory:
            raise ImageError("The maps have no folder: choose one.")

        target = absolute(self.directory)
        options = self._options()
        with folder.made(target):
            about = yield from exported(
                context, target, options, self.overwrite, Message("turn on Overwrite")
            )

        text = Message(
            "Wrote {names} to '{folder}'.",
            names=", ".join([*files_in(about), SIDECAR]),
            folder=target,
        )
        return joined([text, *left_out(options)])
