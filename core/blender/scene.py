"""Reads the evaluated scene into a Rig: what Blender shows at this frame, in metres and float64.

Modifiers, parents, constraints and instances have been applied by the depsgraph; this file sorts by role what it
shows, and notes what it leaves out.
"""

import json
from collections import Counter
from collections.abc import Container, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache, cached_property

import bpy
import numpy as np
from numpy.typing import NDArray

from ..arrays import Floats
from ..bench.offset import with_offset
from ..errors import KirikoError, RigError
from ..fingerprint import fingerprint
from ..glass.meshes import geometric_normals
from ..rig import Blocker, ConstantIndex, Display, Glass, Mesh, Mirror, MirrorArray, Picture, Plate, Rig, Viewer
from ..vectors import normalise
from .bodies import bodiless
from .material import Texture, read_refraction, read_texture
from .mesh import LocalMesh, flat_size, in_world, read_local, sharpen_creases, used_slots
from .picture import read_pixels, stored_pixels
from .plane import FIT_BUTTON, chosen_image, squeeze, squeezed_words
from .units import length_of_unit
from .viewer import read_viewer
from .visibility import Shown, instance_hidden_by, open_collections

UPRIGHT = 0.99  # cosine between a plate's normal and its x axis above which that axis does not lie in it
DEFAULT_IOR = 1.49  # acrylic, for glass whose material does not refract
CURVED = {"GLASS", "MIRROR"}  # roles whose surface may be curved
MAPPED = {"DISPLAY", "PICTURE"}  # roles whose UV map counts


@dataclass(frozen=True)
class MaterialReading:
    """What was read from one material of a glass object.

    `source` is the shader that gave the index, 'override' or 'default'; `ignored` is in the material but not followed.
    """

    object_name: str
    material_name: str
    ior: float
    source: str
    ignored: tuple[str, ...] = ()


@dataclass(frozen=True)
class Reading:
    """A scene as read.

    rig : with what a calibration found, where that is kept as an offset
    drawn : as the scene shows it, without
    display_size : width and height in m of a flat display, over the whole UV square
    display_object : name of the object that is the display, or makes it as an instance
    solved_for : what a result of it is for, as text, where it was read to be solved
    """

    rig: Rig
    drawn: Rig
    materials: tuple[MaterialReading, ...]
    notes: tuple[str, ...]
    display_size: tuple[float, float] | None
    display_object: str
    solved_for: str = ""


@dataclass(frozen=True, eq=False)
class Part:
    """One mesh in the world with the object whose role it has and the one it was drawn as.

    Materials from the most to the least used. matrix (4, 4): where the object stands, m.
    """

    owner: bpy.types.Object
    name: str
    mesh: Mesh
    drawn: bpy.types.Object | None = None
    materials: tuple[bpy.types.Material | None, ...] = ()
    texture: Texture | None = None
    n_dropped: int = 0
    matrix: Floats | None = None

    @property
    def role(self) -> str:
        return self.owner.kiriko.role


@dataclass(eq=False)
class Shape:
    """What was read of an object's mesh, and what it was in the world where it was last put.

    slots : indices of material slots on the faces, most faces first
    """

    local: LocalMesh
    slots: tuple[int, ...]
    texture: Texture | None = None
    matrix: Floats | None = None
    placed: tuple[Mesh, int] | None = None

    @cached_property
    def fingerprint(self) -> str:
        """Tells what was read of the mesh from all else, wherever it stands."""
        return fingerprint(self.local)

    def at(self, matrix: Floats, surface: str) -> tuple[Mesh, int]:
        """The mesh in the world by a matrix (4, 4), and its triangles without area; the same object if unmoved."""
        if self.matrix is None or not np.array_equal(self.matrix, matrix):
            self.matrix, self.placed = matrix, in_world(self.local, matrix, surface.lower())
        return self.placed


