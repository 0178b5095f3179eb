"""Add Rig: display, picture, viewer and perhaps a plate around the selected glass or a new ball."""

from collections.abc import Generator
from dataclasses import replace
from typing import Any

import bpy
import numpy as np

from ..core.base.errors import RigError, one_line
from ..core.base.messages import Message, joined
from ..core.base.numbers import number
from ..core.base.steps import subprogress
from ..core.base.words import listed, percent, summary
from ..core.bench.initial_placement import Request, settle
from ..core.bench.largest_square import ENOUGH
from ..core.bench.picture_light import MOST, Spread
from ..core.bench.placement import Proposal, Wishes, propose, propose_behind, viewer_of
from ..core.bench.placement import rig_of as proposed_rig
from ..core.bench.systems import SYSTEMS, placed
from ..core.blender.checks.inspect_scene import has_own_faces
from ..core.blender.data.camera_viewer import Frame, frame_of_render
from ..core.blender.data.rigs import has_roles, is_copy, rig_of, rigs, rigs_of
from ..core.blender.data.stored_records import Sentences, StoredNumbers
from ..core.blender.data.units import length_of_unit, length_text
from ..core.blender.data.visibility import VisibleObjects
from ..core.blender.lifecycle.given_glass import has_place
from ..core.blender.lifecycle.new_rig import RigSite, glass_among, make_rig, on_left_out, read_bench
from ..core.blender.lifecycle.rig_from_parts import make_rig_from
from ..core.blender.read.elements import DEFAULT_IOR
from ..core.blender.result.write_result import legibility_numbers
from ..core.light.rays import BY_GAPS, REASON_WORDS, Reason
from ..core.light.rig_parts import InsideGlassError
from ..core.rig.rig import ROLES
from ..core.solve.legibility import READABLE, illegible
from . import automatic, compared, framing, live, long_work, look_through, needed, work
from .remedies import legible
from .reporting import in_words

ROOM = 1.01  # margin of a display around the outermost traced light
# width in pictures from which a display is worth a sentence
WIDE = 2
# lost share of the picture from which the size of the display does not matter
MOSTLY_LOST = 0.5
CUT = 0.01  # share of the picture lost at Display Limit, worth a sentence
SMALLER = 0.7  # of a display's width: a smaller display is proposed only below this


_taken: automatic.Taken = {}  # automatic lengths of the last rig

KINDS = (
    (
        "IN_GLASS",
        "Picture Inside Glass",
        "Build a rig with a mirror plate, which images the display into the glass, where the"
        " picture floats",
    ),
    (
        "BEHIND_GLASS",
        "Screen Behind Glass",
        "Build a rig without a plate: the viewer sees a phone or another screen behind the glass",
    ),
)
# kinds with parts of their own: Add Rig > More
MORE = tuple((kind, system.label, system.tip) for kind, system in SYSTEMS.items())
# properties of one kind of rig
OF_KIND = {"tilt": "IN_GLASS", "plate_size": "IN_GLASS", "look_down": "BEHIND_GLASS"}
# groups of properties in the operator's panel
GROUPS = (
    ("Glass", ("distance", "tilt", "plate_size", "picture_size")),
    ("Viewer", ("viewer_distance", "azimuth", "look_down", "field", "viewer_resolution")),
    ("Display", ("display_size", "max_display_size", "display_resolution")),
)


