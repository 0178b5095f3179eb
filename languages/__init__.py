"""Languages of the interface: one file each, `<locale>.po`, which any editor of translations opens.

An entry is the English text, as it stands in the code, and the text for people who read it. Blender
asks for labels and tooltips by itself, `operators/reporting.py` for sentences. Entries count in
three contexts: Blender's own two, of labels and of operators' names, and Kiriko's, in which a word
has the meaning that it has here. Blender's own translations come before those of add-ons, so a word
that it has with another meaning ("Display", the verb) needs that context where it is shown.
"""

import ast
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import bpy

from ..core.base.messages import CONTEXT, Message

translations = bpy.app.translations
FOLDER = Path(__file__).parent
CONTEXTS = "*", "Operator", CONTEXT
Texts = dict[str, str]  # by the English ones


def locales() -> list[str]:
    """The languages there are, as Blender calls them."""
    return sorted(path.stem for path in FOLDER.glob("*.po"))


def texts_of(locale: str) -> Texts:
    """All texts in a language, without those that are still to be translated."""
    return {english: text for english, text in all_of(locale).items() if text}


def all_of(locale: str) -> Texts:
    """All texts in a language's file; '' for those that are still to be translated.

    A line is `msgid "..."`, `msgstr "..."`, a further part of either, or begins with #.
    """
    texts: Texts = {}
    entry: dict[str, str] = {}
    field = ""
    for line in (FOLDER / f"{locale}.po").read_text(encoding="utf-8").splitlines():
        head, quote, rest = line.partition('"')
        if line.startswith("#") or not quote:
            continue

        if head.strip():
            field = head.strip()
            entry[field] = ""
        entry[field] += ast.literal_eval(quote + rest)
        if field == "msgstr" and entry["msgid"]:  # an empty one is the header's
            texts[entry["msgid"]] = entry["msgstr"]

    return texts


@cache
def in_all(english: str) -> frozenset[str]:
    """An English text, and what it is in each of the languages."""
    return frozenset([english, *(texts_of(locale).get(english, english) for locale in locales())])


def entries_of(locale: str, filled: Iterable[Message] = ()) -> dict[tuple[str, str], str]:
    """The entries of a language, as Blender takes them: by context and English text.

    filled : messages that Blender looks up as a whole, with their values
    """
    texts = texts_of(locale)
    texts |= {
        str(message): message.sentence(lambda text: texts.get(text, text)) for message in filled
    }
    return {(context, english): text for english, text in texts.items() for context in CONTEXTS}


def register(filled: Iterable[Message]) -> None:
    """Hand all languages to Blender, which takes the one of its preferences at any time."""
    entries = {locale: entries_of(locale, filled) for locale in locales()}
    translations.register(__package__, entries)


def unregister() -> None:
    """Take them back."""
    translations.unregister(__package__)