class Kept:
    """Shapes and pixels kept from one reading to the next, by session uid; no datablock, which undo could take away.

    Whoever keeps them has to hand on what Blender says of changes (`notice`), and forget all after undo.
    """

    def __init__(self) -> None:
        self._shapes: dict[tuple[int, str, str], Shape] = {}
        self._met: dict[tuple[int, str, str], Shape] = {}
        self._pixels: tuple[tuple[object, ...], NDArray[np.float32], NDArray[np.float32]] | None = None
        self._fingerprint: tuple[NDArray[np.float32], str] | None = None  # of the pixels
        self._is_stale = True  # the pixels have to be compared
        self._n_kept = 0  # shapes that the last reading asked for

    @property
    def is_whole(self) -> bool:
        """Is nothing known to have changed but places and settings, so that the next reading is short?"""
        return not self._is_stale and len(self._shapes) == self._n_kept > 0

    def notice(self, updates: Iterable[bpy.types.DepsgraphUpdate], ours: Container[int] = ()) -> None:
        """Take note of a depsgraph's updates, but for pixels of datablocks with the session uids `ours`."""
        for update in updates:
            block = update.id.original
            if isinstance(block, bpy.types.Object) and update.is_updated_geometry:
                self._shapes = {key: shape for key, shape in self._shapes.items() if key[0] != block.session_uid}
            elif isinstance(block, bpy.types.Image | bpy.types.Material) and block.session_uid not in ours:
                self._is_stale = True  # a material, too: an image that is loaded again does not tell itself

    def shape(self, instance: bpy.types.DepsgraphObjectInstance, owner: bpy.types.Object) -> Shape:
        """Of the object an iterator stands on. Instances are read each time: several share one uid."""
        if instance.is_instance or owner.kiriko.role in MAPPED:
            return read_shape(instance.object, owner)
        key = (instance.object.original.session_uid, owner.kiriko.role, owner.kiriko.surface)
        self._met[key] = self._shapes.get(key) or read_shape(instance.object, owner)
        return self._met[key]

    def pixels(self, image: bpy.types.Image, owner: str) -> NDArray[np.float32]:
        """As by `read_pixels`; the same array as before while the image holds the same numbers."""
        space = image.colorspace_settings
        key = (image.session_uid, tuple(image.size), space.name, space.is_data, image.alpha_mode, image.is_float)
        before = self._pixels if self._pixels is not None and self._pixels[0] == key else None
        if before is None or self._is_stale:
            stored = stored_pixels(image, owner)
            if before is None or not np.array_equal(before[1], stored):
                self._pixels = (key, stored, read_pixels(image, owner))
        self._is_stale = False
        return self._pixels[2]

    def fingerprint_of(self, pixels: NDArray[np.float32]) -> str:
        """Of pixels that were read; kept while they are the same array."""
        if self._fingerprint is None or self._fingerprint[0] is not pixels:
            self._fingerprint = pixels, fingerprint(pixels)
        return self._fingerprint[1]

    def end(self) -> None:
        """A reading is over: drop the shapes it did not ask for."""
        self._shapes, self._met = self._met, {}
        self._n_kept = len(self._shapes)


def used_materials(shown: bpy.types.Object, order: tuple[int, ...]) -> tuple[bpy.types.Material | None, ...]:
    """Materials of an evaluated object's slots, in this order. A slot may override the mesh's material."""
    slots, own = shown.material_slots, shown.data.materials
    last = max(len(slots), len(own)) - 1
    materials = []
    for k in (min(k, last) for k in order):  # Blender clamps an index beyond the slots
        is_overridden = 0 <= k < len(slots) and slots[k].link == "OBJECT"
        materials.append(slots[k].material if is_overridden else own[k] if 0 <= k < len(own) else None)
    return tuple(dict.fromkeys(materials))


