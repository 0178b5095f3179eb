"""What the checklist tells of parts as a whole: those that are
missing, hidden, or too many, and viewers without a camera.
"""

from collections.abc import Iterator

from ..base.messages import Message, as_sentence
from ..rig.rig import ROLES
from .to_do import ADVICE, PROBLEM, Button, Entry, Look, Named, Thing

SINGLE = {role.name: role.label for role in ROLES if role.is_single and role.number is not None}
MADE = {
    "DISPLAY": Message("Make a Display"),
    "PICTURE": Message("Make a Picture"),
    "VIEWER": Message("Make a Viewer"),
    "PLATE": Message("Make a Plate"),
}
MOST_OFFERED = 2  # objects that may be the glass


def shown(look: Look) -> list[Thing]:
    """The parts that are shown."""
    return [thing for thing in look.things if not thing.hidden_by]


def naming(named: Named, **more: object) -> tuple[tuple[str, object], ...]:
    """Values of the properties of a button that names a part."""
    return (("part", named.name), ("library", named.library), *more.items())


def on_missing(look: Look) -> Iterator[Entry]:
    """What is not there is made, all by Add Rig as long as there is no rig; a hidden part is
    shown.
    """
    if look.has_rig and look.missing and not look.things:
        button = Button("kiriko.remove_rig", Message("Remove Rig"), (), "TRASH")
        yield Entry(Message("All parts of the rig are gone."), PROBLEM, (button,))
        return

    roles = {thing.role for thing in look.things}
    is_new = not (look.has_rig or roles & set(SINGLE))  # too little is there to make one part
    is_offered = False
    for role, phrase in look.missing:
        hidden = next((t for t in look.things if t.role == role and t.hidden_by), None)
        buttons: tuple[Button, ...] = ()
        if hidden is not None:
            buttons = (_show(hidden),)
        elif role == "VIEWER" and look.cameras:
            # any other camera may look elsewhere, as that of Blender's own scene does
            made = (_make(role),) if "GLASS" in roles and not look.has_own_camera else ()
            buttons = (*made, _use_camera("scene.kiriko.viewer", look.cameras[0]))
        elif role == "IMAGE":
            buttons = _images(look)
        elif is_new and not is_offered:
            buttons = (Button("kiriko.add_rig", Message("Add Rig"), (), "ADD"),)
            is_offered = True  # once is enough
        elif role == "GLASS":
            buttons = tuple(_use_as_glass(named) for named in look.solids[:MOST_OFFERED])
        elif role == "PLATE" and not is_new:
            without = Button("kiriko.go_without_plate", Message("Go Without"), (), "CHECKMARK")
            buttons = (_make(role), without)
        elif role in MADE and "GLASS" in roles and not is_new:
            buttons = (_make(role),)
        yield Entry(as_sentence(phrase), PROBLEM, buttons)


def _make(role: str) -> Button:
    return Button("kiriko.make_part", MADE[role], (("role", role),), "ADD")


def _use_as_glass(named: Named) -> Button:
    label = Message("Use '{name}'", name=named.name)
    return Button("kiriko.use_part", label, naming(named), "MATSPHERE")


def _images(look: Look) -> tuple[Button, ...]:
    """Where the picture is to be an image in the viewer's own pixels, and there is none."""
    values = (("data_path", "scene.kiriko.picture_source"), ("value", "PLANE"))
    plane = Button("wm.context_set_enum", Message("Set Picture to Plane"), values, "MESH_PLANE")
    if not look.images:
        return (plane,)
    values = (("data_path", "scene.kiriko.picture_image"), ("value", look.images[0]))
    label = Message("Use '{name}'", name=look.images[0])
    return Button("wm.context_set_id", label, values, "IMAGE_DATA"), plane


def _use_camera(path: str, name: str) -> Button:
    label = Message("Use '{camera}'", camera=name)
    values = (("data_path", path), ("value", name))
    return Button("wm.context_set_id", label, values, "OUTLINER_OB_CAMERA")


def choose_image() -> Button:
    """The button that opens an image as the picture."""
    return Button("kiriko.open_picture", Message("Choose Image"), (), "FILE_FOLDER")


