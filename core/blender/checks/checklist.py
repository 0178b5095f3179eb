"""The checklist: the remaining steps for a rig, each with the button for it.

The input is an inspection of the scene, the output a list of entries: this file neither reads the
scene nor draws. An entry is a record, so any operator can be a remedy.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from math import ceil, log10

from ...base.messages import Message, as_message, as_sentence, joined
from ...base.numbers import millimetres
from ...base.words import percent
from ...bench.measured_remedies import MOVE_TO_GLASS, SMOOTH_GLASS
from ...bench.picture_light import MOST
from ...light.rays import REASON_WORDS, Reason
from ...rig.rig import ROLES
from ...solve.legibility import READABLE, illegible
from .findings import APPEARANCE, SHAPE, findings_of, naming
from .to_do import ADVICE, PROBLEM, SOLVE, Button, Entry, Inspection, Named, Thing

SINGLE = {role.name: role.label for role in ROLES if role.is_single and role.number is not None}
ADDED = {role.name for role in ROLES if role.is_made}
MADE = {
    role.name: Message("Make a {part}", part=role.label)
    for role in ROLES
    if role.name in {"DISPLAY", "PICTURE", "VIEWER", "PLATE"}
}
MOST_OFFERED = 2  # possible glass objects
LARGEST = 0.5  # m: larger glass was probably drawn without a size in mind
IN_HAND = 0.01, 0.3  # m: sizes of handheld glass
MILLIMETRES = 1e-3  # the factor for millimetres drawn as metres
WORTH = 0.005  # share of the picture: a smaller loss needs no action

# Remedies for the lost share of the picture, by the reason of the loss: the words after the share,
# and the buttons. Operators that enlarge a part add themselves here. Remedies found by measurement
# replace them, with their amounts.
FIT_PICTURE = Button("kiriko.fit_picture_size", Message("Fit Picture"))
FIT_PLATE = Button("kiriko.fit_plate", Message("Fit Plate"))
FIT_DISPLAY = Button("kiriko.fit_display", Message("Fit Display"))
BEST_PLACE = Button("kiriko.best_place", Message("Best Place"))
TURN_BACK = Button("kiriko.turn_back", Message("Rotate to Recover"))
REMEDIES: dict[str, tuple[Message, tuple[Button, ...]]] = {
    REASON_WORDS[Reason.MISSED_PLATE]: (
        Message("make the {part} larger, or the picture smaller", part=Message("plate")),
        (FIT_PLATE, FIT_PICTURE),
    ),
    REASON_WORDS[Reason.MISSED_DISPLAY]: (
        Message("make the {part} larger, or the picture smaller", part=Message("display")),
        (FIT_DISPLAY, FIT_PICTURE),
    ),
    REASON_WORDS[Reason.MISSED_GLASS]: (
        Message("move the picture into the glass, or make it smaller"),
        (BEST_PLACE, FIT_PICTURE),
    ),
    REASON_WORDS[Reason.LOST_INSIDE]: (
        Message("rotate the glass, or make the picture smaller"),
        (TURN_BACK, FIT_PICTURE),
    ),
}
BY_OPERATOR = {b.operator: b for b in (FIT_PLATE, FIT_DISPLAY, FIT_PICTURE, BEST_PLACE)}
# remedies for an illegible picture: words and icons of the buttons
TO_READ = {
    SMOOTH_GLASS: (Message("Smooth Glass"), "MOD_SMOOTH"),
    MOVE_TO_GLASS: (Message("Move to Glass"), "SNAP_FACE"),
}
# remedies for any loss; the buttons for plate and display are for losses at these parts
FOR_ALL = (FIT_PICTURE.operator, BEST_PLACE.operator)


def entries(seen: Inspection, length_text: Callable[[float], str]) -> list[Entry]:
    """All remaining steps, the gravest first.

    length_text : formats a length, m
    """
    found = [
        *_on_lost(seen),
        *_on_missing(seen),
        *_on_too_many(seen),
        *_on_hidden(seen),
        *_on_in_glass(seen),
        *(entry for thing in _shown(seen) for entry in findings_of(thing, APPEARANCE + SHAPE)),
        *_on_display(seen, length_text),
        *_on_result(seen, length_text),
        *_on_size(seen, length_text),
    ]
    return sorted(found, key=lambda entry: entry.icon == ADVICE)


def findings(seen: Inspection) -> Iterator[Entry]:
    """Entries on the shape of the glass and on glass left out. A result keeps them as notes if
    nobody sees the checklist.
    """
    yield from _on_in_glass(seen)
    for thing in _shown(seen):
        yield from findings_of(thing, SHAPE)


def _shown(seen: Inspection) -> list[Thing]:
    """The visible parts."""
    return [thing for thing in seen.things if not thing.hidden_by]


def _on_missing(seen: Inspection) -> Iterator[Entry]:
    """Missing parts. Without a rig Add Rig makes all of them; a hidden part is shown."""
    if seen.has_rig and seen.missing and not seen.things:
        button = Button("kiriko.remove_rig", Message("Remove Rig"), (), "TRASH")
        yield Entry(Message("All parts of the rig are gone."), PROBLEM, (button,))
        return

    roles = {thing.role for thing in seen.things}
    is_new = not (seen.has_rig or roles & ADDED)  # too few parts to place one more
    is_offered = False
    for role, phrase in seen.missing:
        hidden = next((t for t in seen.things if t.role == role and t.hidden_by), None)
        buttons: tuple[Button, ...] = ()
        if hidden is not None:
            buttons = (_show(hidden),)
        elif role == "VIEWER" and seen.cameras:
            # any other camera may point elsewhere, as the default scene's does
            made = (_make(role),) if "GLASS" in roles and not seen.has_own_camera else ()
            buttons = (*made, _use_camera(seen.cameras[0]))
        elif is_new and not is_offered:
            buttons = (Button("kiriko.add_rig", Message("Add Rig"), (), "ADD"),)
            is_offered = True  # once is enough
        elif role == "GLASS":
            buttons = tuple(_use_as_glass(named) for named in seen.solids[:MOST_OFFERED])
        elif role == "PLATE" and not is_new:
            without = Button("kiriko.go_without_plate", Message("Remove Plate"), (), "CHECKMARK")
            buttons = (_make(role), without)
        elif role in MADE and "GLASS" in roles and not is_new:
            buttons = (_make(role),)
        yield Entry(as_sentence(phrase), PROBLEM, buttons)


def _make(role: str) -> Button:
    return Button("kiriko.make_part", MADE[role], (("role", role),), "ADD")


def _use_as_glass(named: Named) -> Button:
    label = Message("Add '{name}' to Rig", name=named.name)
    return Button("kiriko.use_part", label, naming(named), "MATSPHERE")


def _use_camera(name: str) -> Button:
    label = Message("Use '{camera}' as Viewer", camera=name)
    values = (("data_path", "scene.kiriko.viewer"), ("value", name))
    return Button("wm.context_set_id", label, values, "OUTLINER_OB_CAMERA")


def _show(thing: Thing) -> Button:
    return Button("kiriko.show_part", Message("Show"), naming(thing.named), "HIDE_OFF")


def _on_too_many(seen: Inspection) -> Iterator[Entry]:
    """Several parts in a role for one, perhaps all duplicated, and objects unfit as parts."""
    if seen.is_doubled:
        text = Message("The rig's parts were duplicated within the same rig.")
        label = Message("Duplicate Rig")
        yield Entry(text, PROBLEM, (Button("kiriko.part_copies", label, (), "DUPLICATE"),))
    for role in SINGLE:
        things = [thing for thing in _shown(seen) if thing.role == role]
        if len(things) < 2:
            continue
        buttons = tuple(_leave_out(thing.named) for thing in things)
        yield Entry(too_many(role, len(things)), PROBLEM, buttons)
    for why, named in seen.no_parts:
        yield Entry(why, PROBLEM, (_leave_out(named),))


def too_many(role: str, n: int) -> Message:
    """The sentence on several parts in a role for one."""
    return Message(
        "{n} objects have the role {role}, but a rig has only one. Leave out the others.",
        n=n,
        role=SINGLE[role],
    )


def _leave_out(named: Named) -> Button:
    label = Message("Leave Out '{name}'", name=named.name)
    return Button("kiriko.leave_out", label, naming(named), "X")


def _on_hidden(seen: Inspection) -> Iterator[Entry]:
    """Hidden parts the rig can do without; hidden parts it needs count as missing."""
    missing = {role for role, _ in seen.missing}
    for thing in seen.things:
        if thing.hidden_by and thing.role not in missing:
            text = Message(
                "'{name}' is hidden{by} and ignored.", name=thing.named.name, by=thing.hidden_by
            )
            yield Entry(text, ADVICE, (_show(thing),))


def _on_in_glass(seen: Inspection) -> Iterator[Entry]:
    """Refractive objects inside the glass, such as wine, without a role: the source image ignores
    them. Advice only, since some are left out on purpose and only bounding boxes are compared.
    """
    for named in seen.in_glass[:MOST_OFFERED]:
        name = named.name
        text = Message("'{name}' is inside the glass but isn't in the rig yet.", name=name)
        yield Entry(text, ADVICE, (_use_as_glass(named),))


def _on_lost(seen: Inspection) -> Iterator[Entry]:
    """Data missing from its library."""
    for text, library in seen.lost:
        values = (("library", library),)
        yield Entry(
            text, PROBLEM, (Button("wm.lib_relocate", Message("Relocate"), values, "FILE_FOLDER"),)
        )


def _on_result(seen: Inspection, length_text: Callable[[float], str]) -> Iterator[Entry]:
    """Entries on the result: missing, rough, out of date or incomplete."""
    if seen.missing:
        return
    if seen.is_coarse or seen.is_stale or seen.is_missing_numbers:
        if not seen.is_followed:
            yield _solve(seen)
        return

    if seen.legibility is not None and seen.legibility < READABLE:
        yield replace(_illegible(seen), can_wait=True)
    yield from _once(_losses(seen, length_text))


def _on_display(seen: Inspection, length_text: Callable[[float], str]) -> Iterator[Entry]:
    """A display large enough for the outermost light, as Add Rig makes it."""
    for thing in _shown(seen):
        if thing.role == "DISPLAY" and thing.width > seen.for_most > 0:
            text = Message(
                "'{name}' is {length} wide, but {share} of the light fits on a smaller display.",
                name=thing.named.name,
                length=length_text(thing.width),
                share=percent(MOST),
            )
            label = Message("Resize to {width}", width=length_text(seen.for_most))
            button = replace(FIT_DISPLAY, label=label, properties=(("share", MOST),))
            yield Entry(text, ADVICE, (button,), can_wait=True)


def _illegible(seen: Inspection) -> Entry:
    """An illegible picture, with the measured remedies."""
    texts, buttons = [illegible(seen.legibility)], []
    for help in seen.legible_by:
        label, icon = TO_READ[help.operator]
        share = percent(help.after)
        texts.append(
            Message("{button} raises the legibility to {share}.", button=label, share=share)
        )
        each = [(("take", True),)]
        if help.part:
            names = (thing.named for thing in seen.things if thing.named.name == help.part)
            each = [naming(named, iterations=round(help.amount)) for named in names]
        buttons += [Button(help.operator, label, given, icon) for given in each]
    return Entry(joined(texts), ADVICE, tuple(buttons))


def _once(found: Iterable[Entry]) -> Iterator[Entry]:
    """Advice on a result. Each button stays only at its first entry, since one press serves all of
    them.
    """
    pressed: set[Button] = set()
    for entry in found:
        left = tuple(button for button in entry.buttons if button not in pressed)
        yield replace(entry, buttons=left, can_wait=True)
        pressed.update(entry.buttons)


def _losses(seen: Inspection, length_text: Callable[[float], str]) -> Iterator[Entry]:
    """Lost shares of the picture with their remedies, the largest first."""
    reported = set()
    for reason, share in sorted(seen.misses.items(), key=lambda miss: -miss[1]):
        if reason in REMEDIES and share >= WORTH:
            remedy, buttons = _remedy(seen, reason, length_text)
            yield Entry(_loss(share, reason, remedy), ADVICE, buttons)
            reported.add(reason)
    for reason in [reason for reason in REMEDIES if reason not in reported]:
        # the viewer with the largest loss; remedies were measured only for the visible viewer
        losses = [(of.get(reason, 0.0), name) for name, of in seen.misses_of_others.items()]
        share, name = max(losses, default=(0.0, ""))
        if share >= WORTH:
            remedy, buttons = REMEDIES[reason]
            loss = _loss(share, reason, remedy)
            yield Entry(
                Message("'{viewer}': {summary}", viewer=name, summary=loss), ADVICE, buttons
            )


def _solve(seen: Inspection) -> Entry:
    """An incomplete or outdated result."""
    solve = (Button(SOLVE, Message("Solve"), (), "LIGHT_SUN"),)
    if seen.is_coarse:
        return Entry(
            Message("This is only a rough image. Press Solve for the final one."), PROBLEM, solve
        )
    if seen.is_stale:
        return Entry(Message("The scene has changed: solve again."), PROBLEM, solve)
    return Entry(Message("The result has no figures yet."), ADVICE, solve)


def _loss(share: float, reason: str, remedy: Message) -> Message:
    return Message(
        "{share} of the picture {reason}: {remedy}.",
        share=percent(share),
        reason=as_message(reason),
        remedy=remedy,
    )


def _remedy(
    seen: Inspection, reason: str, length_text: Callable[[float], str]
) -> tuple[Message, tuple[Button, ...]]:
    """The words and buttons for a loss, with amounts if remedies were measured."""
    remedy, buttons = REMEDIES[reason]
    if seen.helps is None:
        return remedy, buttons

    fits = {button.operator for button in buttons} | set(FOR_ALL)
    found = [help for help in seen.helps if help.operator in fits]
    clauses = [help.sentence(length_text) for help in found]
    repairs = [BY_OPERATOR[help.operator] for help in found]
    if not found or TURN_BACK in buttons:
        clauses.append(Message("rotate the glass"))
        repairs.append(TURN_BACK)
    return joined(clauses, " / "), tuple(repairs)


def meant_factors(width: float) -> list[float]:
    """Candidate factors from a width, m, to the intended size: powers of ten that fit IN_HAND, at
    most two; MILLIMETRES first, else the smallest.
    """
    least, most = IN_HAND
    n = ceil(log10(width / most) - 1e-9)
    fitting = [10.0**-n]
    if width * 10.0 ** -(n + 1) >= least * (1 - 1e-9):
        fitting.append(10.0 ** -(n + 1))
    return sorted(fitting, key=lambda factor: (factor != MILLIMETRES, factor))


def _on_size(seen: Inspection, length_text: Callable[[float], str]) -> Iterator[Entry]:
    """Glass drawn in Blender's units without a size in mind."""
    glass = [thing for thing in _shown(seen) if thing.role == "GLASS"]
    widest = max(glass, key=lambda thing: thing.width, default=None)
    if widest is None or widest.width <= LARGEST:
        return

    factors = meant_factors(widest.width)
    text = Message(
        "'{name}' measures {length}. Did you mean {meant}?",
        name=widest.named.name,
        length=length_text(widest.width),
        meant=joined([millimetres(factor * widest.width) for factor in factors], " or "),
    )
    buttons = [
        Button(
            "kiriko.rescale_scene",
            Message("Scale Scene to {times}", times=f"1/{round(1 / factor)}"),
            (("factor", factor),),
            "EMPTY_ARROWS",
        )
        for factor in factors
    ]
    yield Entry(text, ADVICE, tuple(buttons))
