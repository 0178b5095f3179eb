"""Sentences for people: constant templates, the values that fill them, and their translation."""

import ast
import copy
import pickle
import string
from collections.abc import Container, Iterator
from pathlib import Path

from kiriko.core.base.errors import MeshError, RigError
from kiriko.core.base.messages import Length, Message, joined

ROOT = Path(__file__).parents[2]
ROOMS = "core", "operators", "panels"
ERRORS = {"KirikoError", "RigError", "MeshError", "ImageError", "UsageError"}
TEMPLATES = ERRORS | {"Message", "note", "warning"}  # calls that take a template and its values
TOLD_AGAIN = {"template"}  # names of templates that were checked where they were made
# calls that take a whole sentence, each by the place of it among the arguments
SENTENCES = {"Remark": 0, "report": -1, "poll_message_set": 0, "status_text_set": 0, "sentence": 2}


def test_a_message_is_its_sentence() -> None:
    """A message reads as its template filled in, and keeps template and values."""
    message = Message("The plate '{name}' has a pitch of {pitch:g} mm.", name="A{b}", pitch=0.5)
    assert message == "The plate 'A{b}' has a pitch of 0.5 mm."
    assert message.template == "The plate '{name}' has a pitch of {pitch:g} mm."
    assert message.values == {"name": "A{b}", "pitch": 0.5}


def test_text_without_values_stays_as_it_is() -> None:
    """Braces of a text that has no values are no places of values."""
    assert Message("{a} stays") == Message("{a} stays").sentence() == str(RigError("{a} stays"))


def test_another_order_of_words() -> None:
    """A translated template has its values in its own order, and messages among them, too."""
    german = {
        "{count} of the {thing} are off: turn it.": "Dreh es, denn {thing}: {count} daneben.",
        "glass '{name}'": "Glas '{name}'",
    }
    inner = Message("glass '{name}'", name="Ball")
    message = Message("{count} of the {thing} are off: turn it.", count="3 %", thing=inner)
    assert message == "3 % of the glass 'Ball' are off: turn it."
    assert message.sentence(lambda text: german[text]) == "Dreh es, denn Glas 'Ball': 3 % daneben."


def test_lengths_are_told_at_the_border() -> None:
    """A length reads in millimetres, and as the scene's people read it where that is known."""
    message = Message("Glass nearer than {gap} touches.", gap=Length(0.003))
    assert message == "Glass nearer than 3 mm touches."
    assert message.sentence(length_text=lambda metres: f"{metres:g} ells") == (
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
    assert both.sentence(lambda text: text.replace("One", "Eins")) == "Eins 1. Two."


def name_of(call: ast.Call) -> str:
    """The last name of the function that is called."""
    return getattr(call.func, "attr", getattr(call.func, "id", ""))


def calls(names: Container[str]) -> Iterator[tuple[str, ast.Call]]:
    """Calls of functions with these names, each with its place."""
    for room in ROOMS:
        for path in sorted((ROOT / room).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Call) and name_of(node) in names:
                    yield f"{path.relative_to(ROOT)}:{node.lineno}", node


def test_templates_are_constant() -> None:
    """No error, remark or report is made with an f-string: the template is constant, each of its
    places has a value by name, and each value a place.
    """
    n = 0
    for place, call in calls(TEMPLATES):
        template, *more = call.args
        is_again = getattr(template, "attr", getattr(template, "id", "")) in TOLD_AGAIN
        if is_again or any(keyword.arg is None for keyword in call.keywords):
            continue
        assert not more, place
        assert isinstance(template, ast.Constant), place
        parts = string.Formatter().parse(template.value)
        assert {name for _, name, _, _ in parts if name is not None} == {
            keyword.arg for keyword in call.keywords
        }, place
        n += 1

    assert n > 250


def made_names(tree: ast.AST) -> set[str]:
    """Names of a file that stand for a message: constants, variables, functions that return one."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign) and is_message(node.value, set()):
            names |= {target.id for target in node.targets if isinstance(target, ast.Name)}
        if isinstance(node, ast.FunctionDef) and getattr(node.returns, "id", "") == "Message":
            names.add(node.name)
    return names


def is_message(node: ast.AST, names: Container[str]) -> bool:
    """Is a value a message, as far as it can be told from its words?"""
    if isinstance(node, ast.Call):
        return name_of(node) in {"Message", "as_message", "joined", "quoted", *names}
    return getattr(node, "attr", getattr(node, "id", "")) in names


def test_messages_are_not_changed_as_texts() -> None:
    """A method of texts, as in `CHANGED.rstrip(".")`, would make a plain text of a message, which
    no language translates: none is called on a message, where that can be told by its name, nor in
    a value of one, as in `role=label.lower()`.
    """
    changes = {"rstrip", "strip", "lstrip", "lower", "upper", "capitalize", "title", "replace"}
    changes |= {"removesuffix", "removeprefix"}
    paths = [path for room in ROOMS for path in sorted((ROOT / room).rglob("*.py"))]
    paths = [path for path in paths if path.name != "command_line.py"]  # which is English
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in paths}
    shared = set().union(*map(made_names, trees.values()))
    shared = {name for name in shared if name.isupper() or name.endswith(("_label", "_words"))}

    for path, tree in trees.items():
        names = shared | made_names(tree)
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and name_of(node) in changes:
                owner = getattr(node.func, "value", None)
                assert not is_message(owner, names), f"{path.relative_to(ROOT)}:{node.lineno}"
            if isinstance(node, ast.Call) and name_of(node) in TEMPLATES:
                for value in (keyword.value for keyword in node.keywords):
                    is_changed = isinstance(value, ast.Call) and name_of(value) in changes
                    assert not is_changed, f"{path.relative_to(ROOT)}:{value.lineno}"


def test_sentences_are_not_put_together() -> None:
    """What is handed over as a whole sentence is a message or a name: no f-string, no sum of texts
    and no plain constant, which no language's file is asked for, could be translated.
    """
    n = 0
    for place, call in calls(SENTENCES):
        if len(call.args) > SENTENCES[name_of(call)] and call.args:
            text = call.args[SENTENCES[name_of(call)]]
            assert not isinstance(text, (ast.JoinedStr, ast.BinOp)), place
            assert not isinstance(getattr(text, "value", None), str), place
            n += 1
    assert n > 40
