"""Findings on a part: conditions, each with a sentence and its buttons.

A part has at most one finding of each row, the first whose condition holds. Single steps in Blender
have no button: the sentence names Blender's own command.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

from ...base.messages import Message
from .to_do import ADVICE, PROBLEM, Button, Entry, Named, Thing


def naming(named: Named, **more: object) -> tuple[tuple[str, object], ...]:
    """Property values of a button for a part."""
    return (("part", named.name), ("library", named.library), *more.items())


def select_part(thing: Thing) -> Button:
    """The button for selecting an object."""
    label = Message("Select Part")
    return Button("kiriko.select_part", label, naming(thing.named), "RESTRICT_SELECT_OFF")


def choose_image(thing: Thing) -> Button:
    """The button for opening an image as the picture."""
    return Button("kiriko.open_picture", Message("Choose Image"), (), "FILE_FOLDER")


def make_glass(thing: Thing) -> Button:
    """The button for a glass material, labelled with its product."""
    label = Message("Make It Glass ({product})", product=Message("Acrylic"))
    return Button("kiriko.make_glass", label, naming(thing.named), "MATSPHERE")


def thicken(thing: Thing) -> Button:
    """The button for a thickness."""
    return Button("kiriko.thicken", Message("Thicken"), naming(thing.named), "MOD_SOLIDIFY")


def fill_holes(thing: Thing) -> Button:
    """The button for closing holes; selects the object if a modifier opens the edges."""
    if not thing.own_faults.n_open:
        return select_part(thing)
    return Button("kiriko.fill_holes", Message("Fill Holes"), naming(thing.named), "SNAP_FACE")


def turn_out(thing: Thing) -> Button:
    """The button for outward normals."""
    if not (thing.own_faults.n_turned or thing.own_faults.is_inside_out):
        return select_part(thing)
    label = Message("Recalculate Normals")
    return Button("kiriko.turn_out", label, naming(thing.named), "NORMALS_FACE")


def shade_smooth(thing: Thing) -> Button:
    """The button for smooth shading, after merging imported faces."""
    if not thing.own_faults.n_faces:
        return select_part(thing)
    label = Message("Shade Smooth")
    if is_brought(thing):
        label = Message("Merge and Shade Smooth")
    return Button("kiriko.shade_smooth", label, naming(thing.named), "SPHERECURVE")


def is_brought(thing: Thing) -> bool:
    """Whether a mesh has loose or flipped triangles, as imported files have: then flat shading is
    not intended.
    """
    return thing.own_faults.n_turned > 0 or thing.own_faults.n_loose > 0


def is_turned(thing: Thing) -> bool:
    """Whether glass has faces flipped against their neighbours."""
    return thing.role == "GLASS" and thing.faults.n_turned > 0


def is_facetted(thing: Thing) -> bool:
    """Whether a part has flat faces on a curved surface."""
    return thing.faults.n_facets > 0 and not thing.has_facets


class Finding(NamedTuple):
    """A finding.

    question : whether it applies to a part
    text : the sentence on the part
    buttons : make the part's buttons
    is_problem : whether it is a problem rather than advice
    """

    question: Callable[[Thing], object]
    text: Callable[[Thing], str]
    buttons: tuple[Callable[[Thing], Button], ...]
    is_problem: Callable[[Thing], bool] = lambda thing: True


def _counted(n: int, thing: Thing) -> dict[str, object]:
    return {"name": thing.named.name, "n": n, "s": "s" if n > 1 else ""}


def _and_flipped(thing: Thing) -> Message | str:
    n = thing.own_faults.n_turned or thing.faults.n_turned
    return Message(", and {n} are flipped", n=n) if n else ""


APPEARANCE = (
    (
        Finding(
            lambda thing: thing.is_opaque and not thing.has_place,
            lambda thing: Message(
                "The material of '{name}' isn't glass. Change it in the linked file.",
                name=thing.named.name,
            ),
            (select_part,),
        ),
        Finding(
            lambda thing: thing.is_opaque,
            lambda thing: Message("The material of '{name}' isn't glass.", name=thing.named.name),
            (make_glass,),
        ),
        Finding(
            lambda thing: thing.no_picture,
            lambda thing: thing.no_picture,
            (choose_image,),
        ),
    ),
)
SHAPE = (
    (
        Finding(
            lambda thing: thing.has_no_scale,
            lambda thing: Message(
                "'{name}' has a scale of zero. Use Object > Clear > Scale.", name=thing.named.name
            ),
            (select_part,),
        ),
        Finding(
            lambda thing: thing.is_flat and thing.role == "GLASS",
            lambda thing: Message(
                "'{name}' is flat. Glass needs a thickness.", name=thing.named.name
            ),
            (thicken,),
        ),
        Finding(
            lambda thing: thing.faults.n_open and thing.role == "GLASS" and not thing.is_mesh,
            lambda thing: Message(
                "'{name}' is not closed. Turn on Fill Caps, or choose another Fill Mode.",
                name=thing.named.name,
            ),
            (select_part, thicken),
        ),
        Finding(
            lambda thing: thing.faults.n_open and thing.role == "GLASS",
            lambda thing: Message(
                "'{name}' is not closed: {n} open edge{s} (Select > All by Trait > Non Manifold).",
                **_counted(thing.own_faults.n_open or thing.faults.n_open, thing),
            ),
            (fill_holes, thicken),
        ),
    ),
    (
        Finding(
            is_facetted,
            lambda thing: Message(
                "'{name}' looks curved, but its {n} faces are flat{flipped}.",
                name=thing.named.name,
                n=thing.faults.n_facets,
                flipped=_and_flipped(thing),
            ),
            (shade_smooth,),
            is_brought,
        ),
        Finding(
            is_turned,
            lambda thing: Message(
                "'{name}' has {n} flipped face{s}. Cycles renders them wrongly, and so does Kiriko"
                " if they are smooth.",
                **_counted(thing.own_faults.n_turned or thing.faults.n_turned, thing),
            ),
            (turn_out,),
            lambda thing: thing.faults.is_turned_smooth,
        ),
        Finding(
            lambda thing: thing.faults.is_inside_out and thing.role == "GLASS",
            lambda thing: Message("The normals of '{name}' point inward.", name=thing.named.name),
            (turn_out,),
            lambda thing: thing.faults.n_open > 0,
        ),
    ),
    (
        Finding(
            lambda thing: thing.faults.n_inner and thing.role == "GLASS",
            lambda thing: Message(
                "'{name}' has {n} interior face{s}. Kiriko ignores them, Cycles does not. Delete"
                " them (Select > All by Trait > Interior Faces).",
                **_counted(thing.own_faults.n_inner or thing.faults.n_inner, thing),
            ),
            (select_part,),
            lambda thing: False,
        ),
    ),
)


def findings_of(thing: Thing, rows: tuple[tuple[Finding, ...], ...]) -> Iterator[Entry]:
    """The findings of some rows on a part, as entries."""
    for row in rows:
        found = next((one for one in row if one.question(thing)), None)
        if found is not None:
            is_problem = found.is_problem(thing)
            buttons = tuple(make(thing) for make in found.buttons)
            icon = PROBLEM if is_problem else ADVICE
            yield Entry(found.text(thing), icon, buttons, can_wait=not is_problem)