class KIRIKO_OT_add_rig(long_work.LongWork, bpy.types.Operator):
    """Build a display, a picture and a viewer around the selected glass, or around a new ball"""

    bl_idname = "kiriko.add_rig"
    bl_label = "Add Rig"
    bl_options = {"REGISTER", "UNDO"}

    kind: bpy.props.EnumProperty(name="Kind", items=KINDS + MORE, default="IN_GLASS")
    scale: bpy.props.FloatProperty(
        name="Scale",
        description="Size of the whole rig, whose origin is the 3D cursor",
        default=1.0,
        min=1e-3,
        max=1e3,
        options={"SKIP_SAVE"},
    )
    distance: automatic.length(
        "Distance",
        "Distance from the glass to the plate, or to the display without a plate. 0 = automatic",
    )
    look_down: bpy.props.FloatProperty(
        name="Look Down",
        description="Angle of the view down at the glass. At 45 degrees or more, the display lies"
        " flat under the glass",
        subtype="ANGLE",
        default=0.0,
        min=0.0,
        max=np.pi / 2,
    )
    tilt: bpy.props.FloatProperty(
        name="Tilt",
        description="Angle between plate and horizontal. At 45 degrees the display is right below",
        subtype="ANGLE",
        default=np.pi / 4,
        min=np.radians(5),
        max=np.radians(85),
    )
    picture_size: automatic.length(
        "Picture", "Width of the picture. 0 = as large as fits, up to half of the glass"
    )
    viewer_distance: automatic.length(
        "Viewer Distance", "Distance from the glass to the viewer. 0 = 1 m, or more for large glass"
    )
    azimuth: bpy.props.FloatProperty(
        name="Azimuth",
        description="Direction of the viewer around the glass. At 0 it looks along +Y",
        subtype="ANGLE",
        default=0.0,
    )
    field: automatic.length("Field", "Width of the view at the glass. 0 = as wide as the glass")
    viewer_resolution: bpy.props.IntProperty(
        name="Viewer Resolution",
        description="Pixels along each side of the viewer's image. 0 = the render's resolution",
        default=512,
        min=0,
        max=16384,
    )
    plate_size: automatic.length(
        "Plate", "Width of the plate. 0 = 0.488 m, or more for large glass"
    )
    display_size: automatic.length(
        "Display", "Width of the display. 0 = large enough for the whole picture"
    )
    max_display_size: automatic.length(
        "Display Limit", "Largest automatic width. 0 = ten pictures along the shorter side"
    )
    display_resolution: bpy.props.IntVectorProperty(
        name="Display Resolution",
        size=2,
        default=(1920, 1080),
        min=1,
        max=16384,
    )

    auto_distance: automatic.checkbox("distance", _taken)
    auto_picture_size: automatic.checkbox("picture_size", _taken)
    auto_viewer_distance: automatic.checkbox("viewer_distance", _taken)
    auto_field: automatic.checkbox("field", _taken)
    auto_plate_size: automatic.checkbox("plate_size", _taken)
    auto_display_size: automatic.checkbox("display_size", _taken)
    auto_max_display_size: automatic.checkbox("max_display_size", _taken)

    @classmethod
    def description(
        cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties
    ) -> str:
        tip = next(tip for kind, _, tip in KINDS + MORE if kind == properties.kind)
        return bpy.app.translations.pgettext_tip(tip)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(cls, [] if context.mode == "OBJECT" else [needed.LEAVE_EDIT_MODE])

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(self, "kind")
        if self.kind in SYSTEMS:
            layout.prop(self, "scale")
            return
        for title, names in GROUPS:
            layout.label(text=in_words(title), translate=False)
            column = layout.column()
            for name in names:
                if OF_KIND.get(name, self.kind) == self.kind:
                    self._draw_one(column, context, name)

    def _draw_one(self, column: bpy.types.UILayout, context: bpy.types.Context, name: str) -> None:
        """Draw a property; a length with its checkbox, and with the automatic length while that is
        on.
        """
        if f"auto_{name}" not in self.rna_type.properties:
            column.prop(self, name)
            return

        automatic.draw(column, context, self, name, _taken)

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        scene = context.scene
        if self.kind in SYSTEMS:
            return self._add_system(context)
        is_straight = self.kind == "BEHIND_GLASS"
        things, layer = context.selected_objects, context.view_layer
        glasses = glass_among(things)
        left_out = on_left_out(things, layer.objects.active, VisibleObjects(scene, layer))
        _refuse_second(scene, glasses, is_straight)
        bench = read_bench(context, scene, glasses)
        wishes = _wishes(self, length_of_unit(scene))
        proposal = (
            propose_behind(bench.bounds, wishes, bench.aim)
            if is_straight
            else propose(bench.bounds, wishes)
        )
        side = self.viewer_resolution
        pixels = tuple(self.display_resolution)
        frame = Frame(side, side) if side else frame_of_render(scene.render)
        yield 0.05

        viewer = viewer_of(proposal, frame.size, frame.aspect_x / frame.aspect_y)
        request = Request(bench.rig, bench.bounds, wishes, viewer, pixels)
        settings = work.settings_of(scene)
        steps = settle(request, proposal, lambda rig: work.session().plan(rig, settings))
        try:
            proposal, spread = yield from subprogress(steps, 0.05, 0.9)
        except InsideGlassError:  # it names a camera that does not exist yet
            raise RigError(
                "At a Viewer Distance of {distance} the viewer is inside the glass. Increase it.",
                distance=length_text(scene, proposal.viewer_distance),
            ) from None

        aspect = pixels[0] / pixels[1]
        limit = 0.0 if self.display_size else proposal.display
        needed = ROOM * spread.width(aspect)
        if needed and is_straight:  # a display is at least as large as its picture
            needed = max(needed, ROOM * proposal.picture * max(aspect, 1.0))
        if needed and limit:
            proposal = replace(proposal, display=min(needed, limit))

        rig = proposed_rig(proposal, bench.rig, viewer, pixels)
        seen = yield from subprogress(legible(rig, settings, is_watched=self.is_watched), 0.9, 1.0)

        _remember(proposal, bench, limit, length_of_unit(scene))
        remarks = _on_materials(bench)
        if seen[0] < READABLE:
            remarks.append(illegible(seen[0]))
        on_display, for_most = _on_display(scene, proposal, limit, spread, aspect)
        text = joined([on_display, *left_out])
        _leave(scene)
        rig, glasses = make_rig(scene, bench, proposal, frame.size if side else None, pixels)
        _write_result(rig, text, remarks, for_most, legibility_numbers(*seen))
        if not bpy.app.background:
            _show(context, rig, glasses)
        is_short = sum(spread.unseen.values()) > 1 - ENOUGH
        self.level = "WARNING" if is_short or remarks else "INFO"

        return joined([text, *remarks, *_on_camera(scene)])

    def _add_system(self, context: bpy.types.Context) -> str:
        """Add a rig with parts of its own at the 3D cursor, whatever is selected."""
        scene, system = context.scene, SYSTEMS[self.kind]
        _refuse_second(scene, (), is_straight=True)
        at = np.array(scene.cursor.location) * length_of_unit(scene)
        rig = placed(system.make(), self.scale, at)
        _leave(scene)
        collection = make_rig_from(scene, rig)
        if not bpy.app.background:
            _show(context, collection, ())
        text = Message("{tip}.", tip=system.tip)
        if system.source:
            text = Message("{tip} ({source}).", tip=system.tip, source=system.source)
        return joined([text, *_on_camera(scene)])