def select_part(named: Named, label: Message | None = None) -> Button:
    """The button that selects an object."""
    label = label or Message("Select Part")
    return Button("kiriko.select_part", label, naming(named), "RESTRICT_SELECT_OFF")


def on_viewers(look: Look) -> Iterator[Entry]:
    """Entries of the list of viewers that are on, and see nothing, for their camera is gone, and
    viewers where none can be.
    """
    if look.are_viewers_off:
        values = (("data_path", "scene.kiriko.viewers[0].is_on"), ("value", True))
        turn_on = Button("wm.context_set_boolean", Message("Turn On"), values, "CHECKBOX_HLT")
        yield Entry(Message("All viewers in the list are off."), PROBLEM, (turn_on,))
    for number, name in look.empty_seats:
        text = (
            Message("The viewer '{name}' is in no scene any more, as after deleting it.", name=name)
            if name
            else Message("The list of viewers has an entry without a camera.")
        )
        remove = Button(
            "kiriko.remove_viewer", Message("Remove Entry"), (("number", number),), "REMOVE"
        )
        path = f"scene.kiriko.viewers[{number}].camera" if number else "scene.kiriko.viewer"
        use = [_use_camera(path, camera) for camera in look.free_cameras[:1]]
        yield Entry(text, PROBLEM, (*use, remove))
    for why, camera in look.refused:
        yield Entry(why, PROBLEM, (select_part(camera, Message("Select")),))


def _show(thing: Thing) -> Button:
    return Button("kiriko.show_part", Message("Show"), naming(thing.named), "HIDE_OFF")


def on_too_many(look: Look) -> Iterator[Entry]:
    """Parts of which a rig has one; all of its parts may have been duplicated. Objects that can be
    no part.
    """
    if look.is_doubled:
        text = Message("The rig's parts were duplicated, and lie in the same rig.")
        label = Message("Make the Copies a Rig")
        yield Entry(text, PROBLEM, (Button("kiriko.part_copies", label, (), "DUPLICATE"),))
    for role in SINGLE:
        things = [thing for thing in shown(look) if thing.role == role]
        if len(things) < 2:
            continue
        buttons = tuple(_leave_out(thing.named) for thing in things)
        yield Entry(too_many(role, len(things)), PROBLEM, buttons)
    for why, named in look.no_parts:
        yield Entry(why, PROBLEM, (_leave_out(named),))


def too_many(role: str, n: int) -> Message:
    """A sentence on parts of which a rig has one."""
    return Message(
        "There are {n} objects with the role {role}, of which a rig has one: leave out others.",
        n=n,
        role=SINGLE[role],
    )


def _leave_out(named: Named) -> Button:
    label = Message("Leave Out '{name}'", name=named.name)
    return Button("kiriko.leave_out", label, naming(named), "X")


def on_hidden(look: Look) -> Iterator[Entry]:
    """Hidden parts that the rig can do without; those it needs are missing."""
    missing = {role for role, _ in look.missing}
    for thing in look.things:
        if thing.hidden_by and thing.role not in missing:
            text = Message(
                "'{name}' is hidden{by}, and left out.", name=thing.named.name, by=thing.hidden_by
            )
            yield Entry(text, ADVICE, (_show(thing),))


def on_in_glass(look: Look) -> Iterator[Entry]:
    """Objects within the glass that bend the light, too, as wine does, and are no part of the rig:
    the source image would be that of the glass without them. Advice, for some are left out on
    purpose, and only boxes are looked at.
    """
    for named in look.in_glass[:MOST_OFFERED]:
        name = named.name
        text = Message("'{name}' refracts within the glass, and is no part of the rig.", name=name)
        yield Entry(text, ADVICE, (_use_as_glass(named),))


def on_tiles(look: Look) -> Iterator[Entry]:
    """Images of which a tile alone is the picture. Advice, for that may be meant."""
    for image in look.tiled:
        text = Message("Only the first tile of the image '{image}' is used.", image=image)
        yield Entry(text, ADVICE, (choose_image(),))


def on_lost(look: Look) -> Iterator[Entry]:
    """Data that is missing from its library."""
    for text, library in look.lost:
        values = (("library", library),)
        yield Entry(
            text, PROBLEM, (Button("wm.lib_relocate", Message("Relocate"), values, "FILE_FOLDER"),)
        )
