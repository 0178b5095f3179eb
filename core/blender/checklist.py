"""The checklist: the things that are left to do for a rig, each with the button that does it.

A look at the scene goes in, a list of entries comes out: this file neither reads the scene nor
draws. An entry is a record, so that any operator may be a remedy.
"""

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from math import floor, log10

from ..base.messages import Message, as_message, joined
from ..base.numbers import millimetres
from ..base.words import percent
from ..bench.measured_remedies import MOVE_TO_GLASS, SMOOTH_GLASS
from ..bench.picture_light import MOST
from ..light.landings import REASON_WORDS, Reason
from ..solve.legibility import READABLE, illegible
from .bodies import on_no_place
from .checklist_parts import (
    choose_image,
    naming,
    on_hidden,
    on_in_glass,
    on_lost,
    on_missing,
    on_tiles,
    on_too_many,
    on_viewers,
    select_part,
    shown,
)
from .to_do import ADVICE, PROBLEM, SOLVE, Button, Counts, Entry, Look, Thing


def on_mesh(thing: Thing, faults: Counts, own: Counts) -> Iterator[Entry]:
    """Faults of its mesh; those that modifiers make are not in the mesh that can be edited."""
    name = thing.named.name
    n_open, n_flat, is_inside_out, n_cut, n_facets, *_ = faults
    if n_flat and thing.is_mesh:  # nobody can take those at the poles of a surface away
        text = Message(
            "'{name}' has {n} triangle{s} without area.",
            name=name,
            n=n_flat,
            s="s" if n_flat > 1 else "",
        )
        label = "Remove" if own.n_flat else "Weld"
        button = Button("kiriko.merge_flat", label, naming(thing.named), "AUTOMERGE_ON")
        yield Entry(text, ADVICE, (button, *_select(thing, "FLAT", own.n_flat)))

    yield from _on_surplus(thing, faults, own)

    if faults.is_one_sided and thing.role == "GLASS":
        text = Message(
            "'{name}' has no inside: its surface has one side only, as a Klein bottle's.", name=name
        )
        yield Entry(text, PROBLEM, (select_part(thing.named), thicken(thing)))

    if n_open and thing.role == "GLASS":
        n = own.n_open or n_open  # as many as are selected
        text = Message(
            "'{name}' is not closed: {n} edge{s}.", name=name, n=n, s="s" if n > 1 else ""
        )
        select = _select(thing, "OPEN", own.n_open) or (select_part(thing.named),)
        mends = [thicken(thing)]  # as a bowl of one surface wants
        if own.n_open or thing.has_ends:
            label = Message("Cap Ends") if thing.has_ends else Message("Fill Holes")
            fill = Button("kiriko.fill_holes", label, naming(thing.named), "SNAP_FACE")
            mends.insert(1 if own.is_vessel else 0, fill)
        yield Entry(text, PROBLEM, (*select, *mends))

    if n_cut:
        yield _on_cuts(thing, faults, own)

    if n_facets and not thing.has_facets:
        yield _on_facets(thing, faults, own)
    elif faults.n_turned and thing.role == "GLASS":
        yield _on_turned(thing, faults, own)
    elif is_inside_out and thing.role == "GLASS":
        yield _on_inward(thing, n_open)


def _on_facets(thing: Thing, faults: Counts, own: Counts) -> Entry:
    """A curve drawn by flat faces. If some are turned round, or their vertices are not merged, it
    is a file that lists triangle by triangle, and no look that is wanted.
    """
    text = Message(
        "'{name}' looks curved, but its {n} faces are flat.",
        name=thing.named.name,
        n=faults.n_facets,
    )
    if faults.n_turned and thing.role == "GLASS":
        text = joined([text, _on_turned(thing, faults, own).text])
    is_brought = own.n_turned or own.n_loose
    label = Message("Shade Smooth")
    if is_brought:
        label = Message("Merge, Recalculate Normals and Shade Smooth")
    button = Button("kiriko.shade_smooth", label, naming(thing.named), "SPHERECURVE")
    return Entry(text, PROBLEM if is_brought else ADVICE, (button,))