def _leave(scene: bpy.types.Scene) -> None:
    """Leave views and work of the rig that was active."""
    if scene.kiriko_scene.looking:
        look_through.leave(scene)
    if compared.is_shown(scene):
        compared.leave()
    live.settle(scene)
    live.forget_why()


def _remember(proposal: Proposal, bench: RigSite, limit: float, metres: float) -> None:
    """Store the lengths of a new rig for the checkboxes of the next one.

    limit : m, Display Limit; 0 if the width was given
    """
    plate = proposal.placement.plate
    lengths = {
        "picture_size": proposal.picture,
        "viewer_distance": proposal.viewer_distance,
        "field": proposal.field,
        "plate_size": proposal.plate,
        "display_size": proposal.display,
        "max_display_size": limit,
    }
    if plate is not None:
        middle = np.mean(bench.bounds, axis=0)
        lengths["distance"] = float(np.linalg.norm(plate[:3, 3] - middle))
    _taken.clear()
    _taken.update({name: length / metres for name, length in lengths.items() if length})


def _wishes(given: KIRIKO_OT_add_rig, metres: float) -> Wishes:
    """The operator's properties, converted from Blender units."""
    return Wishes(
        distance=given.distance * metres,
        tilt=given.tilt,
        azimuth=given.azimuth,
        picture=given.picture_size * metres,
        viewer_distance=given.viewer_distance * metres,
        field=given.field * metres,
        plate=given.plate_size * metres,
        display=given.display_size * metres,
        max_display=given.max_display_size * metres,
        aspect=given.display_resolution[0] / given.display_resolution[1],
        look_down=given.look_down,
    )


def _refuse_second(
    scene: bpy.types.Scene, glasses: tuple[bpy.types.Object, ...], is_straight: bool
) -> None:
    """Raise RigError if a glass is in a rig already, or a part outside all rigs would be a second
    one.
    """
    holders = rigs_of(scene)
    for thing in glasses:
        rig = None if is_copy(scene, thing) else rig_of(scene, thing)
        if thing.kiriko.role != "NONE" and rig is not None and has_roles(rig):
            raise RigError(
                "'{name}' is already in the rig '{rig}'. Select other glass, or remove the rig.",
                name=thing.name,
                rig=rig.name,
            )

    found = needed.parts(scene, is_left_out=lambda thing: bool(holders(thing)))
    for role in ROLES:
        if role.number is None or not (role.is_made or (is_straight and role.name == "PLATE")):
            continue
        for thing in found.get(role.name, ()):
            raise RigError(
                "The scene already has a {role} ('{name}'): {remedy} first.",
                role=role.noun,
                name=thing.name,
                remedy=Message("move it into its rig's collection")
                if rigs(scene)
                else Message("set its role to None"),
            )