def is_placed(camera: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> bool:
    """Does Blender keep a camera's place up to date?

    Always that of the scene's camera; of others not when they are disabled or left out of the view layer: the depsgraph
    then has them with the place they had before, or at the origin, and does not say so.
    """
    scene, layer = depsgraph.scene, depsgraph.view_layer
    flag = "hide_viewport" if depsgraph.mode == "VIEWPORT" else "hide_render"
    is_in = not set(open_collections(scene.collection, flag)).isdisjoint(camera.users_collection)
    is_enabled = is_in and not getattr(camera, flag)
    return camera == scene.camera or (is_enabled and camera in set(layer.objects))


def role_owner(instance: bpy.types.DepsgraphObjectInstance) -> bpy.types.Object | None:
    """The original object whose role an instance has: its own, else that of the collection or nodes that make it."""
    own = instance.object.original
    if own.kiriko.role != "NONE":
        return own
    maker = instance.parent
    if not instance.is_instance or maker is None or instance.particle_system is not None:
        return None
    if maker.instance_type not in {"NONE", "COLLECTION"} or maker.original.kiriko.role == "NONE":
        return None  # objects scattered over the vertices or faces of another are no part of it
    return maker.original


def part_name(instance: bpy.types.DepsgraphObjectInstance, counts: Counter[str]) -> str:
    """Name of a part: that of its object, numbered for instances. Counts up."""
    own = instance.object.original
    # a curve, text or metaball shows its surface as an instance of itself
    is_itself = not instance.is_instance or (own.type != "MESH" and not counts[own.name])
    counts[own.name] += instance.is_instance
    return own.name if is_itself else f"{own.name} (instance {counts[own.name]})"


def read_shape(shown: bpy.types.Object, owner: bpy.types.Object) -> Shape:
    """Triangles, material slots and texture of an evaluated object with its owner's role."""
    role = owner.kiriko.role
    mesh = shown.to_mesh()
    try:
        if owner.kiriko.surface != "FACETS" and role in CURVED:
            sharpen_creases(mesh, shown.original)
        slots = used_slots(mesh)
        textures = (read_texture(m) for m in used_materials(shown, slots)) if role == "PICTURE" else ()
        texture = next((t for t in textures if t is not None), None)
        is_shown = texture is not None and chosen_image(owner) in (None, texture.image)
        local = read_local(
            mesh,
            has_normals=role in CURVED,
            has_uv=role in MAPPED,
            uv_map=texture.uv_map if is_shown else "",
        )
    finally:
        shown.to_mesh_clear()
    return Shape(local, slots, texture)


def read_part(
    instance: bpy.types.DepsgraphObjectInstance, owner: bpy.types.Object, name: str, to_metres: Floats, kept: Kept
) -> Part:
    """Triangles, materials and texture of one instance, read while the iterator stands on it."""
    shown, shape = instance.object, kept.shape(instance, owner)
    matrix = to_metres @ np.array(instance.matrix_world, dtype=float)
    mesh, n_dropped = shape.at(matrix, owner.kiriko.surface)
    return Part(owner, name, mesh, shown.original, used_materials(shown, shape.slots), shape.texture, n_dropped, matrix)


def shown_parts(
    depsgraph: bpy.types.Depsgraph, scene: bpy.types.Scene
) -> Iterator[tuple[bpy.types.DepsgraphObjectInstance, bpy.types.Object]]:
    """Instances with a role that are seen both in the viewport and in renders, and the objects they have it from."""
    shown = Shown(scene, depsgraph.view_layer)
    is_hidden = cache(lambda thing: bool(shown.hidden_by(thing)))  # one object may make thousands of instances
    for instance in depsgraph.object_instances:
        owner = role_owner(instance)
        if owner is None or not instance.show_self:
            continue
        own = instance.object.original
        top = instance.parent.original if instance.is_instance and instance.parent is not None else own
        if not (instance_hidden_by(own) or is_hidden(top)):
            yield instance, owner


def read_parts(
    depsgraph: bpy.types.Depsgraph, scene: bpy.types.Scene, metres: float, kept: Kept, needed: tuple[str, ...] = ()
) -> tuple[list[Part], list[str]]:
    """All parts with a role that are seen both in the viewport and in renders; notes on those that are not.

    Raises RigError for an object with a role that can be no part of a rig, and where all of a role that is needed are
    hidden.
    """
    to_metres = np.diag([metres, metres, metres, 1.0])
    parts: list[Part] = []
    met: set[bpy.types.Object] = set()
    counts: Counter[str] = Counter()
    for instance, owner in shown_parts(depsgraph, scene):
        met.add(owner)
        if why := bodiless(owner):
            raise RigError(f"'{owner.name}' has the role {role_label(owner)}, but {why}: set its role to None.")
        if instance.object.type == "MESH":
            parts.append(read_part(instance, owner, part_name(instance, counts), to_metres, kept))
    kept.end()
    parts, unmet = without_hollows(parts, met), unmet_parts(met, scene, depsgraph.view_layer)
    for role in needed:
        check_some_are_shown(role, parts, unmet)
    return parts, notes_on_parts(parts, met, unmet, scene)


def without_hollows(parts: list[Part], met: set[bpy.types.Object]) -> list[Part]:
    """Parts with faces, and one empty part for each object that shows none at all, for the rig's check to name.

    An object that only makes instances is no such object, nor is a metaball whose surface is that of its family.
    """
    full = [part for part in parts if len(part.mesh.triangles)]
    empty = Mesh(np.empty((0, 3)), np.empty((0, 3), np.int64))
    names = sorted(o.name for o in met - {part.owner for part in full} if o.type != "META")
    owners = {o.name: o for o in met}
    return full + [Part(owners[name], name, empty) for name in names]


def role_label(owner: bpy.types.Object) -> str:
    """The word the user sees for an object's role."""
    return owner.kiriko.bl_rna.properties["role"].enum_items[owner.kiriko.role].name


def unmet_parts(
    met: set[bpy.types.Object], scene: bpy.types.Scene, layer: bpy.types.ViewLayer
) -> dict[bpy.types.Object, str]:
    """Objects of the scene that have a role but no part was met of, and by what each is hidden."""
    shown = Shown(scene, layer)
    return {o: shown.hidden_by(o) for o in scene.objects if o.kiriko.role != "NONE" and o not in met}


def check_some_are_shown(role: str, parts: list[Part], unmet: dict[bpy.types.Object, str]) -> None:
    """Raise RigError for the first object of a role of which there are some, but all hidden."""
    hidden = [(thing, by) for thing, by in unmet.items() if by and thing.kiriko.role == role]
    if hidden and not any(part.role == role for part in parts):
        raise RigError(f"{hidden_words(*hidden[0])}.")


def hidden_words(thing: bpy.types.Object, by: str) -> str:
    """Of an object with a role that is hidden by something: what is wrong and what to do, without a full stop."""
    return f"The {role_label(thing).lower()} '{thing.name}' is hidden{by}: show it"


def notes_on_parts(
    parts: list[Part], met: set[bpy.types.Object], unmet: dict[bpy.types.Object, str], scene: bpy.types.Scene
) -> list[str]:
    """What was left out: hidden objects, metaballs that have no surface of their own, triangles without area."""
    notes = [
        f"'{o.name}' has the role {role_label(o)} but {f'is hidden{by}' if by else 'shows nothing'}: left out."
        for o, by in unmet.items()
    ]
    full = {part.owner for part in parts if len(part.mesh.triangles)}
    notes += [
        f"The metaball '{o.name}' is part of another of the same name: give the role to the first of the family."
        for o in scene.objects
        if o in met - full and o.type == "META"
    ]
    notes += [
        f"'{part.name}' has {part.n_dropped} triangle{'s' if part.n_dropped > 1 else ''} without area: left out."
        for part in parts
        if part.n_dropped
    ]
    return notes


def read_glass(part: Part) -> tuple[Glass, list[MaterialReading], list[str]]:
    """A glass with the index of its most used refractive material, or the override.

    The settings are the original object's: drivers and keys are written to them too, while the evaluated copy does
    not hear of what a script sets.
    """
    settings = part.owner.kiriko
    name, notes = part.owner.name, []
    readings = []
    for material in part.materials:
        found = read_refraction(material)
        if found is None:
            continue
        notes += found.notes
        if settings.use_ior:
            readings.append(MaterialReading(name, material.name, settings.ior, "override", found.ignored))
        else:
            readings.append(MaterialReading(name, material.name, found.ior, found.source, found.ignored))
    if not readings:
        ior, source = (settings.ior, "override") if settings.use_ior else (DEFAULT_IOR, "default")
        material = next((m.name for m in part.materials if m is not None), "")
        readings = [MaterialReading(name, material, ior, source)]
        if source == "default":
            notes.append(f"The glass '{name}' has no refractive material: using an index of refraction of {ior}.")
    plain = sorted({m.name for m in part.materials if m is not None} - {r.material_name for r in readings})
    if plain:
        listed = ", ".join(f"'{material}'" for material in plain)
        notes.append(f"The glass '{name}' has faces of {listed}, which does not refract: taken as glass all the same.")
    others = {r.ior for r in readings} - {readings[0].ior}
    if others:
        listed = ", ".join(f"{ior:.4g}" for ior in sorted(others))
        notes.append(
            f"The glass '{name}' has materials of different index: using {readings[0].ior:.4g} of "
            f"'{readings[0].material_name}' for all of it, not {listed}."
        )
    glass = Glass(part.name, part.mesh, ConstantIndex(readings[0].ior), settings.priority)
    return glass, readings, notes


def mirrors(ours: bpy.types.PropertyGroup) -> MirrorArray:
    """The mirrors that a plate's settings, whose model is not ideal, tell of."""
    return MirrorArray(
        layout=ours.model.lower(),
        pitch=1e-3 * ours.pitch,
        height=1e-3 * ours.pitch * ours.height,
        ior=ours.ior,
        reflectance=ours.reflectance,
        crossing_error=ours.crossing_error if ours.model == "CROSSED" else 0.0,
        has_fresnel=ours.fresnel,
        phase=tuple(ours.phase),
    )


def read_plate(part: Part) -> Plate:
    """A plate with its mirrors, counted from the object's origin and turned with its x axis, or y if x stands on it."""
    if part.owner.kiriko.plate.model == "IDEAL" or part.matrix is None:
        return Plate(part.name, part.mesh)
    x, y = normalise(part.matrix[:3, :2].T)
    corners = part.mesh.corners[:1]
    is_upright = len(corners) > 0 and abs(geometric_normals(corners)[0] @ x) > UPRIGHT
    return Plate(
        part.name, part.mesh, mirrors(part.owner.kiriko.plate), side=y if is_upright else x, centre=part.matrix[:3, 3]
    )


def read_picture(part: Part, kept: Kept) -> tuple[Picture, list[str]]:
    """The picture plane with the pixels of its image."""
    name, texture, notes = part.owner.name, part.texture, []
    image = chosen_image(part.owner)
    if image is None and texture is None:
        raise RigError(
            f"The picture '{name}' shows no image: give its material an image texture, "
            "or choose an image in its Kiriko settings."
        )
    if image is None or (texture is not None and texture.image == image):
        image, notes = texture.image, list(texture.notes)
    elif texture is not None:
        notes.append(
            f"The picture '{name}' shows '{texture.image.name}', but '{image.name}' is chosen and solved:"
            " choose it again in the Kiriko tab, to have it shown."
        )
    pixels = kept.pixels(image, f"the picture '{name}'")
    if squeezed := squeezed_words(squeeze(flat_size(part.mesh), image)):
        notes.append(f"The image '{image.name}' is {squeezed} on the picture '{name}': {FIT_BUTTON}.")
    return Picture(part.name, pixels, part.mesh), notes + about(image)


def read_picture_image(
    image: bpy.types.Image | None, viewer: Viewer | None, kept: Kept
) -> tuple[list[Picture], list[str]]:
    """The picture in the viewer's own pixels, with a note when it has another shape than they."""
    if image is None:
        return [], []
    pixels = kept.pixels(image, "the scene's picture")
    notes = about(image)
    if viewer is not None:
        height, width = pixels.shape[:2]
        if abs(width * viewer.height - height * viewer.width) > max(viewer.width, viewer.height):
            notes.append(
                f"The picture image '{image.name}' has {width} x {height} pixels, the viewer {viewer.width} x "
                f"{viewer.height}: it is stretched to fit."
            )
    return [Picture(image.name, pixels)], notes


def about(image: bpy.types.Image) -> list[str]:
    """Notes on an image of which only a part was read."""
    return [f"Of the image '{image.name}' only the first tile is used."] if image.source == "TILED" else []


def renders_differ(owner: bpy.types.Object, scene: bpy.types.Scene) -> bool:
    """Do modifiers make another shape in renders than in the viewport, whose shape is the one that is read?"""
    return any(
        m.show_viewport != m.show_render
        or (m.show_viewport and m.type in {"SUBSURF", "MULTIRES"} and m.levels != m.render_levels)
        for m in owner.modifiers
    ) or (scene.render.use_simplify and any(m.type in {"SUBSURF", "MULTIRES"} for m in owner.modifiers))


def modifier_notes(parts: list[Part]) -> list[str]:
    """Notes on curved parts whose vertices a modifier leaves beside the surface that is meant."""
    drawn = dict.fromkeys(
        (part.drawn, part.mesh.surface)
        for part in parts
        if part.role in CURVED
        and part.mesh.surface != "facets"
        and part.mesh.is_smooth is not None
        and part.drawn is not None
    )
    return [
        f"The modifier '{m.name}' of '{o.name}' leaves the vertices beside the surface that is meant: {remedy}."
        for o, surface in drawn
        for m in o.modifiers
        if m.show_viewport and (remedy := remedy_of(m, surface))
    ]


def remedy_of(modifier: bpy.types.Modifier, surface: str) -> str:
    """What to do about a modifier that leaves vertices beside the surface; an empty text for others."""
    if modifier.type == "SUBSURF" and modifier.subdivision_type == "CATMULL_CLARK" and not modifier.use_limit_surface:
        return "turn on its Use Limit Surface"
    is_collapsed = modifier.type == "DECIMATE" and modifier.decimate_type == "COLLAPSE" and modifier.ratio < 1
    if (modifier.type == "REMESH" or is_collapsed) and surface == "smooth":
        return "turn it off, or set the object's Surface to Automatic"
    return ""


def scene_notes(
    depsgraph: bpy.types.Depsgraph, scene: bpy.types.Scene, parts: list[Part], camera: bpy.types.Object | None
) -> list[str]:
    """Notes on what the scene asks for as a whole and Kiriko does not do."""
    notes = []
    if depsgraph.mode == "VIEWPORT":
        notes += [
            f"'{o.name}' has another shape in renders than in the viewport (modifiers): using the viewport's."
            for o in dict.fromkeys(part.owner for part in parts)
            if renders_differ(o, scene)
        ]
    if camera is not None and camera.type == "CAMERA" and camera.data.dof.use_dof:
        notes.append(f"The viewer '{camera.name}' has depth of field: solved as a pinhole.")
    space = getattr(getattr(bpy.data, "colorspace", None), "working_space", "Linear Rec.709")
    if space != "Linear Rec.709":
        notes.append(f"The file works in {space}: Kiriko takes linear colours as Rec.709.")
    return notes


def read(
    source: bpy.types.Context | bpy.types.Depsgraph, scene: bpy.types.Scene | None = None, kept: Kept | None = None
) -> Reading:
    """Read the rig of a scene as it stands at this frame.

    Nothing is changed in the scene. What is wrong with the rig as a whole is left to `Rig.check`.

    Parameters
    ----------
    source : the context, or a depsgraph of the scene
    scene : whose settings count; the depsgraph's own when None
    kept : what need not be read again; nothing when None

    Raises
    ------
    RigError : the viewer's camera or the picture plane cannot be used, or what the rig needs is hidden
    ImageError : the picture has no pixels
    """
    drawn = read_drawn(source, scene, kept)
    rig, remarks = calibrated_rig(drawn.rig, source.scene if scene is None else scene)
    return replace(drawn, rig=rig, notes=tuple(dict.fromkeys([*drawn.notes, *remarks])))


def read_drawn(
    source: bpy.types.Context | bpy.types.Depsgraph, scene: bpy.types.Scene | None = None, kept: Kept | None = None
) -> Reading:
    """The same, as the scene shows it: without what a calibration found."""
    depsgraph = source.evaluated_depsgraph_get() if isinstance(source, bpy.types.Context) else source
    scene = depsgraph.scene if scene is None else scene
    metres = length_of_unit(scene)
    kept = kept or Kept()
    needed = ("GLASS", "PLATE", "DISPLAY") + (() if scene.kiriko.picture_source == "IMAGE" else ("PICTURE",))
    parts, notes = read_parts(depsgraph, scene, metres, kept, needed)
    camera = scene.kiriko.viewer or scene.camera
    if camera is not None and not is_placed(camera, depsgraph):
        raise RigError(
            f"The viewer '{camera.name}' is disabled or left out of the view layer, so that its place is unknown: "
            "enable it, or make it the scene's camera."
        )
    viewer = None if camera is None else read_viewer(camera, depsgraph, scene.render, metres)
    by_role: dict[str, list[Part]] = {}
    for part in parts:
        by_role.setdefault(part.role, []).append(part)

    glasses, materials = [], []
    for part in by_role.get("GLASS", []):
        glass, readings, remarks = read_glass(part)
        glasses.append(glass)
        materials += readings
        notes += remarks
    if scene.kiriko.picture_source == "IMAGE":
        pictures, remarks = read_picture_image(scene.kiriko.picture_image, viewer, kept)
        notes += remarks
        unused = by_role.get("PICTURE", [])
        notes += [f"The picture plane '{part.name}' is not used: the picture is an image." for part in unused]
    else:
        pictures = []
        for part in by_role.get("PICTURE", []):
            picture, remarks = read_picture(part, kept)
            pictures.append(picture)
            notes += remarks
    displays = [Display(p.name, p.mesh, *p.owner.kiriko.resolution) for p in by_role.get("DISPLAY", [])]
    notes += modifier_notes(parts) + scene_notes(depsgraph, scene, parts, camera)
    rig = Rig(
        viewers=() if viewer is None else (viewer,),
        glasses=tuple(glasses),
        plates=tuple(read_plate(p) for p in by_role.get("PLATE", [])),
        displays=tuple(displays),
        pictures=tuple(pictures),
        mirrors=tuple(Mirror(p.name, p.mesh) for p in by_role.get("MIRROR", [])),
        blockers=tuple(Blocker(p.name, p.mesh) for p in by_role.get("BLOCKER", [])),
    )
    size = flat_size(displays[0].mesh) if len(displays) == 1 else None
    shown_by = next((part.owner.name for part in by_role.get("DISPLAY", [])), "")
    return Reading(rig, rig, tuple(dict.fromkeys(materials)), tuple(dict.fromkeys(notes)), size, shown_by)


def calibrated_rig(rig: Rig, scene: bpy.types.Scene) -> tuple[Rig, list[str]]:
    """The rig with what calibrations found and the scene keeps as an offset, and notes on what of it has no place."""
    kept = json.loads(scene.kiriko.calibration.offset or "[]")
    if not kept:
        return rig, []
    try:
        rig.check()
    except KirikoError:
        return rig, []  # what is wrong with it is told before it is solved
    rig, unknown = with_offset(rig, kept)
    notes = [
        f"The calibration's offset has '{name}', of which this rig has none: calibrate again or remove the offset."
        for name in unknown
    ]
    return rig, ["The calibration's offset is in this rig.", *notes]


def object_matrix(linear: Floats, shift: Floats, metres: float) -> Floats:
    """Matrix (4, 4) for objects, in units of so many metres: points p, in m, go to linear (3, 3) @ p + shift (3,)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, shift / metres
    return matrix
