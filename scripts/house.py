"""Figures of the house: `dev.py house [--checkout FOLDER]`; needs only Python.

`--files` prints the first sentence of each file instead, room by room, and `--files fold caustic`
the files with one of these words in their name or first sentence.

Rooms are the folders of core, with operators and panels above them. An arrow points from a room to
each room its files import from; an arrow up points to a higher room in the order of `ROOMS`. The
closure of one solve is `core/solve/session.py` and all its imports, at any depth. A circle is a set
of files that import each other. A lone file of core has one importer. Options are fields with a
default in records of options; constants are numbers.

For each folder: files, their median and largest number of lines; functions, without signature and
docstring; tokens per line of code; blank lines in bodies. `scripts/prose.py` adds figures of the
words.
"""

from __future__ import annotations

import argparse
import ast
import io
import re
import statistics
import tokenize
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import prose

ROOT = Path(__file__).resolve().parent.parent
PRODUCT = "core", "operators", "panels", "languages"
FOLDERS = "core", "operators", "panels", "scripts", "tests"
# from the bottom to the top; tests/core/test_without_blender.py enforces this order within core
ROOMS = (
    "core/base", "core/native", "core/rig", "core/files", "core/glass", "core/light",
    "core/map", "core/image", "core/solve", "core/bench", "core/lab/warp", "core/lab/atlas",
    "core/lab/farm", "core/lab/calibrate", "core/lab/drawing", "core/lab/measure",
    "core/blender/data", "core/blender/materials", "core/blender/read", "core/blender/properties",
    "core/blender/result", "core/blender/preview", "core/blender/view", "core/blender/lifecycle",
    "core/blender/checks", "operators", "panels/overlay", "panels",
)  # fmt: skip
MOST_FILE_LINES = 600
MOST_BODY_LINES = 60
MOST_COLUMNS = 100
SILENT = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT}
SILENT |= {tokenize.ENDMARKER}
FUNCTIONS = ast.FunctionDef, ast.AsyncFunctionDef
EXTENSION = re.compile(r"(role|law|interaction)_|__init__")  # may have a single importer
RECORD = re.compile(r"Knobs|Rule|Options|Search|Growth|Pace|Stages|Guess|Limits$")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--checkout", type=Path, default=ROOT, metavar="FOLDER", help="another one")
    parser.add_argument(
        "--files", nargs="*", metavar="WORD", help="the first sentence of each file"
    )
    arguments = parser.parse_args()
    root = arguments.checkout.resolve()
    if arguments.files is not None:
        print(*first_lines(root, arguments.files), sep="\n")
        return
    print(*prose.figures(root), sep="\n")
    print_imports(root)
    print_names(root)
    for folder in FOLDERS:
        print_folder(folder, measured(root, folder))


# Files


def first_lines(root: Path, words: Iterable[str] = ()) -> Iterator[str]:
    """Files by room, each with its first sentence."""
    room = ""
    for path in sorted(path for folder in FOLDERS for path in (root / folder).rglob("*.[pc]*")):
        name = path.relative_to(root)
        line = first_sentence(path)
        found = set(re.findall(r"[a-z]+", f"{name} {line}".lower().replace("_", " ")))
        if not line or not (not words or found & {word.lower() for word in words}):
            continue
        if name.parent.as_posix() != room:
            room = name.parent.as_posix()
            yield f"\n{room}"
        yield f"    {name.name:<28} {line}"


def first_sentence(path: Path) -> str:
    """The first sentence of a file of Python or C, from its docstring or comment."""
    text = path.read_text(encoding="utf-8") if path.suffix in (".py", ".c") else ""
    found = re.match(r'\s*(?:/\*|""")\s*(.*?)\s*(?:\n\s*\n|\.\s|"""|\*/)', text, re.DOTALL)
    return " ".join(found[1].split()) if found else ""


# Imports


