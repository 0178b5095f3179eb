"""Renders the rig in Cycles, an independent judge of Kiriko's
results, without touching anything of the user's.

A temporary scene links the user's own objects; those with a role are copied as they are evaluated,
curved surfaces in fine triangles, with materials that obey the same laws. Cycles knows one relative
index of refraction an interface, so nested solids get the ratio of the two media; where that is
ambiguous the result says that the preview is not comparable.
"""

import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from ..bench.offset import part_motions
from ..errors import ImageError, RigError
from ..glass.tessellate import tessellate
from ..rig import Mesh, MirrorArray, Rig
from . import shaders
from .image import image_from_pixels, pixels_from_image
from .mesh import mesh_from_triangles, sharpen_creases
from .nested_glass import Interface, interfaces
from .parts import part_name, shown_parts
from .plate import be_mirror_array
from .scene import Reading, length_of_unit, object_matrix
from .viewer import frame_of

TEMPORARY = "kiriko_temporary"  # marks the data that must not outlive a preview
SHEARED = 1e-6  # of an object's scale: less shear is rounding
BOUNCES = 128  # Cycles' own limit is 1024; a path that needs more than this is lost in the glass


class Preview:
    """A temporary scene that shows the rig to Cycles; use as
    a context manager, it leaves nothing behind.

    Parameters
    ----------
    scene : the user's scene, with settings in `scene.kiriko`
    reading : by `scene.read`: the rig, whose indices of refraction are used
    source : image datablock the display shows; None: the
        display shows its own coordinates (u, v, 1)
    size : width and height of the whole frame in pixels; None: the viewer's
    percentage : of that size
    border : left, right, bottom, top of the part to render, 0..1 of the frame; None: all of it
    samples : per pixel
    fresnel : glass splits light as real glass does (noise); else
        it refracts all of it, black at total reflection
    surroundings : objects without a role and the world are there too
    filter_width : None: each pixel is the mean over its
        square; else pixels, of a Blackman-Harris filter

    Attributes
    ----------
    notes : reasons why the render cannot be compared with Kiriko's result
    path : where the render is written, linear OpenEXR
    """

    def __init__(
        self,
        scene: bpy.types.Scene,
        reading: Reading,
        source: bpy.types.Image | None,
        *,
        size: tuple[int, int] | None = None,
        percentage: int = 100,
        border: tuple[float, float, float, float] | None = None,
        samples: int = 16,
        fresnel: bool = True,
        surroundings: bool = False,
        filter_width: float | None = None,
    ) -> None:
        self.notes: list[str] = []
        self._made: list[bpy.types.ID] = []
        self._source = source
        self._fresnel = fresnel
        self._metres = length_of_unit(scene)
        self._folder = tempfile.TemporaryDirectory(prefix="kiriko-")
        self.path = Path(self._folder.name) / "preview.exr"
        remove_leftovers()
        try:
            self.scene = self._mark(bpy.data.scenes.new("Kiriko Preview"))
            self._fill(scene, reading, surroundings)
            self._set_render(scene, size, percentage, border)
            self._set_cycles(scene, samples, filter_width)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> "Preview":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Remove the temporary scene and all that was made for it."""
        remove_leftovers()
        self._folder.cleanup()

    @property
    def is_rendered(self) -> bool:
        return self.path.exists()

    def render(self) -> np.ndarray:
        """Render now, wait for it, and return the pixels."""
        bpy.ops.render.render(scene=self.scene.name, write_still=True)
        return self.pixels()

    def pixels(self) -> np.ndarray:
        """The render (h, w, 4) float32, linear, row 0 at the top.

        Only the border's part where one was given.
        """
        if not self.is_rendered:
            raise ImageError("Cycles wrote no preview: look in the console for its reason.")
        if _has_header(self.path):
            image = self._mark(bpy.data.images.load(str(self.path), check_existing=False))
            pixels = pixels_from_image(image)
            bpy.data.images.remove(image)
            # no file of which a part is missing has any, and Blender says nothing of that
            if pixels.size:
                return pixels
        raise ImageError(
            "The preview could not be written whole to the folder for temporary files,"
            " '{folder}': make room on its disk and try again.",
            folder=tempfile.gettempdir(),
        )

    def _mark(self, block: Any) -> Any:
        block[TEMPORARY] = True
        return block

    def _material(self, role: str, law: Interface | MirrorArray | None) -> bpy.types.Material:
        """A new material for a role; `law` is the interface of
        glass, or the mirrors of a plate that has any.
        """
        material = self._mark(bpy.data.materials.new(f"Kiriko Preview {role.title()}"))
        if role == "GLASS":
            shaders.be_glass(material, law.index, self._fresnel)
        elif role == "PLATE" and law is not None:
            array = replace(law, has_fresnel=law.has_fresnel and self._fresnel)
            self._mark(be_mirror_array(material, array, self._metres))
        elif role == "DISPLAY" and self._source is None:
            shaders.show_coordinates(material)
        elif role == "DISPLAY":
            shaders.show_image(material, self._source)
        else:
            {"PLATE": shaders.be_plate, "MIRROR": shaders.be_mirror, "BLOCKER": shaders.be_blocker}[
                role
            ](material)
        return material

    def _fill(self, scene: bpy.types.Scene, reading: Reading, surroundings: bool) -> None:
        view_layer = bpy.context.view_layer if bpy.context.scene == scene else scene.view_layers[0]
        view_layer.update()
        depsgraph = view_layer.depsgraph
        found, notes = interfaces(reading.rig.glasses)
        self.notes += notes
        glasses = {
            glass.name: interface
            for glass, interface in zip(reading.rig.glasses, found, strict=True)
        }
        curved = _curved_meshes(reading.rig)
        arrays = {plate.name: plate.array for plate in reading.rig.plates}
        offsets = {
            name: Matrix(object_matrix(motion.rotation, motion.shift, self._metres).tolist())
            for name, motion in part_motions(reading.drawn, reading.rig).items()
        }
        copies: dict[tuple[object, ...], bpy.types.Mesh] = {}
        taken = set()  # the user's objects whose place a copy takes, or that make instances of such
        counts: Counter[str] = Counter()
        for instance, owner in shown_parts(depsgraph, scene):
            if instance.object.type != "MESH":
                continue
            name = part_name(instance, counts)
            role = owner.kiriko.role
            law = None
            taken |= {owner, instance.object.original}
            if instance.is_instance:
                taken.add(instance.parent.original)
            if role == "GLASS":
                law = glasses.get(name)  # none where the mesh has no faces
            elif role == "PLATE":
                law = arrays.get(name)
            if role == "PICTURE" or (role == "GLASS" and (law is None or law.index is None)):
                continue
            is_inside_out = role == "GLASS" and law.is_inside_out
            if name in curved:
                mesh, matrix = self._tessellated(curved[name], is_inside_out, self._metres)
                mesh.materials.append(self._material(role, law))
            else:
                matrix, shear = _without_shear(offsets.get(name, Matrix()) @ instance.matrix_world)
                key = instance.object.data.as_pointer(), role, owner.kiriko.surface, law, shear
                if key not in copies:
                    copies[key] = self._copy(
                        instance.object, owner.kiriko.surface, self._material(role, law)
                    )
                    if shear is not None:
                        copies[key].transform(Matrix(shear))
                    if is_inside_out:
                        copies[key].flip_normals()  # Cycles tells inside from outside by them
                mesh = copies[key]
            thing = self._mark(bpy.data.objects.new(f"Kiriko Preview {name}", mesh))
            thing.matrix_world = matrix
            self.scene.collection.objects.link(thing)
        if surroundings:
            self.scene.world = scene.world
            for thing in _seen_in_render(view_layer.layer_collection):
                if thing.kiriko.role == "NONE" and thing not in taken:
                    self.scene.collection.objects.link(thing)
        self._add_camera(scene, depsgraph, reading, offsets)

    def _tessellated(
        self, mesh: Mesh, is_inside_out: bool, metres: float
    ) -> tuple[bpy.types.Mesh, Matrix]:
        """A curved surface in fine triangles, facing out of the glass, and where it stands."""
        if is_inside_out:
            normals = None if mesh.corner_normals is None else -mesh.corner_normals[:, ::-1]
            mesh = replace(mesh, triangles=mesh.triangles[:, ::-1], corner_normals=normals)
        made, matrix = mesh_from_triangles("Kiriko Preview Surface", mesh, metres)
        return self._mark(made), matrix

    def _copy(
        self, shown: bpy.types.Object, surface: str, material: bpy.types.Material
    ) -> bpy.types.Mesh:
        """The evaluated mesh of an object, in one material."""
        mesh = self._mark(bpy.data.meshes.new_from_object(shown))
        if surface != "FACETS":
            sharpen_creases(mesh, shown.original)
        mesh.materials.clear()
        mesh.materials.append(material)
        mesh.polygons.foreach_set("material_index", np.zeros(len(mesh.polygons), np.int32))
        return mesh

    def _add_camera(
        self, scene: bpy.types.Scene, depsgraph: Any, reading: Reading, offsets: dict[str, Matrix]
    ) -> None:
        viewer = scene.kiriko.viewer or scene.camera
        if viewer is None or viewer.type != "CAMERA":
            raise RigError("The rig has no viewer: add a camera and make it the viewer.")
        evaluated = viewer.evaluated_get(depsgraph)
        camera = self._mark(evaluated.data.original.copy())
        camera.animation_data_clear()
        for name in ("lens", "ortho_scale", "shift_x", "shift_y", "sensor_width", "sensor_height"):
            # as evaluated: it may be animated or driven
            setattr(camera, name, getattr(evaluated.data, name))
        drawn, window = (np.ptp(rig.viewer.window[:2]) for rig in (reading.drawn, reading.rig))
        camera.lens, camera.ortho_scale = (
            camera.lens * drawn / window,
            camera.ortho_scale * window / drawn,
        )
        camera.dof.use_dof = False
        camera.clip_start = min(camera.clip_start, 1e-4)
        thing = self._mark(bpy.data.objects.new("Kiriko Preview Viewer", camera))
        thing.matrix_world = offsets.get(viewer.name, Matrix()) @ evaluated.matrix_world
        self.scene.collection.objects.link(thing)
        self.scene.camera = thing

    def _set_render(
        self,
        scene: bpy.types.Scene,
        size: tuple[int, int] | None,
        percentage: int,
        border: tuple[float, float, float, float] | None,
    ) -> None:
        render = self.scene.render
        frame = frame_of(scene.kiriko.viewer or scene.camera, scene.render)
        engines = {item.identifier for item in render.bl_rna.properties["engine"].enum_items}
        try:
            render.engine = "CYCLES"
        except TypeError:
            raise RigError(
                "The preview needs Cycles, but only {engines} is there: enable it.",
                engines=", ".join(sorted(engines)),
            ) from None
        render.resolution_x, render.resolution_y = size or (frame.width, frame.height)
        whole = 100 if size else frame.percentage
        render.resolution_percentage = max(1, whole * percentage // 100)
        render.pixel_aspect_x, render.pixel_aspect_y = frame.aspect_x, frame.aspect_y
        if border is not None:
            render.use_border = render.use_crop_to_border = True
            render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = (
                border
            )
        render.use_compositing = render.use_sequencer = False
        render.use_motion_blur = False
        render.film_transparent = False
        render.use_simplify, render.use_persistent_data = False, False
        render.filepath = str(self.path)
        render.use_file_extension = False
        render.image_settings.file_format = "OPEN_EXR"
        render.image_settings.color_mode, render.image_settings.color_depth = "RGBA", "32"
        render.image_settings.exr_codec = "ZIP"
        transforms = self.scene.view_settings.bl_rna.properties["view_transform"].enum_items
        if "Standard" in {item.identifier for item in transforms}:
            self.scene.view_settings.view_transform = "Standard"
        self.scene.frame_current = scene.frame_current
        self.scene.frame_subframe = scene.frame_subframe

    def _set_cycles(self, scene: bpy.types.Scene, samples: int, filter_width: float | None) -> None:
        """Everything a path needs to reach the display, and
        nothing that clamps, guesses or blurs its colour.
        """
        cycles = self.scene.cycles
        cycles.device = scene.cycles.device
        cycles.samples = samples
        cycles.use_adaptive_sampling = False
        cycles.use_denoising = False
        cycles.time_limit = 0.0
        for name in ("max", "diffuse", "glossy", "transmission"):
            setattr(cycles, f"{name}_bounces", BOUNCES)
        cycles.diffuse_bounces = 4
        cycles.transparent_max_bounces = BOUNCES  # a Ray Portal counts as one of these
        # no path ends by chance
        cycles.min_light_bounces = cycles.min_transparent_bounces = BOUNCES
        cycles.caustics_reflective = cycles.caustics_refractive = True
        cycles.blur_glossy = 0.0
        cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
        cycles.film_exposure = 1.0
        if filter_width is None:
            cycles.pixel_filter_type = "BOX"
        else:
            cycles.pixel_filter_type = "BLACKMAN_HARRIS"
            cycles.filter_width = filter_width


def _has_header(path: Path) -> bool:
    """Is the header of an OpenEXR file all there? Blender 4.2
    never comes back from reading one that is cut off.
    """
    with path.open("rb") as file:
        # after magic number and version: name, type, length and value of each attribute
        rest = file.read(1 << 16)[8:]
    while rest[:1] not in {b"", b"\0"}:
        rest = rest.split(b"\0", 2)[-1]
        rest = rest[4 + int.from_bytes(rest[:4], "little") :]
    return bool(rest)


def _without_shear(matrix: Matrix) -> tuple[Matrix, tuple[tuple[float, ...], ...] | None]:
    """A place that an object can have, with the same x axis, and
    the transform that its mesh has to get before, if any.

    Objects have a location, a rotation and a scale;
    parents of uneven scale give them shear besides.
    """
    columns = np.array(matrix, float)[:3, :3]
    turned, upper = np.linalg.qr(columns)
    sign = np.where(np.diag(upper) < 0, -1.0, 1.0)
    turned = turned * sign
    upper = upper * sign[:, None]
    scale = np.diag(upper)
    if not (scale > 0).all() or np.abs(upper - np.diag(scale)).max() <= SHEARED * scale.max():
        return matrix, None
    place = np.eye(4)
    shear = np.eye(4)
    place[:3, :3] = turned * scale
    place[:3, 3] = np.array(matrix, float)[:3, 3]
    shear[:3, :3] = upper / scale[:, None]
    return Matrix(place.tolist()), tuple(map(tuple, shear.tolist()))


def _curved_meshes(rig: Rig) -> dict[str, Mesh]:
    """Fine triangles of the glasses and mirrors that are curved, by name."""
    parts = {
        part.name: part.mesh
        for part in (*rig.glasses, *rig.mirrors)
        if part.mesh.surface != "facets"
    }
    fine = {name: tessellate(mesh) for name, mesh in parts.items() if len(mesh.triangles)}
    return {name: mesh for name, mesh in fine.items() if mesh is not parts[name]}


def _seen_in_render(layer: bpy.types.LayerCollection) -> Iterator[bpy.types.Object]:
    """Objects of a view layer that its scene would render, each once."""
    seen = set()
    todo = [layer]
    while todo:
        layer = todo.pop()
        if layer.exclude or layer.collection.hide_render:
            continue
        todo.extend(layer.children)
        for thing in layer.collection.objects:
            if thing not in seen and thing.type != "CAMERA":
                seen.add(thing)
                yield thing


def remove_leftovers() -> None:
    """Remove everything a preview made, also of one that was cut short."""
    for group in ("scenes", "objects", "cameras", "meshes", "materials", "node_groups", "images"):
        blocks = [block for block in getattr(bpy.data, group) if block.get(TEMPORARY)]
        if blocks:
            bpy.data.batch_remove(blocks)


def render_preview(
    scene: bpy.types.Scene,
    reading: Reading,
    source_image: np.ndarray | bpy.types.Image,
    *,
    size: tuple[int, int] | None = None,
    percentage: int = 100,
    border: tuple[float, float, float, float] | None = None,
    samples: int = 16,
    fresnel: bool = True,
    surroundings: bool = False,
) -> np.ndarray:
    """The viewer's image of a source image, rendered by Cycles.

    Parameters
    ----------
    source_image : (H, W, 3) float, linear, row 0 at the top; or an image datablock
    others : see Preview

    Returns
    -------
    (h, w, 4) float32, linear, row 0 at the top
    """
    options = {"size": size, "percentage": percentage, "border": border, "samples": samples}
    made = None
    if not isinstance(source_image, bpy.types.Image):
        made = source_image = image_from_pixels("Kiriko Preview Source", source_image)
    try:
        with Preview(
            scene, reading, source_image, **options, fresnel=fresnel, surroundings=surroundings
        ) as preview:
            return preview.render()
    finally:
        if made is not None:
            bpy.data.images.remove(made)


def render_map(
    scene: bpy.types.Scene,
    reading: Reading,
    *,
    size: tuple[int, int] | None = None,
    percentage: int = 100,
    border: tuple[float, float, float, float] | None = None,
) -> np.ndarray:
    """Where on the display the middle of each viewer pixel
    lands, traced by Cycles with one sample a pixel.

    Returns
    -------
    (h, w, 3) float32: u and v of the display (origin bottom left), and 1 where the path arrived,
    else 0; row 0 at the top. Good to about 0.002 display pixels of 512. Paths with total reflection
    do not arrive.
    """
    options = {"size": size, "percentage": percentage, "border": border}
    with Preview(
        scene, reading, None, **options, samples=1, fresnel=False, filter_width=0.01
    ) as preview:
        carried = preview.render()[..., :3]
    throughput = carried[..., 2:]  # below 1 behind mirrors that absorb
    return np.divide(carried, throughput, out=np.zeros_like(carried), where=throughput > 0)
