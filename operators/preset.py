"""Products of the catalogue for parts, and Cycles materials of mirror array plates."""

from itertools import groupby
from pathlib import Path

import bpy
import numpy as np

from ..core.base.errors import MeshError, RigError
from ..core.base.messages import Message, joined
from ..core.blender.checks.chosen_product import Given, give_display, give_glass, give_plate
from ..core.blender.materials.plate_material import be_mirror_array
from ..core.blender.read.elements import mirrors
from ..core.blender.read.scene import length_of_unit
from ..core.light.interaction_plate import PLATE_FLATNESS
from ..core.rig.catalogue import DISPLAYS, GLASSES, PLATES, DisplayProduct
from ..core.rig.rig import ROLES
from . import needed, reporting, work
from .make_glass import GLASS_TIPS, can_be_given, make_glass
from .part_verbs import NamesPart

NOUNS = {role.name: role.noun for role in ROLES}


class GivesProduct(NamesPart):
    """Mix-in for an operator that gives a part of one role the values of a product: the named part,
    else the active object, else the only part of this role.
    """

    role: str

    @classmethod
    def candidates(cls, context: bpy.types.Context) -> list[bpy.types.Object]:
        """The active object, or all parts of the role if it has another one."""
        thing = context.active_object
        if thing is not None and thing.kiriko.role == cls.role:
            return [thing]
        scene, role = context.scene, cls.role
        return list(needed.parts_met(scene).get(role) or needed.parts(scene).get(role, ()))

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        found = cls.candidates(context)
        reasons = [] if found else [cls.no_part()]
        if found and not any(thing.is_editable for thing in found):
            reasons.append(
                Message(
                    "The {noun} is linked from another file: change it there",
                    noun=NOUNS[cls.role],
                )
            )
        return needed.can_run(cls, reasons)

    @classmethod
    def no_part(cls) -> Message:
        """The reason if there is no part to give a product to, or more than one."""
        return Message("Select an object with the role {role}", role=NOUNS[cls.role])

    def part_in(self, context: bpy.types.Context) -> bpy.types.Object:
        """The part that gets the product; RigError if several could."""
        found = [self.found(context)] if self.part else self.candidates(context)
        if len(found) != 1 or found[0].kiriko.role != self.role:
            raise RigError("{reason}.", reason=self.no_part())
        return found[0]

    def given(self, context: bpy.types.Context, thing: bpy.types.Object) -> Given:
        """Give the object the chosen product."""
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        with reporting.errors_reported(self):
            given = self.given(context, self.part_in(context))
            work.forget_report(context.scene)
            reporting.report(self, "INFO" if given.is_whole else "WARNING", given.text)
            return {"FINISHED"}

        return {"CANCELLED"}


PLATE_TIPS = {
    name: Message(
        "Two crossed layers, {pitch:g} mm from mirror to mirror, {side:g} mm a side",
        pitch=1e3 * product.array.pitch,
        side=1e3 * product.side,
    )
    for name, product in PLATES.items()
}


class KIRIKO_OT_plate_preset(GivesProduct, bpy.types.Operator):
    """Use a real product's mirrors and size for the plate"""

    bl_idname = "kiriko.plate_preset"
    bl_label = "Plate Preset"
    bl_options = {"REGISTER", "UNDO"}

    preset: bpy.props.EnumProperty(
        name="Preset",
        description="Real product",
        items=[(name, name, tip) for name, tip in PLATE_TIPS.items()],
    )

    role = "PLATE"

    def given(self, context: bpy.types.Context, thing: bpy.types.Object) -> Given:
        return give_plate(context, thing, PLATES[self.preset])


def _tip(product: DisplayProduct) -> Message:
    width, height = product.size
    columns, rows = product.pixels
    return Message(
        "{columns} x {rows} pixels on {width:.1f} x {height:.1f} mm",
        columns=columns,
        rows=rows,
        width=1e3 * width,
        height=1e3 * height,
    )


DISPLAY_TIPS = {name: _tip(product) for name, product in DISPLAYS.items()}


def _items() -> list[tuple[str, str, str]]:
    """The products, each kind under its heading."""
    items = []
    for kind, products in groupby(DISPLAYS.values(), key=lambda product: product.kind):
        items.append(("", kind, ""))
        items += [(product.name, product.name, DISPLAY_TIPS[product.name]) for product in products]
    return items


