"""How is the house kept? `dev.py house [--checkout FOLDER]`; needs only Python.

Rooms are the folders of core, with operators and panels above them. An arrow goes from a room to
another that one of its files imports from; an arrow up goes to a room that stands higher in the
order of `ROOMS`. A floor is the longest way down from a room.

For each folder: files, their median and largest number of lines; functions, without signature and
docstring; tokens a line of code; blank lines in bodies; and how often "what" stands in 1000 words
of comments and docstrings. Last, constants that several files of core define.
"""

from __future__ import annotations

import argparse
import ast
import io
import re
import statistics
import tokenize
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = "core", "operators", "panels", "scripts", "tests"
# from the bottom to the top; tests/core/test_without_blender.py holds that order within core
ROOMS = (
    "core/base",
    "core/native",
    "core/rig",
    "core/files",
    "core/glass",
    "core/light",
    "core/map",
    "core/image",
    "core/solve",
    "core/bench",
    "core/lab/warp",
    "core/lab/atlas",
    "core/lab/farm",
    "core/lab/calibrate",
    "core/lab/drawing",
    "core/lab/measure",
    "core/blender",
    "core/blender/properties",
    "operators",
    "panels/overlay",
    "panels",
)
MOST_FILE_LINES = 600
MOST_BODY_LINES = 60
MOST_COLUMNS = 100
SILENT = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}
FUNCTIONS = ast.FunctionDef, ast.AsyncFunctionDef


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


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--checkout", type=Path, default=ROOT, metavar="FOLDER", help="another one")
    root = parser.parse_args().checkout
    print_rooms(root)
    for folder in FOLDERS:
        print_folder(folder, measured(root, folder))
    print_constants(root / "core")


# Rooms


def room_of(root: Path, path: Path) -> str:
    """The room of a file or a folder, which need not be written with its suffix; a room's glue to
    the kernel is in that room.
    """
    folder = path if path.is_dir() else path.parent
    return folder.relative_to(root).as_posix().replace("light/native", "light")


def arrows(root: Path) -> set[tuple[str, str]]:
    """Pairs of rooms, the first of which imports from the second."""
    found = set()
    for top in ("core", "operators", "panels"):
        for path in sorted((root / top).rglob("*.py")):
            room = room_of(root, path)
            found |= {(room, other) for other in asked(root, path)}
    return {(room, other) for room, other in found if room != other}


def asked(root: Path, path: Path) -> set[str]:
    """Rooms that a file imports from, by relative imports."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = path.parents[node.level - 1].joinpath(*(node.module or "").split("."))
            for alias in node.names:
                target = base / alias.name
                found.add(room_of(root, target if target.is_dir() else base))
    return {room for room in found if room.startswith(("core", "operators", "panels"))}


def print_rooms(root: Path) -> None:
    """Print how many rooms, floors and arrows there are, and which arrows go up."""
    found = arrows(root)
    names = {name for pair in found for name in pair}
    below = {name: {other for room, other in found if room == name} for name in names}

    def floor(name: str, above: tuple[str, ...] = ()) -> int:
        """The longest way down, which passes no room twice."""
        ways = [floor(other, (*above, name)) for other in below[name] if other not in above]
        return 1 + max(ways, default=-1)

    place = {name: number for number, name in enumerate(ROOMS)}
    up = sorted(f"{a} -> {b}" for a, b in found if place.get(b, -1) > place.get(a, len(ROOMS)))
    n_floors = 1 + max(floor(name) for name in names)
    print(f"rooms {len(names)}, floors {n_floors}, arrows {len(found)}, of them up {len(up)}")
    for arrow in up:
        print(f"    {arrow}")


# Files and functions


def measured(root: Path, folder: str) -> Measured:
    """The numbers of all files of a folder."""
    found = Measured()
    for path in sorted((root / folder).rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        lines = source.splitlines()
        name = path.relative_to(root).as_posix()

        found.file_lines[name] = len(lines)
        add_tokens(found, source, lines)
        add_bodies(found, name, ast.parse(source), lines)
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

    words = re.findall(r"[a-z']+", " ".join(found.prose).lower())
    body_lines = list(found.body_lines.values())
    long_files = sum(lines > MOST_FILE_LINES for lines in found.file_lines.values())
    long_bodies = sum(lines > MOST_BODY_LINES for lines in body_lines)
    median = statistics.median(found.file_lines.values())
    print(
        f"{folder:<10} files {len(found.file_lines)}, median {median:.0f},"
        f" over {MOST_FILE_LINES} {long_files}, largest {max(found.file_lines.values())};"
        f" functions over {MOST_BODY_LINES} {long_bodies}, largest {max(body_lines)}\n"
        f"{'':<10} tokens a line {found.n_tokens / found.n_code_lines:.1f},"
        f" over {MOST_COLUMNS} columns {found.n_long_lines / found.n_code_lines:.1%},"
        f" blank lines in bodies {found.n_blank_lines / sum(body_lines):.1%},"
        f" 'what' {1000 * words.count('what') / len(words):.1f} in 1000 words"
    )


def print_constants(core: Path) -> None:
    """Print the constants that several files define."""
    where = defaultdict(set)
    for path in core.rglob("*.py"):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            for target in node.targets if isinstance(node, ast.Assign) else []:
                names = target.elts if isinstance(target, ast.Tuple) else [target]
                for name in names:
                    if isinstance(name, ast.Name) and name.id.isupper():
                        where[name.id].add(path.relative_to(core).as_posix())
    several = {name: sorted(files) for name, files in sorted(where.items()) if len(files) > 1}
    print(f"constants that several files of core define: {len(several)}")
    for name, files in several.items():
        print(f"    {name}: {', '.join(files)}")


if __name__ == "__main__":
    main()
