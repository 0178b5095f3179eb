"""Plain words: figures for `dev.py house`, and a check for `dev.py lint`; needs only Python.

Code is the docstrings and comments of the product, messages are its labels, tooltips and sentences,
docs are the English pages. The figures leave out others: errors of files, descriptions of buttons,
help of the command line. A text with an odd word fails the check, unless `ALLOWED` has it.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
CODE = "core", "operators", "panels"
DOCS = "*.md", "docs/**/*.md"
KINDS = "code", "messages", "docs"
ODD = re.compile(
    r"\b(told|tells?|telling|asked|beside|stands?|turned round|no more|is no|are no|of which"
    r"|by which|mend(s|ed)?)\b",
    re.IGNORECASE,
)
THAT = re.compile(r"\b(that|those|these|what)\b", re.IGNORECASE)
WORD = re.compile(r"[A-Za-z']+")
# plain uses of odd words, and names of code
ALLOWED = re.compile(
    r"`[^`\n]*`|^ *[\w, ]+ : |\w+\.py|Missed hits: \w+|\{\w+\}"
    r"|[Tt]here (is|are) no|(is|are) no \w+er\b"
    r"|(amount|angle|edge|factor|fraction|gain|m,|margin|pixels|px|size) by which"
    r"|(all|each|half|most|some) of which",
    re.MULTILINE,
)
DOCUMENTED = ast.Module, ast.ClassDef, ast.FunctionDef
SENTENCES = {"Message", "RigError", "MeshError", "KirikoError"}
LABELS = {"description", "name", "tip", "text"}
SHOWN = {  # kinds of the literals that people read
    ast.Call: {**dict.fromkeys(SENTENCES, "messages"), "ImageError": "others"},
    ast.keyword: {**dict.fromkeys(LABELS, "messages"), "help": "others"},
    ast.Assign: {"bl_description": "others"},
}


class Text(NamedTuple):
    """A text, with the file and line where it begins."""

    kind: str
    path: str
    line: int
    text: str


def texts(root: Path) -> Iterator[Text]:
    """All texts of a checkout."""
    for folder in CODE:
        for path in sorted((root / folder).rglob("*.py")):
            yield from texts_of(path.read_text(encoding="utf-8"), path.relative_to(root).as_posix())
    for path in sorted({path for pattern in DOCS for path in root.glob(pattern)}):
        name = path.relative_to(root).as_posix()
        if "/ja/" not in name and ".ja." not in name:
            yield Text("docs", name, 1, path.read_text(encoding="utf-8"))


def texts_of(source: str, name: str) -> Iterator[Text]:
    """Comments, docstrings and messages of a file."""
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield Text("code", name, token.start[0], token.string.lstrip("# "))
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node):
            docstring = node.body[0].value
            yield Text("code", name, docstring.lineno, docstring.value)
        elif (literal := literal_of(node)) is not None:
            yield Text(literal[0], name, node.lineno, literal[1])


def literal_of(node: ast.AST) -> tuple[str, str] | None:
    """The literal that people read, with its kind, of a call, a keyword or an assignment."""
    name, value = "", None
    if isinstance(node, ast.Call) and node.args:
        name, value = getattr(node.func, "id", getattr(node.func, "attr", "")), node.args[0]
    elif isinstance(node, ast.keyword):
        name, value = node.arg, node.value
    elif isinstance(node, ast.Assign):
        name, value = getattr(node.targets[0], "id", ""), node.value
    kind = SHOWN.get(type(node), {}).get(name)
    if kind is not None and isinstance(value, ast.Constant):
        return kind, str(value.value)
    if kind == "others" and isinstance(value, ast.JoinedStr):
        return kind, "".join(str(p.value) for p in value.values if isinstance(p, ast.Constant))
    return None


def odd_words(text: Text) -> list[str]:
    """Its odd words, each as `file:line: word`."""
    spans = [found.span() for found in ALLOWED.finditer(text.text)]
    return [
        f"{text.path}:{text.line + text.text.count(chr(10), 0, odd.start())}: {odd[0]}"
        for odd in ODD.finditer(text.text)
        if not any(start <= odd.start() < end for start, end in spans)
    ]


def figures(root: Path) -> list[str]:
    """Lines of figures: words, and odd ones in 1000, by kind."""
    every = list(texts(root))
    lines = []
    for kind in KINDS:
        parts = [text.text for text in every if text.kind == kind]
        n_words, odd, that = (sum(len(p.findall(t)) for t in parts) for p in (WORD, ODD, THAT))
        rates = [1000 * n / max(1, n_words) for n in (odd, that)]
        lines.append(
            f"{kind:<10} words {n_words}, different texts {len(set(parts))};"
            " in 1000 words: odd {:.1f}, that, those, these and what {:.1f}".format(*rates)
        )
    return lines


def main() -> None:
    found = [line for text in texts(ROOT) for line in odd_words(text)]
    print(*found, sep="\n")
    if found:
        sys.exit(f"{len(found)} odd words: write them plainly, or allow them in scripts/prose.py.")


if __name__ == "__main__":
    main()