def _on_display(
    scene: bpy.types.Scene, proposal: Proposal, limit: float, spread: Spread, aspect: float
) -> tuple[str, float]:
    """A report on the display's size and the picture's visible share; and the longest side, m, of a
    much smaller display for MOST of the light, else 0.

    limit : m, Display Limit; 0 if the width was given
    """
    width, lost = length_text(scene, proposal.display), spread.unseen
    text = Message("The whole picture fits on the display ({width} wide).", width=width)
    if listed(lost):
        display = Message("The display, {width} wide,", width=width)
        text = summary(1 - sum(lost.values()), lost, display)

    if lost.get(BY_GAPS, 0.0) > MOSTLY_LOST:
        return Message("{text} Close the gaps in the glass.", text=text), 0.0

    if lost.get(REASON_WORDS[Reason.MISSED_GLASS], 0.0) > MOSTLY_LOST:
        return Message(
            "{text} As the viewer sees it, most of the picture is outside the glass: move the"
            " picture, or rotate the glass.",
            text=text,
        ), 0.0

    is_cut = spread.off_display_weight.sum() > CUT
    shorter_side = proposal.display / max(aspect, 1.0)
    if not limit or not (is_cut or shorter_side > WIDE * proposal.picture):
        return text, 0.0

    times = proposal.display / proposal.picture
    why = Message("It is {times} times as wide as the picture", times=number(times))
    remedies = [Message("make Picture smaller")]

    if is_cut:
        why = Message(
            "Light lands outside the Display Limit of {limit}", limit=length_text(scene, limit)
        )
        remedies.append(Message("raise Display Limit"))

    smaller = ROOM * spread.width(aspect, MOST)
    if not 0 < smaller < SMALLER * proposal.display:
        smaller = 0.0
    else:
        share = percent(MOST * (1 - sum(lost.values())))
        remedies.append(
            Message(
                "set Display to {width}, for {share}",
                width=length_text(scene, smaller),
                share=share,
            )
        )

    *others, last = remedies
    return Message(
        "{text} {why}: {remedies}.",
        text=text,
        why=why,
        remedies=joined([joined(others, ", "), last], " or ") if others else last,
    ), smaller * max(1.0, 1.0 / aspect)


def _write_result(
    rig: bpy.types.Collection,
    text: str,
    remarks: list[str],
    for_most: float,
    numbers: dict[str, Any],
) -> None:
    """Write the panel's lines and the first numbers."""
    result = rig.kiriko.result
    result.summary, result.for_most = text, for_most
    result.notes = "\n".join(map(one_line, remarks))
    result.sentences = Sentences.of(text, remarks).text()
    result.details = StoredNumbers(numbers).text()


def _show(
    context: bpy.types.Context, rig: bpy.types.Collection, glasses: tuple[bpy.types.Object, ...]
) -> None:
    """Select the part to set up next, and frame the rig."""
    framing.select(context, _next_to_set(rig, glasses))
    for screen, changes in framing.frame_rig(context):
        for path, before, after in changes:
            view = rig.kiriko.views.add()
            view.screen, view.path, view.before, view.after = screen, path, before, after


def _next_to_set(
    rig: bpy.types.Collection, glasses: tuple[bpy.types.Object, ...]
) -> tuple[bpy.types.Object, ...]:
    """The glass of a rig with a plate, else the display: most people choose its product first.

    glasses : of the artist; none in a rig with parts of its own
    """
    parts = {thing.kiriko.role: thing for thing in rig.all_objects}
    if glasses and "PLATE" in parts:
        return glasses
    return (parts.get("DISPLAY") or parts["SCREEN"],)


def _on_materials(bench: RigSite) -> list[str]:
    """A sentence on each opaque glass."""
    return [
        Message(
            "The material of '{name}' isn't glass, so an index of {ior} is assumed: {remedy}.",
            name=thing.name,
            ior=DEFAULT_IOR,
            remedy=_remedy(thing),
        )
        for thing in bench.opaque
    ]


def _remedy(thing: bpy.types.Object) -> Message:
    """The remedy for opaque glass, which cannot always get another material."""
    if has_own_faces(bpy.context.scene, thing) and has_place(thing):
        return Message("press Make It Glass")
    return Message("set Override IOR")


def _on_camera(scene: bpy.types.Scene) -> list[str]:
    """A sentence if the scene's camera is not the viewer."""
    camera = scene.camera
    viewer = scene.kiriko.viewer
    if camera == viewer:
        return []

    return [
        Message(
            "Numpad 0 still shows '{camera}'. Use Look Through Viewer for Kiriko's view.",
            camera=camera.name,
        )
    ]
