"""The border at which operators tell what they did, and where it can be translated."""

import importlib
from types import ModuleType, SimpleNamespace

import pytest

from extension import loaded

GERMAN = {
    "The glass '{glass}' has {n} gaps: close them.": "Schließ die {n} Lücken im Glas '{glass}'.",
    "{error} But {thing} was kept (Undo removes it).": "Es bleibt {thing}. {error}",
    "{reason}.": "{reason}!",
}


@pytest.fixture
def reporting(kiriko, monkeypatch) -> ModuleType:
    """Module operators.reporting, for people who read German."""
    module = loaded("operators.reporting")

    def in_german(text: str, context: str = "") -> str:
        return GERMAN.get(text, text)

    stand_in = SimpleNamespace(pgettext_iface=in_german, pgettext_rpt=in_german)
    monkeypatch.setattr(module, "translations", stand_in)
    return module


def test_another_order_of_words_at_the_border(reporting):
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
    reporting.report(operator, "INFO", reporting.Message(template, **values))
    reporting.report(operator, "INFO", reporting.Message("Wrote '{file}'.", file="a.png"))
    with reporting.errors_reported(operator, lambda: "a picture"):
        raise reporting.KirikoError(template, **values)
    needed = importlib.import_module(reporting.__name__.replace("reporting", "needed"))

    assert not needed.can_run(operator, ["No glass"])
    assert said == [
        ("INFO", "Schließ die 3 Lücken im Glas 'Ball'."),
        ("INFO", "Wrote 'a.png'."),
        ("ERROR", "Es bleibt a picture. Schließ die 3 Lücken im Glas 'Ball'."),
        ("POLL", "No glass!"),
    ]
