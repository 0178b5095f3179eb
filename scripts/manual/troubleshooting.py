"""The page *Troubleshooting*: each sentence as the program says it, and a line on what to do."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from manual.advice import SECTIONS
from messages import ROOT, TEMPLATES, constant, name_of

# the name of a language's texts in languages/
LANGUAGE = {"ja": "ja_JP"}
# the file that makes messages of errors which no code of Kiriko's foresaw
UNFORESEEN = ROOT / "operators" / "telling.py"


def told_in(path: Path) -> Iterator[str]:
    """Templates of the errors and remarks of a file of code."""
    kinds = TEMPLATES if path == UNFORESEEN else TEMPLATES - {"Message"}
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and name_of(node) in kinds and node.args:
            text = constant(node.args[0])
            if " " in text:
                yield text


def all_told() -> set[str]:
    """Templates of all errors and remarks of the code."""
    return {
        text
        for room in ("core", "operators", "panels")
        for path in (ROOT / room).rglob("*.py")
        for text in told_in(path)
    }


def readable(template: str) -> str:
    """A template with … in the place of values."""
    return re.sub(r"(\{[^}]*\})+", "…", template)


def translations(locale: str) -> dict[str, str]:
    """The interface's texts in a language, by the English ones; none where it has no file."""
    path = ROOT / "languages" / f"{locale}.po"
    if not path.exists():
        return {}
    texts: dict[str, str] = {}
    entry = {"msgid": "", "msgstr": ""}
    field = ""
    for line in path.read_text(encoding="utf-8").splitlines():
        head, quote, rest = line.partition('"')
        if line.startswith("#") or not quote:
            continue
        if head.strip():
            field = head.strip()
            entry[field] = ""
        entry[field] = entry.get(field, "") + ast.literal_eval(quote + rest)
        if field == "msgstr":
            texts[entry["msgid"]] = entry["msgstr"]
    return texts


def sections(language: str) -> str:
    """All sections of the page in a language, as Markdown."""
    texts = translations(LANGUAGE.get(language, ""))
    lines = []
    for section in SECTIONS:
        lines += [f"## {getattr(section, language)}", ""]
        for advice in section.advice:  # sentences with what to do under them
            lines += [term(template, texts) for template in advice.templates]
            lines += [f":   {getattr(advice, language)}", ""]
    return "\n".join(lines)


def term(template: str, texts: dict[str, str]) -> str:
    """A sentence in a language, and the English one where that is another."""
    sentence = texts.get(template) or template
    english = f"<br><small>{readable(template)}</small>" if sentence != template else ""
    return f"{readable(sentence)}{english}"
