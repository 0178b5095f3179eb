"""Small mutants of Python source: where they can be made,
their kinds, and which of them are taken.

A mutant is one node of the syntax tree in another form, put back into the text where the node
stood. Its name is made of its change, not of line numbers, so that a mutant keeps its name,
and its place in the draw, while other code is edited.
"""

from __future__ import annotations

import ast
import copy
import hashlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

MOST_SHOWN = 60  # letters of a node in a mutant's name

COMPARISONS = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
ARITHMETIC = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Pow: ast.Mult,
}
MASKS = {ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd}
PAIRS = (
    "min max",
    "minimum maximum",
    "fmin fmax",
    "argmin argmax",
    "floor ceil",
    "any all",
    "sin cos",
    "zeros ones",
)
SWAPPED = {a: b for pair in PAIRS for a, b in (pair.split(), reversed(pair.split()))}
# errors' words are no arithmetic
UNTOUCHED = (ast.Raise, ast.JoinedStr, ast.Assert, ast.Import, ast.ImportFrom)


@dataclass(frozen=True)
class Mutant:
    """One node in another form: bytes `start` to `end` of the
    file become `new`. Line is that of its statement.
    """

    file: str
    function: str
    line: int
    kind: str
    name: str
    start: int
    end: int
    new: str

    def put_into(self, source: str) -> str:
        """The file's text with the mutant in it; as many lines as before stand before it."""
        text = source.encode()
        return (text[: self.start] + self.new.encode() + text[self.end :]).decode()


def mutants_of(file: str, source: str) -> list[Mutant]:
    """All mutants of a file that can be made."""
    tree = ast.parse(source)
    found = []
    seen = Counter()
    begins = [0]
    for line in source.encode().splitlines(keepends=True):
        begins.append(begins[-1] + len(line))

    for function, statement, node in _nodes(tree):
        old = _shown(node)
        for kind, new in _forms(node):
            name = f"{file} {function} {kind}: {old} -> {_shown(new)}"
            seen[name] += 1
            if seen[name] > 1:
                name += f" #{seen[name]}"
            start = begins[node.lineno - 1] + node.col_offset
            end = begins[node.end_lineno - 1] + node.end_col_offset
            text = ast.unparse(new) if isinstance(new, ast.stmt) else f"({ast.unparse(new)})"
            found.append(Mutant(file, function, statement.lineno, kind, name, start, end, text))

    return found


def draw(
    mutants: Mapping[str, list[Mutant]], lines: Mapping[str, int], n: int, seed: int
) -> list[Mutant]:
    """About n mutants, over files by their lines; within a file the kinds take turns."""
    total = sum(lines.values())
    drawn = []
    for file in sorted(mutants):
        share = n * lines[file] / total
        # the rest of a share after whole mutants is a chance, the same for the same seed
        many = int(share) + (_lot(seed, file) < share % 1)
        kinds: dict[str, list[Mutant]] = {}
        for mutant in sorted(mutants[file], key=lambda m: _lot(seed, m.name)):
            kinds.setdefault(mutant.kind, []).append(mutant)
        turns = sorted(kinds, key=lambda kind: _lot(seed, file + kind))
        in_turn = [kinds[kind][k] for k in range(many) for kind in turns if k < len(kinds[kind])]
        drawn += in_turn[:many]

    return drawn


def _lot(seed: int, name: str) -> float:
    """A number from 0 to 1 that belongs to a name."""
    return int.from_bytes(hashlib.sha256(f"{seed} {name}".encode()).digest()[:6]) / 2**48


def _nodes(tree: ast.Module) -> Iterator[tuple[str, ast.stmt, ast.AST]]:  # noqa: C901 - one walk
    """Nodes that may be changed, with the function and the statement that they stand in."""

    def walk(
        node: ast.AST, function: str, statement: ast.stmt | None
    ) -> Iterator[tuple[str, ast.stmt, ast.AST]]:
        if isinstance(node, ast.stmt):
            statement = node
        if isinstance(node, UNTOUCHED):
            if isinstance(node, ast.Raise):
                yield function, node, node
            return

        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            function = node.name if function == "(module)" else f"{function}.{node.name}"
        elif statement is not None:
            yield function, statement, node

        for name, value in ast.iter_fields(node):
            if name in {"annotation", "returns", "decorator_list", "bases"}:
                continue
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from walk(child, function, statement)

    return walk(tree, "(module)", None)


def _forms(node: ast.AST) -> Iterable[tuple[str, ast.AST]]:  # noqa: C901 - a case each kind
    """Kinds and other forms of a node."""
    match node:
        case ast.Compare(ops=[first, *_]) if type(first) in COMPARISONS:
            return [
                ("comparison", _with(node, ops=[kind(), *node.ops[1:]]))
                for kind in COMPARISONS[type(first)]
            ]
        case ast.BinOp(op=op) if type(op) in ARITHMETIC:
            return [("arithmetic", _with(node, op=ARITHMETIC[type(op)]()))]
        case ast.BinOp(op=op) if type(op) in MASKS:
            return [("boolean", _with(node, op=MASKS[type(op)]()))]
        case ast.BoolOp(op=op):
            return [("boolean", _with(node, op=ast.Or() if isinstance(op, ast.And) else ast.And()))]
        case ast.UnaryOp(op=ast.USub(), operand=inner) if not isinstance(inner, ast.Constant):
            return [("sign", inner)]
        case ast.UnaryOp(op=ast.Not() | ast.Invert(), operand=inner):
            return [("boolean", inner)]
        case ast.Constant(value=bool(value)):
            return [("boolean", ast.Constant(not value))]
        case ast.Constant(value=int(value)):
            return [("constant", ast.Constant(value + 1))]
        case ast.Constant(value=float(value)):
            return [("constant", ast.Constant(2 * value if value else 1.0))]
        case ast.Name(id=name) if name in SWAPPED:
            return [("swap", ast.Name(SWAPPED[name], node.ctx))]
        case ast.Attribute(attr=name) if name in SWAPPED:
            return [("swap", _with(node, attr=SWAPPED[name]))]
        case ast.AugAssign(op=op) if type(op) in {**ARITHMETIC, **MASKS}:
            other = {**ARITHMETIC, **MASKS}[type(op)]()
            return [("arithmetic", _with(node, op=other)), ("removed", ast.Pass())]
        case ast.Expr(value=ast.Call()) | ast.Assign(targets=[ast.Subscript() | ast.Attribute()]):
            return [("removed", ast.Pass())]
        case ast.Continue() | ast.Raise():
            return [("removed", ast.Pass())]

    return []


def _with(node: ast.AST, **changed: object) -> ast.AST:
    """A copy of a node with some of its fields changed."""
    other = copy.copy(node)
    for name, value in changed.items():
        setattr(other, name, value)
    return other


def _shown(node: ast.AST) -> str:
    text = " ".join(ast.unparse(node).split())
    return text if len(text) <= MOST_SHOWN else text[: MOST_SHOWN - 3] + "..."
