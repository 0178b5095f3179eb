"""Renders a scene from the camera of another scene's viewer, and restores it."""

import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import bpy

from ...base.errors import ImageError
from ...base.messages import Message
from ..data.camera_viewer import Frame
from ..data.image import or_none
from ..data.reports import said_by

RENDERED = "kiriko_rendered"  # on images rendered for a viewer
COUPLED = {"angle", "angle_x", "angle_y"}  # other settings express the lens in different units
NO_LAYER = Message("no view layer is used for rendering")


class Eye(NamedTuple):
    """A camera as evaluated in its own scene.

    place : its matrix in the world
    lens : its data's values, by their paths
    frame : frame and subframe of its scene
    """

    camera: bpy.types.Object
    place: Any
    lens: dict[str, Any]
    frame: tuple[int, float]


def eye_of(camera: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> Eye:
    """A camera as evaluated by its own scene's depsgraph."""
    evaluated = camera.evaluated_get(depsgraph)
    lens = {
        f"{path}{p.identifier}": getattr(owner, p.identifier)
        for path, owner in (("", evaluated.data), ("dof.", evaluated.data.dof))
        for p in owner.bl_rna.properties
        if p.type in {"BOOLEAN", "INT", "FLOAT", "ENUM"}
        and not (p.is_readonly or getattr(p, "is_array", False))
        and p.identifier not in COUPLED
        and p.identifier not in bpy.types.ID.bl_rna.properties
    }
    scene = depsgraph.scene
    when = scene.frame_current, scene.frame_subframe
    return Eye(camera, evaluated.matrix_world.copy(), lens, when)


def render_for(other: bpy.types.Scene, eye: Eye, frame: Frame) -> bpy.types.Image:
    """A new packed image of a scene rendered with its own settings, from a copy of a camera, at the
    frame of the camera's scene.

    frame : pixels of the image

    Raises
    ------
    ImageError : the scene rendered no image; Esc may have stopped it
    """
    with tempfile.TemporaryDirectory(prefix="kiriko-") as folder:
        path = Path(folder) / "render.png"
        why = NO_LAYER
        # Blender 5.2 crashes without a layer to render
        if any(layer.use for layer in other.view_layers):
            why = _rendered(other, eye, frame, path)
        camera = eye.camera
        if not path.is_file():
            raise ImageError(
                "The scene '{scene}' could not be rendered for the viewer '{viewer}' ({why})."
                " Render it by itself to learn more.",
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


def remove_unused() -> None:
    """Remove unused images rendered for viewers."""
    bpy.data.batch_remove(
        [
            one
            for one in bpy.data.images
            if RENDERED in one and not one.users and one.library is None
        ]
    )


def _rendered(other: bpy.types.Scene, eye: Eye, frame: Frame, path: Path) -> str:
    """Render a scene to a file; returns Blender's reason if it reports a failure."""
    with _copied(other, eye) as copy, _changed(_wanted(other, copy, eye.frame, frame, path)):
        try:
            bpy.ops.render.render(scene=other.name, write_still=True)
        except RuntimeError as reason:
            return said_by(reason).rstrip(".")
    return ""


@contextmanager
def _copied(other: bpy.types.Scene, eye: Eye) -> Iterator[bpy.types.Object]:
    """Context with a copy of a camera in another scene, with the same place and lens."""
    copy, lens = eye.camera.copy(), eye.camera.data.copy()
    try:
        for one in (copy, lens):
            one.animation_data_clear()
        for path, value in eye.lens.items():
            owner, _, name = path.rpartition(".")
            setattr(getattr(lens, owner) if owner else lens, name, value)
        copy.data = lens
        copy.constraints.clear()
        copy.parent = None
        copy.matrix_world = eye.place
        other.collection.objects.link(copy)
        yield copy
    finally:
        bpy.data.objects.remove(copy)
        bpy.data.cameras.remove(lens)


def _wanted(
    other: bpy.types.Scene,
    camera: bpy.types.Object,
    when: tuple[int, float],
    frame: Frame,
    path: Path,
) -> list[tuple[Any, str, Any]]:
    """A scene's settings for rendering to a file: owner, name and value."""
    render = other.render
    form = render.image_settings
    width, height = frame.size
    return [
        # the media type comes first, since the others depend on it
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
        (render, "use_stamp", False),  # burns text into the image
        (other, "camera", camera),
        # Blender renders the frame of the open scene, and leaves the other scene at it
        (other, "frame_current", when[0]),
        (other, "frame_subframe", when[1]),
        # markers would switch the camera
        *((marker, "camera", None) for marker in other.timeline_markers if marker.camera),
        # each viewer would overwrite the files of the previous one
        *((node, "mute", True) for node in _file_outputs(_compositing(other))),
    ]


def _compositing(scene: bpy.types.Scene) -> bpy.types.NodeTree | None:
    """The compositor's node tree of a scene."""
    name = "compositing_node_group" if bpy.app.version >= (5, 0) else "node_tree"
    return getattr(scene, name)


def _file_outputs(
    tree: bpy.types.NodeTree | None, visited: frozenset[int] = frozenset()
) -> Iterator[bpy.types.Node]:
    """The nodes that write files, in a tree and its groups."""
    if tree is None or tree.session_uid in visited:
        return
    for node in tree.nodes:
        if node.bl_idname == "CompositorNodeOutputFile":
            yield node
        elif node.type == "GROUP":
            yield from _file_outputs(node.node_tree, visited | {tree.session_uid})


@contextmanager
def _changed(values: list[tuple[Any, str, Any]]) -> Iterator[None]:
    """Context with other values of settings; each is restored, even if another cannot be."""
    before = [(owner, name, getattr(owner, name)) for owner, name, _ in values]
    with ExitStack() as stack:
        for one in reversed(before):  # restores the media type first
            stack.callback(setattr, *one)
        for owner, name, value in values:
            setattr(owner, name, value)
        yield
