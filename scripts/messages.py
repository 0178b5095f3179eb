"""All sentences for people, filled in with sample values, to be read aloud.

`python3 scripts/dev.py messages`, and `--only WORD` for sentences with a word. Errors, remarks and
reports come first, room by room; then labels and tooltips. Rewrite a sentence that has to be read
twice: the subject first, one colon at most, the fault, the place, the remedy.
"""

from __future__ import annotations

import argparse
import ast
import string
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TEMPLATES = {
    "ImageError", "InsideGlassError", "KirikoError", "MeshError", "Message", "OffFromStartError",
    "RigError", "UsageError", "note", "warning",
}  # fmt: skip
TOLD = {"description", "help", "text", "title", "message"}  # keywords with a text for people
OF_SHADER = "void main()"  # in code that nobody reads
SAMPLES = {
    "name": "Ball", "glass": "Ball", "part": "Ball", "parts": "flat display, one plate",
    "plate": "Plate", "picture": "Picture", "viewer": "Camera", "display": "Display",
    "camera": "Camera.001", "owner": "The glass 'Ball'", "image": "harbour.png",
    "shown": "old.png", "material": "Glass", "materials": "'Glass'", "collection": "Bench",
    "file": "rig.png", "files": "report.csv, report.json", "path": "/home/ada/rig.png",
    "folder": "/home/ada/out", "library": "Kiriko", "why": "it is an instance",
    "reason": "No glass", "remedy": "close other programs", "remedies": "raise Display Limit",
    "share": "12 %", "drawn": "12 %", "curved": "88 %", "best": "40 %", "leaked": "60 %",
    "role": "Glass", "kind": "a movie", "noun": "glass", "field": "displays", "s": "s",
    "names": "'Ball', 'Bowl'", "listed": "1.33, 1.49", "gap": "0.003 mm", "length": "488 mm",
    "by": " in viewports", "where": "left of it", "place": "no file", "hint": "",
    "error": "0.12", "thing": "the rough image", "button": "Solve", "work": "Solve",
    "state": "the scene is unchanged",
    "text": "The whole picture fits on the display (300 mm wide).", "label": "Diffuse",
    "squeezed": "squeezed to 80 % of its width", "size": "4 x 4", "phrase": "reading the scene",
    "article": "a", "suffix": ".tif", "preset": "ASKA3D-488", "ignored": "Base Color",
    "stop": "Esc stops", "part0": "", "points": "(1, 2), (3, 4)", "problems": "points seem swapped",
    "point": "(1, 2)", "one": "(1, 2)", "other": "(2, 1)", "who": "'Ball' and 'Bowl'",
    "first": "Ball", "last": "Bowl", "rest": "", "setting": "Roughness", "marks": "dots",
    "way": "upside down", "amounts": "Plate: shift x", "errors": "mesh about 0.1 px",
    "side": "left", "space": "ACEScg", "engines": "EEVEE", "modifier": "Subdivision",
    "unit": "mm", "condition": "30", "source": "Glass BSDF", "before": "Old Material",
    "theirs": "Screen", "ours": "Display Source", "page": "Asset Libraries", "display_size": "1 m",
    "changed": "The scene has changed: solve again.", "taken": "", "stays": "", "more": "",
    "measured": "lattice.jpg", "details": "calibration.json", "kept": "An offset is",
}  # fmt: skip


class Sample(str):
    """A text for any place of a template, whatever its format."""

    def __format__(self, spec: str) -> str:
        try:
            return format(float(3), spec) if spec else str(self)
        except ValueError:
            return "3"


def filled(template: str) -> str:
    """A template with sample values in its places."""
    names = {name for _, name, _, _ in string.Formatter().parse(template) if name}
    return template.format(**{name: Sample(SAMPLES.get(name, "3")) for name in names})


def constant(node: ast.AST) -> str:
    """The text of a constant, '' of anything else."""
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""


def name_of(call: ast.Call) -> str:
    """The last name of the called function."""
    return getattr(call.func, "attr", getattr(call.func, "id", ""))


def sentences(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Templates of errors, remarks, notes and reports, each with its line."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and name_of(node) in TEMPLATES and node.args:
            text = constant(node.args[0])
            if " " in text:
                values = filled(text) if node.keywords else text
                yield node.lineno, values


def labels(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Tooltips and labels: descriptions of properties, texts of panels, first lines of operators;
    and phrases in tables, such as why a button is grey.
    """
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef) and "_OT_" in node.name:
            yield node.lineno, ast.get_docstring(node) or ""
        elif isinstance(node, ast.keyword) and node.arg in TOLD:
            yield node.value.lineno, constant(node.value)
        elif isinstance(node, (ast.Tuple, ast.List)):
            yield from ((part.lineno, constant(part)) for part in node.elts)
        elif isinstance(node, ast.Dict):
            yield from ((part.lineno, constant(part)) for part in node.values)
        elif isinstance(node, ast.Assign):
            yield node.lineno, constant(node.value)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", default="", metavar="WORD", help="only those with this word")
    only = parser.parse_args().only
    n = 0
    for title, find in (("ERRORS, REMARKS, REPORTS", sentences), ("LABELS, TOOLTIPS", labels)):
        print(f"{title}\n")
        for room in ("core", "operators", "panels"):
            for path in sorted((ROOT / room).rglob("*.py")):
                tree = ast.parse(path.read_text(encoding="utf-8"))
                found = [text for _, text in sorted(find(tree)) if " " in text.strip()]
                told = [
                    text for text in dict.fromkeys(found) if only in text and OF_SHADER not in text
                ]
                if told:
                    print(path.relative_to(ROOT).as_posix())
                    print(*(f"    {text}" for text in told), sep="\n")
                    n += len(told)
        print()
    print(f"{n} sentences")


if __name__ == "__main__":
    main()