def _on_turned(thing: Thing, faults: Counts, own: Counts) -> Entry:
    """Faces that look the other way than those beside them: the normals between them are wrong,
    which costs nothing where they are flat.
    """
    n = own.n_turned or faults.n_turned
    values = {"name": thing.named.name, "n": n, "s": "s" if n > 1 else ""}
    mend = turn_out(thing) if own.n_turned else select_part(thing.named)
    if faults.is_turned_smooth:
        text = Message(
            "'{name}' has {n} face{s} turned round beside others: light there is bent wrongly.",
            **values,
        )
        return Entry(text, PROBLEM, (mend,))
    text = Message(
        "'{name}' has {n} face{s} turned round beside others: Kiriko knows it, Cycles does not.",
        **values,
    )
    return Entry(text, ADVICE, (mend,))


def turn_out(thing: Thing) -> Button:
    """The button that has all faces look out of the glass."""
    return Button("kiriko.turn_out", Message("Turn Out"), naming(thing.named), "NORMALS_FACE")


def _on_inward(thing: Thing, n_open: int) -> Entry:
    """Faces that look into the glass. Of a closed one it is known where it is."""
    name = thing.named.name
    button = turn_out(thing)
    if n_open:
        text = Message("The faces of '{name}' look into the glass.", name=name)
        return Entry(text, PROBLEM, (button,))
    text = Message(
        "The faces of '{name}' look into the glass: Kiriko knows it, Cycles does not.", name=name
    )
    return Entry(text, ADVICE, (button,))


def _on_surplus(thing: Thing, faults: Counts, own: Counts) -> Iterator[Entry]:
    """Faces that lie on others, as after Shift D in edit mode, and those inside the body."""
    if faults.n_double:
        n = own.n_double or faults.n_double
        text = Message(
            "'{name}' has {n} face{s} twice, one on the other.",
            name=thing.named.name,
            n=n,
            s="s" if n > 1 else "",
        )
        remove = Button("kiriko.remove_doubles", "Remove", naming(thing.named), "AUTOMERGE_ON")
        yield Entry(text, PROBLEM, (*_select(thing, "DOUBLE", own.n_double), remove))

    if faults.n_inner:
        n = own.n_inner or faults.n_inner
        text = Message(
            "'{name}' has {n} face{s} inside, which Kiriko leaves out and Cycles does not.",
            name=thing.named.name,
            n=n,
            s="s" if n > 1 else "",
        )
        remove = Button("kiriko.remove_inner", Message("Remove"), naming(thing.named), "X")
        mends = (*_select(thing, "INNER", own.n_inner), remove) if own.n_inner else ()
        yield Entry(text, ADVICE, mends or (select_part(thing.named),))


def _on_cuts(thing: Thing, faults: Counts, own: Counts) -> Entry:
    """Faces that cut each other, and the remedy where those are curved."""
    n = own.n_cut or faults.n_cut
    values = {"name": thing.named.name, "n": n, "s": "s" if n > 1 else ""}
    mends = _select(thing, "CUT", own.n_cut) or (select_part(thing.named),)
    if faults.n_open:
        text = Message("'{name}' cuts itself at {n} face{s}, where light may be lost.", **values)
        return Entry(text, PROBLEM, mends)

    told = Message(
        "'{name}' cuts itself at {n} face{s}: Kiriko counts it as one body, Cycles does not.",
        **values,
    )
    if not faults.is_cut_curved or thing.has_facets:
        return Entry(told, ADVICE, mends)
    curved = Message("It is curved, and may lose some light there: set its Surface to As Drawn.")
    return Entry(joined([told, curved]), ADVICE, (*mends, *_as_drawn(thing)))


def _select(thing: Thing, kind: str, n: int) -> tuple[Button, ...]:
    if not n:
        return ()
    properties = naming(thing.named, kind=kind)
    return (Button("kiriko.select_faults", Message("Select"), properties, "RESTRICT_SELECT_OFF"),)


