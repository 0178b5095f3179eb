"""The border at which operators tell what they did, and where it can be translated."""

import importlib
from types import ModuleType, SimpleNamespace

import pytest

GERMAN = {
    "The glass '{glass}' has {n} gaps: close them.": "Schließ die {n} Lücken im Glas '{glass}'.",
    "{error} {thing} stays (Undo takes it back).": "{thing} bleibt. {error}",
    "{reason}.": "{reason}!",
}


@pytest.fixture
def telling(kiriko: ModuleType, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Module operators.telling, for people who read German."""
    module = importlib.import_module(f"{kiriko.__name__}.operators.telling")
    monkeypatch.setattr(module, "translate", lambda text: GERMAN.get(text, text))
    return module


def test_another_order_of_words_at_the_border(telling: ModuleType) -> None:
    """Reports, errors and reasons why a button is grey follow the translated template's order of
    words; a sentence without a translation stays as it is.
    """
    said = []
    values = {"glass": "Ball", "n": 3}
    template = "The glass '{glass}' has {n} gaps: close them."
    operator = SimpleNamespace(
        report=lambda level, text: said.append((*level, text)),
        poll_message_set=lambda text: said.append(("POLL", text)),
        bl_label="Solve",
    )
    telling.report(operator, "INFO", telling.Message(template, **values))
    telling.report(operator, "INFO", telling.Message("Wrote '{file}'.", file="a.png"))
    with telling.told(operator, lambda: "a picture"):
        raise telling.KirikoError(template, **values)
    needed = importlib.import_module(telling.__name__.replace("telling", "needed"))

    assert not needed.can_run(operator, ["No glass"])
    assert said == [
        ("INFO", "Schließ die 3 Lücken im Glas 'Ball'."),
        ("INFO", "Wrote 'a.png'."),
        ("ERROR", "A picture bleibt. Schließ die 3 Lücken im Glas 'Ball'."),
        ("POLL", "No glass!"),
    ]
