"""Sentences for people: constant templates, the values that fill them, and their translation."""

import ast
import copy
import pickle
import string
from collections.abc import Iterator
from pathlib import Path

import pytest

from kiriko.core.errors import MeshError, RigError
from kiriko.core.messages import Length, Message, joined

ROOT = Path(__file__).parents[2]
TOLD = {"Message", "report", "tell", "note", "warning"}  # names of calls that take a template


def test_a_message_is_its_sentence() -> None:
    """A message reads as its template filled in, and keeps template and values."""
    message = Message("The plate '{name}' has a pitch of {pitch:g} mm.", name="A{b}", pitch=0.5)
    assert message == "The plate 'A{b}' has a pitch of 0.5 mm."
    assert message.template == "The plate '{name}' has a pitch of {pitch:g} mm."
    assert message.values == {"name": "A{b}", "pitch": 0.5}


def test_text_without_values_stays_as_it_is() -> None:
    """Braces of a text that has no values are no places of values."""
    assert Message("{a} stays") == Message("{a} stays").told() == str(RigError("{a} stays"))


def test_another_order_of_words() -> None:
    """A translated template has its values in its own order, and messages among them, too."""
    german = {
        "{count} of the {thing} are off: turn it.": "Dreh es, denn {thing}: {count} daneben.",
        "glass '{name}'": "Glas '{name}'",
    }
    inner = Message("glass '{name}'", name="Ball")
    message = Message("{count} of the {thing} are off: turn it.", count="3 %", thing=inner)
    assert message == "3 % of the glass 'Ball' are off: turn it."
    assert message.told(lambda text: german[text]) == "Dreh es, denn Glas 'Ball': 3 % daneben."


def test_lengths_are_told_at_the_border() -> None:
    """A length reads in millimetres, and as the scene's people read it where that is known."""
    message = Message("Glass nearer than {gap} touches.", gap=Length(0.003))
    assert message == "Glass nearer than 3 mm touches."
    assert message.told(length_text=lambda metres: f"{metres:g} ells") == (
        "Glass nearer than 0.003 ells touches."
    )


def test_messages_can_be_copied() -> None:
    """Copies, and errors that went through a pickle, still know template and values."""
    error = MeshError("{owner} is empty.", owner="X")
    for other in (copy.deepcopy(error), pickle.loads(pickle.dumps(error))):
        assert (str(other), other.message.values) == ("X is empty.", {"owner": "X"})


def test_joined_messages_are_translated_each() -> None:
    """Sentences that are told together keep their own templates."""
    both = joined([Message("One {a}.", a=1), "Two."])
    assert both == "One 1. Two."
    assert both.told(lambda text: text.replace("One", "Eins")) == "Eins 1. Two."


def name_of(call: ast.Call) -> str:
    """The last name of the function that is called."""
    return getattr(call.func, "attr", getattr(call.func, "id", ""))


def calls() -> Iterator[tuple[str, ast.Call]]:
    """Calls that take a template, each with its place."""
    for room in ("core", "operators", "panels"):
        for path in sorted((ROOT / room).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Call):
                    yield f"{path.relative_to(ROOT)}:{node.lineno}", node


def is_of_kiriko(name: str) -> bool:
    """Is it an error with a sentence for the user?"""
    return name in {"KirikoError", "RigError", "MeshError", "ImageError", "UsageError"}


@pytest.mark.parametrize(
    ("place", "call"),
    [(place, call) for place, call in calls() if is_of_kiriko(name_of(call))],
)
def test_errors_are_constant_templates(place: str, call: ast.Call) -> None:
    """No error is raised with an f-string: its template is constant, its values are all named."""
    template, *more = call.args
    assert not more, place
    if isinstance(template, ast.Attribute) and template.attr == "template":
        return  # of an error that is told anew
    assert isinstance(template, ast.Constant), place
    values = {keyword.arg for keyword in call.keywords}
    names = {name for _, name, _, _ in string.Formatter().parse(template.value) if name}
    assert names == values, place
