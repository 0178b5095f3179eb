"""What the checklist tells of the mesh of a part: holes, cuts, faces without area, facets."""

import json
from collections.abc import Iterator

from ..base.messages import Message, joined
from .checklist_parts import naming, select_part
from .to_do import ADVICE, PROBLEM, Button, Counts, Entry, Thing


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