def _as_drawn(thing: Thing) -> tuple[Button, ...]:
    """The button that has its facets followed; linked objects are set in their own file."""
    if thing.named.library:
        return ()
    # a name in quotation marks, as Python and so Blender's operator reads it
    path = f"blend_data.objects[{json.dumps(thing.named.name)}].kiriko.surface"
    values = (("data_path", path), ("value", "FACETS"))
    return (Button("wm.context_set_enum", Message("As Drawn"), values, "MESH_ICOSPHERE"),)


def thicken(thing: Thing) -> Button:
    """The button that gives an object a thickness."""
    return Button("kiriko.thicken", Message("Thicken"), naming(thing.named), "MOD_SOLIDIFY")


LARGEST = 0.5  # m: glass that is wider was hardly meant to be
MEANT = 0.1  # m: the width it was meant to have is a power of ten smaller, and at most this
WORTH = 0.005  # share of the picture: less that is lost needs nobody's hand

# Remedies for a share of the picture that is lost, by its reason: the words after the share,
# and the buttons. Operators that make a part as large as needed add themselves here.
# Where remedies were found they stand in their place, with their amounts.
FIT_PICTURE = Button("kiriko.fit_picture_size", Message("Fit Picture"))
FIT_PLATE = Button("kiriko.fit_plate", Message("Fit Plate"))
FIT_DISPLAY = Button("kiriko.fit_display", Message("Fit Display"))
BEST_PLACE = Button("kiriko.best_place", Message("Best Place"))
TURN_BACK = Button("kiriko.turn_back", Message("Turn It Back"))
REMEDIES: dict[str, tuple[Message, tuple[Button, ...]]] = {
    REASON_WORDS[Reason.MISSED_PLATE]: (
        Message("make the plate larger, or the picture smaller"),
        (FIT_PLATE, FIT_PICTURE),
    ),
    REASON_WORDS[Reason.MISSED_DISPLAY]: (
        Message("make the display larger, or the picture smaller"),
        (FIT_DISPLAY, FIT_PICTURE),
    ),
    REASON_WORDS[Reason.MISSED_GLASS]: (
        Message("move the picture into the glass, or make it smaller"),
        (BEST_PLACE, FIT_PICTURE),
    ),
    REASON_WORDS[Reason.LOST_INSIDE]: (
        Message("turn the glass, or make the picture smaller"),
        (TURN_BACK, FIT_PICTURE),
    ),
}
BY_OPERATOR = {b.operator: b for b in (FIT_PLATE, FIT_DISPLAY, FIT_PICTURE, BEST_PLACE)}
# remedies for a picture that is hard to recognise: words and icons of the buttons
TO_READ = {
    SMOOTH_GLASS: (Message("Smooth Glass"), "MOD_SMOOTH"),
    MOVE_TO_GLASS: (Message("Move to Glass"), "SNAP_FACE"),
}
# remedies for any loss; those for plate and display mend losses there
FOR_ALL = (FIT_PICTURE.operator, BEST_PLACE.operator)


def entries(look: Look, length_text: Callable[[float], str]) -> list[Entry]:
    """All that is left to do, the gravest first.

    length_text : a length, m, in words
    """
    found = [
        *on_lost(look),
        *on_missing(look),
        *on_viewers(look),
        *on_too_many(look),
        *on_hidden(look),
        *on_in_glass(look),
        *on_tiles(look),
        *(entry for thing in shown(look) for entry in _on_thing(thing)),
        *_on_display(look, length_text),
        *_on_result(look, length_text),
        *_on_size(look, length_text),
    ]
    return sorted(found, key=lambda entry: entry.icon == ADVICE)


def findings(look: Look) -> Iterator[Entry]:
    """Of them those on the shape of the glass, and on glass left out, which a result has as notes
    where nobody sees the checklist.
    """
    yield from on_in_glass(look)
    for thing in shown(look):
        yield from _on_shape(thing)


