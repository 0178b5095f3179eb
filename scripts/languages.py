"""Lists texts of the interface that a language is missing, and entries no longer used.

`python3 scripts/dev.py languages` prints both for each file of `languages/`, the missing ones as
entries that can be added to it; `--only ja_JP` looks at one.
"""

from __future__ import annotations

import argparse
import ast
import string
from collections.abc import Iterator
from pathlib import Path

from messages import TEMPLATES, constant, name_of

ROOT = Path(__file__).resolve().parents[1]
ROOMS = "core", "operators", "panels"
SHOWN = {"text", "heading", "title", "message", "confirm_text"}  # keywords of texts that are shown
# the command line, drawings and reports, which are English: scripts and others read them
ENGLISH = {
    "core/lab/drawing",
    "core/lab/measure",
    "operators/cli/command_line.py",
    "operators/cli/to_folder.py",
}
MAKERS = {"Workbench", "rectangle", "camera", "material", "data_name"}  # of parts with names
GRAMMAR = {"s"}  # endings of English plurals, which other languages do without


def files() -> Iterator[tuple[str, ast.AST]]:
    """The files whose texts are shown in the interface, each with its tree."""
    for room in ROOMS:
        for path in sorted((ROOT / room).rglob("*.py")):
            name = path.relative_to(ROOT).as_posix()
            if not any(name.startswith(other) for other in ENGLISH):
                yield name, ast.parse(path.read_text(encoding="utf-8"))


def sentences(with_frames: bool = False) -> dict[str, str]:
    """Templates of messages, and constant texts of panels and dialogues, each with its place.

    with_frames : include templates without words of their own, such as "{reason}."
    """
    found: dict[str, str] = {}
    for name, tree in files():
        for node in ast.walk(tree):
            for text in texts_of(node, name.startswith(("panels", "operators"))):
                if text and (with_frames or is_text(text)):
                    found.setdefault(text, f"{name}:{node.lineno}")
    return found


def texts_of(node: ast.AST, is_interface: bool) -> Iterator[str]:
    """The texts for people in one node."""
    if not isinstance(node, ast.Call):
        return
    if name_of(node) in TEMPLATES and node.args:
        yield constant(node.args[0])
    if name_of(node) == "lap" and node.args:
        yield constant(node.args[0]).capitalize()
    if name_of(node) in MAKERS:
        yield from (text for text in map(constant, node.args) if text.startswith("Kiriko "))
    if name_of(node) == "joined" and len(node.args) > 1:
        yield constant(node.args[1])
    if is_interface and name_of(node) in {"sentence", "labelled", "add_rig"}:
        yield from map(constant, node.args)
    if is_interface:
        for keyword in node.keywords:
            parts = keyword.value
            either = [parts.body, parts.orelse] if isinstance(parts, ast.IfExp) else [parts]
            if keyword.arg in SHOWN:
                yield from map(constant, either)


def is_text(text: str) -> bool:
    """Whether a text has words, commas or quotation marks besides its values."""
    own = "".join(literal for literal, *_ in string.Formatter().parse(text))
    return any(letter.isalpha() for letter in own) or own.strip() in {",", ";", "''"}


def labels(package: str) -> dict[str, str]:
    """Labels and tooltips of all registered classes, each with its place."""
    import bpy

    found: dict[str, str] = {}
    kinds = "Operator", "Panel", "Menu", "PropertyGroup", "AddonPreferences", "GizmoGroup"
    for kind in kinds:
        for cls in getattr(bpy.types, kind).__subclasses__():
            if getattr(cls, "is_registered", True) and cls.__module__.startswith(package):
                for text in texts_of_class(cls, kind):
                    found.setdefault(text, f"{cls.__module__}, {cls.__name__}")
    return {text: place for text, place in found.items() if text.strip()}


def texts_of_class(cls: type, kind: str) -> Iterator[str]:
    """Labels and tooltips of a class of Blender's and of its properties."""
    import bpy

    if kind not in {"PropertyGroup", "GizmoGroup"}:
        yield getattr(cls, "bl_label", "")
    rna = cls.bl_rna
    if kind == "Operator":
        room, name = cls.bl_idname.split(".")
        rna = getattr(getattr(bpy.ops, room), name).get_rna_type()
        yield rna.description

    inherited = rna.base.properties.keys() if rna.base else ()
    for prop in rna.properties:
        if prop.identifier in inherited or prop.name == prop.identifier:
            continue  # Blender's own, or never shown
        yield from (prop.name, prop.description)
        for item in getattr(prop, "enum_items_static_ui", ()):
            yield from (item.name, item.description)


def needed(kiriko: object, package: str) -> dict[str, str]:
    """All texts to translate, each with its place."""
    from importlib import import_module

    name = kiriko.__name__
    catalogue = import_module(f"{name}.core.rig.catalogue")
    roles = import_module(f"{name}.core.rig.rig").ROLES
    operators = import_module(f"{name}.operators")
    names = {*catalogue.PLATES, *catalogue.DISPLAYS}
    names |= {str(tip) for tip in operators.TIPS}  # which are filled in when they are registered

    nouns = {str(role.noun): "core/rig/roles.py, Role.noun" for role in roles}
    nouns |= {role.field: "core/rig/rig.py, Role.field" for role in roles if role.is_single}
    kinds = {product.kind: "core/rig/catalogue.py" for product in catalogue.DISPLAYS.values()}
    systems = import_module(f"{name}.core.bench.systems").SYSTEMS.values()
    parts = {part.name for system in systems for _, part in system.make().parts()}
    made = {
        f"Kiriko {part}": "core/bench/systems.py" for part in {*parts, *(r.label for r in roles)}
    }
    texts = {**nouns, **kinds, **labels(package), **sentences(), **made}
    return {text: place for text, place in texts.items() if text not in names}


def places_of(template: str) -> set[str]:
    """The names of a template's values, without endings of English plurals."""
    return {name for _, name, _, _ in string.Formatter().parse(template) if name} - GRAMMAR


def entry(text: str, place: str) -> str:
    """An entry of a language's file, to be filled in."""
    quoted = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'#: {place}\nmsgid "{quoted}"\nmsgstr ""\n'


def missing_in(texts: dict[str, str], wanted: dict[str, str]) -> list[str]:
    """Entries for the wanted texts that a language's texts are missing, or have empty."""
    return [entry(text, place) for text, place in wanted.items() if not texts.get(text)]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", metavar="LOCALE", help="this language alone")
    only = parser.parse_args().only
    from kiriko import languages
    from known.registered import registered

    kiriko = registered()
    wanted, frames = needed(kiriko, "kiriko"), sentences(with_frames=True)
    for locale in [only] if only else languages.locales():
        texts = languages.all_of(locale)
        missing = missing_in(texts, wanted)
        stale = [text for text in texts if text not in wanted and text not in frames]
        print(f"# {locale}: {len(texts)} texts, {len(missing)} missing, {len(stale)} not used\n")
        print(*missing, sep="\n")
        print(*(f"# not used: {text!r}" for text in stale), sep="\n")


if __name__ == "__main__":
    main()