class KIRIKO_OT_display_preset(GivesProduct, bpy.types.Operator):
    """Use a real product's resolution and size for the display"""

    bl_idname = "kiriko.display_preset"
    bl_label = "Display Preset"
    bl_options = {"REGISTER", "UNDO"}

    preset: bpy.props.EnumProperty(
        name="Preset",
        description="Real product",
        items=_items(),
        default=next(iter(DISPLAYS)),
    )
    is_upright: bpy.props.BoolProperty(
        name="Upright",
        description="Portrait orientation, as a phone is held",
        default=False,
    )

    role = "DISPLAY"

    def given(self, context: bpy.types.Context, thing: bpy.types.Object) -> Given:
        return give_display(context, thing, DISPLAYS[self.preset], self.is_upright)


class KIRIKO_OT_glass_preset(GivesProduct, bpy.types.Operator):
    """Use a real material's index for the glass; opaque glass gets a clear material"""

    bl_idname = "kiriko.glass_preset"
    bl_label = "Glass Preset"
    bl_options = {"REGISTER", "UNDO"}

    preset: bpy.props.EnumProperty(
        name="Preset",
        description="Real product",
        items=[(name, name, tip) for name, tip in GLASS_TIPS.items()],
    )

    role = "GLASS"

    @classmethod
    def selected(cls, context: bpy.types.Context) -> list[bpy.types.Object]:
        """All selected glass of this file."""
        things = dict.fromkeys([context.active_object, *context.selected_objects])
        found = (thing for thing in things if thing is not None and thing.kiriko.role == cls.role)
        return [thing for thing in found if thing.is_editable]

    def execute(self, context: bpy.types.Context) -> set[str]:
        with reporting.errors_reported(self):
            things = [] if self.part else self.selected(context)
            things = things or [self.part_in(context)]
            opaque = list(filter(can_be_given, things))
            texts = [make_glass(context, opaque, self.preset)] if opaque else []
            given = give_glass(things, GLASSES[self.preset])
            others = zip(things, given, strict=True)
            texts += [one.text for thing, one in others if thing not in opaque]
            reporting.report(self, "INFO", joined(texts))
            return {"FINISHED"}

        return {"CANCELLED"}

    @classmethod
    def candidates(cls, context: bpy.types.Context) -> list[bpy.types.Object]:
        """All selected glass, or that of the rig."""
        return cls.selected(context) or super().candidates(context)


FOLDER = Path(__file__).resolve().parent.parent / "assets"
FILE = FOLDER / "kiriko_plate.blend"
# layout of the mirrors, a mark of Kiriko's materials
MARK = "kiriko_plate"
UNIT = "kiriko_unit"  # m: length of a Blender unit when the material was added
NAMES = {"crossed": "Kiriko Plate", "holes": "Kiriko Plate DCRA", "radial": "Kiriko Plate Radial"}
SIZE = 0.488  # m, of a new plane


def _material(layout: str, metres: float) -> bpy.types.Material:
    """The plate's material, from this file or appended.

    metres : length of a Blender unit
    """
    for material in bpy.data.materials:
        if (
            material.get(MARK) == layout
            and material.get(UNIT, 1.0) == metres
            and material.library is None
        ):
            return material

    name = NAMES[layout]
    try:
        with bpy.data.libraries.load(str(FILE)) as (_, wanted):
            wanted.materials = [name]
    except OSError:
        raise RigError(
            "The file {file} is missing or broken: install Kiriko again.", file=FILE
        ) from None

    (material,) = wanted.materials
    if material is None:
        raise RigError("The file {file} is missing or broken: install Kiriko again.", file=FILE)

    material.asset_clear()
    material.use_fake_user = False
    material[UNIT] = metres
    for node in material.node_tree.nodes:
        for length in {"Pitch", "Height"} & set(node.inputs.keys()):
            node.inputs[length].default_value /= metres

    return material


def _own_material(thing: bpy.types.Object, metres: float) -> bpy.types.Material | None:
    """A material with the mirrors set for a plate of a rig; None for other objects and ideal
    plates.
    """
    if thing.kiriko.role != "PLATE" or thing.kiriko.plate.model == "IDEAL":
        return None
    material = bpy.data.materials.new(f"{thing.name} Mirrors")
    be_mirror_array(material, mirrors(thing.kiriko.plate), metres)
    return material