def _on_thing(thing: Thing) -> Iterator[Entry]:
    """The trouble with one part that is shown."""
    name = thing.named.name
    mend = _make_glass(thing) if thing.has_place else select_part(thing.named)
    if thing.thin_walls:
        yield from (Entry(text, PROBLEM, (mend,)) for text in thing.thin_walls[:1])
    elif thing.is_opaque and not thing.has_place:
        text = Message(
            "'{name}' is no glass: give it a material that refracts, in the file that it is linked"
            " from.",
            name=name,
        )
        yield Entry(text, PROBLEM, (mend,))
    elif thing.is_opaque:
        text = Message("'{name}' is no glass: its material does not refract.", name=name)
        yield Entry(text, PROBLEM, (mend,))

    if thing.shows_opaque:
        text = Message(
            "'{name}' is no glass: give the objects of its collection a material that refracts.",
            name=name,
        )
        yield Entry(text, PROBLEM, (select_part(thing.named),))

    if thing.n_indices > 1:
        text = Message(
            "'{name}' has {n} indices of refraction, and counts as of one: make a closed object"
            " of each.",
            name=name,
            n=thing.n_indices,
        )
        yield Entry(text, PROBLEM, (select_part(thing.named),))

    if thing.is_pictureless:
        yield Entry(thing.is_pictureless, PROBLEM, (choose_image(),))

    yield from _on_shape(thing)


def _make_glass(thing: Thing) -> Button:
    """The button that gives an object a material that refracts."""
    return Button("kiriko.make_glass", Message("Make It Glass"), naming(thing.named), "MATSPHERE")


def _on_shape(thing: Thing) -> Iterator[Entry]:
    """The trouble with the size of a part, its thickness and its mesh."""
    name = thing.named.name
    if thing.has_no_scale or thing.has_no_place:
        text = Message("'{name}' is scaled to nothing.", name=name)
        label = Message("Reset") if thing.has_no_place else Message("Reset Scale")
        button = Button("kiriko.reset_scale", label, naming(thing.named), "LOOP_BACK")
        yield Entry(on_no_place(name) if thing.has_no_place else text, PROBLEM, (button,))
    elif thing.is_empty:
        text = Message("'{name}' has no faces: give it some, or set its role to None.", name=name)
        yield Entry(text, PROBLEM, (select_part(thing.named),))
    elif thing.is_flat and thing.role == "GLASS":
        text = Message("'{name}' is flat, and glass has to have a thickness.", name=name)
        yield Entry(text, PROBLEM, (thicken(thing),))
    elif thing.faults is not None and not thing.is_flat:
        for entry in on_mesh(thing, thing.faults, thing.own_faults or Counts()):
            yield replace(entry, can_wait=entry.icon == ADVICE)


def _on_result(look: Look, length_text: Callable[[float], str]) -> Iterator[Entry]:
    """Is there one, of the scene as it is, of all of the picture?"""
    if look.missing:
        return
    if look.is_coarse or look.is_stale or look.lacks_numbers:
        if not look.is_followed:
            yield _solve(look)
        return

    if look.legibility is not None and look.legibility < READABLE:
        yield replace(_illegible(look), can_wait=True)
    yield from _once(_losses(look, length_text))


def _on_display(look: Look, length_text: Callable[[float], str]) -> Iterator[Entry]:
    """A display that Add Rig has made as large as the outermost light asks for."""
    for thing in shown(look):
        if thing.role == "DISPLAY" and thing.width > look.for_most > 0:
            text = Message(
                "'{name}' measures {length}: {share} of its light needs less.",
                name=thing.named.name,
                length=length_text(thing.width),
                share=percent(MOST),
            )
            label = Message("Take {width}", width=length_text(look.for_most))
            button = replace(FIT_DISPLAY, label=label, properties=(("share", MOST),))
            yield Entry(text, ADVICE, (button,), can_wait=True)


def _illegible(look: Look) -> Entry:
    """A picture that nobody recognises, with the remedies that were measured."""
    texts, buttons = [illegible(look.legibility)], []
    for help in look.legible_by:
        label, icon = TO_READ[help.operator]
        share = percent(help.after)
        texts.append(Message("{button} raises it to {share}.", button=label, share=share))
        each = [(("take", True),)]
        if help.part:
            names = (thing.named for thing in look.things if thing.named.name == help.part)
            each = [naming(named, iterations=round(help.amount)) for named in names]
        buttons += [Button(help.operator, label, given, icon) for given in each]
    return Entry(joined(texts), ADVICE, tuple(buttons))