@cache
def trees(root: Path, folder: str) -> dict[Path, ast.Module]:
    """The files of a folder, parsed."""
    paths = sorted((root / folder).rglob("*.py"))
    return {path: ast.parse(path.read_text(encoding="utf-8")) for path in paths}


@cache
def imports(root: Path) -> dict[Path, set[Path]]:
    """The files of the product imported by each file, at any depth."""
    files = {path: tree for folder in PRODUCT for path, tree in trees(root, folder).items()}
    found = {path: set() for path in files}
    for path, tree in files.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.level:
                base = path.parents[node.level - 1].joinpath(*(node.module or "").split("."))
                for name in node.names:
                    places = base / f"{name.name}.py", base / name.name / "__init__.py"
                    own = base.with_suffix(".py"), base / "__init__.py"
                    hit = next((place for place in (*places, *own) if place in files), path)
                    found[path].add(hit)
        found[path].discard(path)
    return found


def closure(graph: dict[Path, set[Path]], starts: Iterable[Path]) -> set[Path]:
    """All files needed by some files, without the files themselves unless they are in a circle."""
    found: set[Path] = set()
    todo = set(starts)
    while todo:
        todo = {other for one in todo for other in graph[one]} - found
        found |= todo
    return found


def room_of(root: Path, path: Path) -> str:
    """The room of a file; the command line is one of the operators'."""
    return path.parent.relative_to(root).as_posix().replace("operators/cli", "operators")


def arrows(root: Path) -> set[tuple[str, str]]:
    """Pairs of rooms; the first imports from the second."""
    graph = imports(root)
    pairs = {(room_of(root, a), room_of(root, b)) for a in graph for b in graph[a]}
    return {(a, b) for a, b in pairs if a != b and a != "languages" and b != "languages"}


def print_imports(root: Path) -> None:
    """Print the closure of one solve, circles, lone files and arrows."""
    graph = imports(root)
    core = [path for path in graph if path.is_relative_to(root / "core")]
    lines = {path: path.read_text(encoding="utf-8").count("\n") for path in graph}
    session = root / "core" / "solve" / "session.py"
    solve = closure(graph, [session]) | {session}
    reached = {path: closure(graph, [path]) for path in graph}
    circles = {frozenset(b for b in reached[a] if a in reached[b]) for a in graph}
    importers = Counter(other for path in graph for other in graph[path])
    lone = [p for p in core if importers[p] == 1 and not EXTENSION.match(p.name)]
    print(f"one solve: {len(solve)} files, {sum(lines[path] for path in solve)} lines")
    print(f"core: {len(core)} files, {sum(lines[path] for path in core)} lines")
    print(f"product: {len(graph)} files, {sum(lines.values())} lines")
    print(f"circles: {len(circles - {frozenset()})}; files of core with one importer: {len(lone)}")

    found = arrows(root)
    place = {name: number for number, name in enumerate(ROOMS)}
    up = sorted(f"{a} -> {b}" for a, b in found if place.get(b, -1) > place.get(a, len(ROOMS)))
    print(f"rooms: {len({name for pair in found for name in pair})}, arrows {len(found)}", end="")
    print(f", of them up {len(up)}", *up, sep="\n    ")


def print_names(root: Path) -> None:
    """Print options, constants, and names that occur twice."""
    core = trees(root, "core")
    every = {path: tree for folder in PRODUCT for path, tree in trees(root, folder).items()}
    classes = [
        node for tree in every.values() for node in tree.body if isinstance(node, ast.ClassDef)
    ]
    options = sum(
        isinstance(line, ast.AnnAssign) and line.value is not None
        for tree in core.values()
        for node in tree.body
        if isinstance(node, ast.ClassDef) and RECORD.search(node.name)
        for line in node.body
    )
    constants = [name for tree in core.values() for name in numbers(tree)]
    for what, names in (
        ("files", [path.stem for path in every if path.stem != "__init__"]),
        ("classes", [node.name for node in classes]),
        ("constants", constants),
    ):
        several = sorted(name for name, count in Counter(names).items() if count > 1)
        print(f"names that several {what} have: {len(several)}", *several)
    print(f"options: {options}, constants: {len(constants)}")