def _is_flat(mesh: bpy.types.Mesh) -> bool:
    places = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", places)
    places = places.reshape(-1, 3).astype(float)
    size = np.linalg.eigvalsh(np.cov(places, rowvar=False))  # squared, ascending
    return bool(size[0] <= PLATE_FLATNESS**2 * size[2])


class KIRIKO_OT_add_plate_material(bpy.types.Operator):
    """Give the active flat mesh, or a new plane, the mirrors of a plate, for renders in Cycles"""

    bl_idname = "kiriko.add_plate_material"
    bl_label = "Add Plate Material"
    bl_options = {"REGISTER", "UNDO"}

    layout: bpy.props.EnumProperty(
        name="Mirrors",
        items=(
            (
                "crossed",
                "Crossed Layers",
                "Two layers of slits, one above the other (MMAP, ASKA3D)",
            ),
            ("holes", "Square Holes", "Both directions in one layer (DCRA)"),
            (
                "radial",
                "Radial Holes",
                "Square holes around the object's origin (radially arranged DCRA)",
            ),
        ),
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(cls, [] if context.mode == "OBJECT" else [needed.LEAVE_EDIT_MODE])

    def execute(self, context: bpy.types.Context) -> set[str]:
        thing = context.active_object
        is_new = thing is None or thing.type != "MESH" or not thing.select_get()
        metres = length_of_unit(context.scene)
        material = None

        with reporting.errors_reported(self):
            if not is_new:
                self._check(thing)
            material = (None if is_new else _own_material(thing, metres)) or _material(
                self.layout, metres
            )

        if material is None:
            return {"CANCELLED"}

        if is_new:
            bpy.ops.mesh.primitive_plane_add(size=SIZE / metres)
            thing = context.active_object
            thing.name = thing.data.name = "Kiriko Plate"

        thing.active_material = material
        if context.scene.render.engine != "CYCLES":
            reporting.report(
                self,
                "WARNING",
                Message(
                    "'{material}' is only visible in Cycles. Choose it as the render engine.",
                    material=material.name,
                ),
            )
        else:
            reporting.report(
                self,
                "INFO",
                Message(
                    "'{name}' is now a plate, with the material '{material}'.",
                    name=thing.name,
                    material=material.name,
                ),
            )

        return {"FINISHED"}

    def _check(self, thing: bpy.types.Object) -> None:
        if not (thing.is_editable and thing.data.is_editable):
            raise MeshError(
                "'{name}' is linked from another file: change it there, or make it local.",
                name=thing.name,
            )

        if not len(thing.data.polygons):
            raise MeshError(
                "'{name}' has no faces. Add some, or deselect it.",
                name=thing.name,
            )

        if not _is_flat(thing.data):
            raise MeshError(
                "'{name}' is not flat. Deselect it for a new plane.",
                name=thing.name,
            )


def library_path() -> str:
    """The folder's path among Blender's asset libraries; '' if it is not there."""
    for library in bpy.context.preferences.filepaths.asset_libraries:
        if library.path and Path(bpy.path.abspath(library.path)).resolve() == FOLDER:
            return library.path
    return ""


def libraries_page() -> str:
    """The preferences page with the asset libraries; up to 4.5 it is File Paths."""
    pages = bpy.types.Preferences.bl_rna.properties["active_section"].enum_items
    return pages.get("ASSETS", pages["FILE_PATHS"]).name


class KIRIKO_OT_add_asset_library(bpy.types.Operator):
    """Add Kiriko's materials to your asset libraries, to drag them from the asset browser"""

    bl_idname = "kiriko.add_asset_library"
    bl_label = "Add Asset Library"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(
            cls, [Message("Kiriko is already among your asset libraries")] if library_path() else []
        )

    def execute(self, context: bpy.types.Context) -> set[str]:
        if not FILE.exists():
            reporting.report(
                self,
                "ERROR",
                Message("The file {file} is missing or broken: install Kiriko again.", file=FILE),
            )
            return {"CANCELLED"}

        library = context.preferences.filepaths.asset_libraries.new(
            name="Kiriko", directory=str(FOLDER)
        )
        context.preferences.is_dirty = True
        reporting.report(
            self,
            "INFO",
            Message(
                "The asset library '{name}' is in Preferences > {page}: {folder}.",
                name=library.name,
                page=libraries_page(),
                folder=FOLDER,
            ),
        )
        return {"FINISHED"}