def _once(found: Iterable[Entry]) -> Iterator[Entry]:
    """Advice on a result, with each button at the first entry alone that has it: one press mends
    for all of them.
    """
    pressed: set[Button] = set()
    for entry in found:
        left = tuple(button for button in entry.buttons if button not in pressed)
        yield replace(entry, buttons=left, can_wait=True)
        pressed.update(entry.buttons)


def _losses(look: Look, length_text: Callable[[float], str]) -> Iterator[Entry]:
    """Parts of the picture that are lost, the largest first, with what helps."""
    told = set()
    for reason, share in sorted(look.misses.items(), key=lambda miss: -miss[1]):
        if reason in REMEDIES and share >= WORTH:
            remedy, buttons = _remedy(look, reason, length_text)
            yield Entry(_loss(share, reason, remedy), ADVICE, buttons)
            told.add(reason)
    for reason in [reason for reason in REMEDIES if reason not in told]:
        # the viewer that loses most of it: what helps was sought for the one that is shown
        losses = [(of.get(reason, 0.0), name) for name, of in look.misses_of_others.items()]
        share, name = max(losses, default=(0.0, ""))
        if share >= WORTH:
            remedy, buttons = REMEDIES[reason]
            loss = _loss(share, reason, remedy)
            yield Entry(
                Message("'{viewer}': {summary}", viewer=name, summary=loss), ADVICE, buttons
            )


def _solve(look: Look) -> Entry:
    """A result that is not whole, or not of the scene as it is."""
    solve = (Button(SOLVE, Message("Solve"), (), "LIGHT_SUN"),)
    if look.is_coarse:
        return Entry(Message("The source image is a first, coarse one."), PROBLEM, solve)
    if look.is_stale:
        return Entry(Message("The scene has changed since it was solved."), PROBLEM, solve)
    return Entry(Message("The source image has no numbers yet."), ADVICE, solve)


def _loss(share: float, reason: str, remedy: Message) -> Message:
    return Message(
        "{share} of the picture {reason}: {remedy}.",
        share=percent(share),
        reason=as_message(reason),
        remedy=remedy,
    )


def _remedy(
    look: Look, reason: str, length_text: Callable[[float], str]
) -> tuple[Message, tuple[Button, ...]]:
    """The words and buttons for a loss: with amounts where remedies were sought."""
    remedy, buttons = REMEDIES[reason]
    if look.helps is None:
        return remedy, buttons

    fits = {button.operator for button in buttons} | set(FOR_ALL)
    found = [help for help in look.helps if help.operator in fits]
    clauses = [help.told(length_text) for help in found]
    mends = [BY_OPERATOR[help.operator] for help in found]
    if not found or TURN_BACK in buttons:
        clauses.append(Message("turn the glass"))
        mends.append(TURN_BACK)
    return joined(clauses, " / "), tuple(mends)


def meant_factors(width: float) -> list[float]:
    """Powers of ten that make a width, m, one of things that are held in a hand: at most MEANT
    and, where the scene gets smaller by that, too, at most LARGEST.
    """
    factor = 10.0 ** -(floor(log10(width / MEANT) - 1e-9) + 1)
    return [factor, 10 * factor] if factor < 0.05 and 10 * factor * width <= LARGEST else [factor]


def _on_size(look: Look, length_text: Callable[[float], str]) -> Iterator[Entry]:
    """Glass that was drawn in Blender's units, with no size in mind."""
    glass = [thing for thing in shown(look) if thing.role == "GLASS"]
    widest = max(glass, key=lambda thing: thing.width, default=None)
    if widest is None or widest.width <= LARGEST:
        return

    factors = meant_factors(widest.width)
    text = Message(
        "'{name}' measures {length}: meant as {meant}?",
        name=widest.named.name,
        length=length_text(widest.width),
        meant=joined([millimetres(factor * widest.width) for factor in factors], " / "),
    )
    buttons = [
        Button(
            "kiriko.rescale_scene",
            Message("Scene in {times} of Its Size", times=f"1/{round(1 / factor)}"),
            (("factor", factor),),
            "EMPTY_ARROWS",
        )
        for factor in factors
    ]
    yield Entry(text, ADVICE, tuple(buttons))