def numbers(tree: ast.Module) -> list[str]:
    """The names of a file's numeric constants."""
    return [
        target.id
        for node in tree.body
        if isinstance(node, ast.Assign) and is_number(node.value)
        for target in node.targets
        if isinstance(target, ast.Name) and target.id.isupper()
    ]


def is_number(value: ast.expr) -> bool:
    """Whether a node is a number, or an expression of numbers."""
    return isinstance(value, (ast.BinOp, ast.UnaryOp)) or (
        isinstance(value, ast.Constant) and type(value.value) in (int, float)
    )


# Files and functions


@dataclass
class Measured:
    """Numbers of a folder: lines of each file and body by name, counts, and all prose."""

    file_lines: dict[str, int] = field(default_factory=dict)
    body_lines: dict[str, int] = field(default_factory=dict)
    n_tokens: int = 0
    n_code_lines: int = 0
    n_long_lines: int = 0
    n_blank_lines: int = 0
    prose: list[str] = field(default_factory=list)


def measured(root: Path, folder: str) -> Measured:
    """The numbers of all files of a folder."""
    found = Measured()
    for path, tree in trees(root, folder).items():
        source = path.read_text(encoding="utf-8")
        lines = source.splitlines()
        name = path.relative_to(root).as_posix()
        found.file_lines[name] = len(lines)
        add_tokens(found, source, lines)
        add_bodies(found, name, tree, lines)
    return found


def add_tokens(found: Measured, source: str, lines: list[str]) -> None:
    """Count tokens and lines of code, and take up the comments."""
    code_lines = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            found.prose.append(token.string.lstrip("# "))
        elif token.type not in SILENT:
            found.n_tokens += 1
            code_lines.add(token.start[0])
    found.n_code_lines += len(code_lines)
    found.n_long_lines += sum(len(lines[number - 1]) > MOST_COLUMNS for number in code_lines)


def add_bodies(found: Measured, name: str, tree: ast.Module, lines: list[str]) -> None:
    """Count the lines of functions, and take up the docstrings."""
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, *FUNCTIONS)):
            found.prose.append(ast.get_docstring(node) or "")
        if isinstance(node, FUNCTIONS):
            inside = node.body[1:] if ast.get_docstring(node) else node.body
            numbers = range(inside[0].lineno, node.end_lineno + 1) if inside else range(0)
            found.body_lines[f"{name} {node.name} {node.lineno}"] = len(numbers)
            found.n_blank_lines += sum(not lines[number - 1].strip() for number in numbers)


def print_folder(folder: str, found: Measured) -> None:
    """Print the numbers of a folder, if it has files."""
    if not found.file_lines:
        return
    body_lines = list(found.body_lines.values())
    long_files = sum(lines > MOST_FILE_LINES for lines in found.file_lines.values())
    long_bodies = sum(lines > MOST_BODY_LINES for lines in body_lines)
    median = statistics.median(found.file_lines.values())
    print(
        f"{folder:<10} files {len(found.file_lines)}, lines {sum(found.file_lines.values())},"
        f" median {median:.0f},"
        f" over {MOST_FILE_LINES} {long_files}, largest {max(found.file_lines.values())};"
        f" functions over {MOST_BODY_LINES} {long_bodies}, largest {max(body_lines)}\n"
        f"{'':<10} tokens a line {found.n_tokens / found.n_code_lines:.1f},"
        f" over {MOST_COLUMNS} columns {found.n_long_lines / found.n_code_lines:.1%},"
        f" blank lines in bodies {found.n_blank_lines / sum(body_lines):.1%}"
    )


if __name__ == "__main__":
    main()
