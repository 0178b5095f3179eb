"""Renders a scene as a viewer of another scene sees it, and leaves that scene as it was."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy

from ..errors import ImageError
from ..messages import Message
from .image import or_none
from .reports import said_by
from .viewer import Frame

RENDERED = "kiriko_rendered"  # marks images that were rendered for a viewer
NO_LAYER = Message("none of its view layers is used for rendering")


def render_for(
    other: bpy.types.Scene, camera: bpy.types.Object, place: Any, frame: Frame
) -> bpy.types.Image:
    """A new packed image: the scene as its own settings render it, seen by a copy of a camera.

    place : the camera's matrix in the world, as evaluated in its own scene
    frame : pixels of the image

    Raises
    ------
    ImageError : the scene rendered no image; Esc may have stopped it
    """
    with tempfile.TemporaryDirectory(prefix="kiriko-") as folder:
        path = Path(folder) / "render.png"
        why = NO_LAYER
        # Blender 5.2 ends with a signal where it has no layer to render
        if any(layer.use for layer in other.view_layers):
            why = _rendered(other, camera, place, frame, path)
        if not path.is_file():
            raise ImageError(
                "The scene '{scene}' rendered no image for the viewer '{viewer}' ({why}): render it"
                " by itself, which tells more.",
                scene=other.name,
                viewer=camera.name,
                why=why or Message("it was stopped"),
            )

        image = bpy.data.images.load(str(path), check_existing=False)
        with or_none(image):
            image.pack()
        image.name = camera.name
        image.filepath_raw = f"//{bpy.path.clean_name(camera.name)}.png"
        image[RENDERED] = True
        return image


def _rendered(
    other: bpy.types.Scene, camera: bpy.types.Object, place: Any, frame: Frame, path: Path
) -> str:
    """Render a scene to a file; the reason where Blender tells one why there is none."""
    with _copied(other, camera, place) as copy, _changed(_wanted(other, copy, frame, path)):
        try:
            bpy.ops.render.render(scene=other.name, write_still=True)
        except RuntimeError as reason:
            return said_by(reason).rstrip(".")
    return ""


@contextmanager
def _copied(
    other: bpy.types.Scene, camera: bpy.types.Object, place: Any
) -> Iterator[bpy.types.Object]:
    """A copy of a camera in another scene, in the very place, for as long as the code within."""
    copy = camera.copy()
    try:
        copy.animation_data_clear()
        copy.constraints.clear()
        copy.parent = None
        copy.matrix_world = place
        other.collection.objects.link(copy)
        yield copy
    finally:
        bpy.data.objects.remove(copy)


def _wanted(
    other: bpy.types.Scene, camera: bpy.types.Object, frame: Frame, path: Path
) -> list[tuple[Any, str, Any]]:
    """The settings of a scene by which it is rendered to a file: owner, name and value."""
    render = other.render
    form = render.image_settings
    width, height = frame.size
    return [
        # the kind of file comes first, for the others depend on it
        *([(form, "media_type", "IMAGE")] if hasattr(form, "media_type") else []),
        (form, "file_format", "PNG"),
        (form, "color_mode", "RGBA"),
        (form, "color_depth", "16"),
        (render, "filepath", str(path)),
        (render, "use_file_extension", False),
        (render, "resolution_x", width),
        (render, "resolution_y", height),
        (render, "resolution_percentage", 100),
        (render, "pixel_aspect_x", frame.aspect_x),
        (render, "pixel_aspect_y", frame.aspect_y),
        (render, "use_border", False),
        (render, "use_multiview", False),
        (render, "use_sequencer", False),
        (other, "camera", camera),
        # markers would have another camera rendered
        *((marker, "camera", None) for marker in other.timeline_markers if marker.camera),
    ]


@contextmanager
def _changed(values: list[tuple[Any, str, Any]]) -> Iterator[None]:
    """Settings with other values for as long as the code within."""
    before = [(owner, name, getattr(owner, name)) for owner, name, _ in values]
    try:
        for owner, name, value in values:
            setattr(owner, name, value)
        yield
    finally:
        for owner, name, value in before:
            setattr(owner, name, value)
