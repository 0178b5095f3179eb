"""Points of a lattice from a file."""

import csv
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...base.arrays import Floats
from ...base.errors import ImageError
from ...base.messages import Message
from ...files.disk import read_bytes
from .check import missing_borders
from .drawn import Lattice
from .match import match


def read_points(path: Path | str, lattice: Lattice, expected: Floats) -> Floats:
    """Measured points (m, 2), px, of a CSV file; NaN where there are none.

    Its first line names its columns: column, row, x and y, in any order, the first two counted from
    1; or x and y alone, in which case `match` tells the points apart. Commas, semicolons or tabs
    between them; after semicolons a number may have a decimal comma.

    Parameters
    ----------
    expected : (m, 2) px, where the points are likely to be, NaN where they are not seen

    Raises
    ------
    ImageError : the file cannot be read, or has places that cannot be
    """
    table = _table(Path(path))
    measured = _measured(table, lattice)

    if not (measured.loose or measured.lines):
        raise ImageError("The file '{path}' has no points: choose another one.", path=table.path)
    if not measured.loose:
        return measured.named

    found = match(np.unique(measured.loose, axis=0), expected, lattice)
    missing = missing_borders(found, expected, lattice)
    if missing:
        raise ImageError(
            "In the file '{path}' {missing} is missing, so that its points cannot be told"
            " apart: complete it, or name the points (column, row, x, y).",
            path=table.path,
            missing=missing[0],
        )

    return found


class _Table(NamedTuple):
    """Lines of a file, by number, with their cells; the first has the names of n columns.

    places : the columns of x and y, or of column, row, x and y
    """

    path: Path
    lines: list[tuple[int, list[str]]]
    n_columns: int
    places: list[int]
    has_decimal_commas: bool


class _Measured(NamedTuple):
    """Points of a file: named ones (m, 2), px, NaN where there are none, with the lines that
    have them, by index; and places of others.
    """

    named: Floats
    lines: dict[int, int]
    loose: list[list[float]]


def _text(path: Path) -> str:
    """The text of a file, whatever its letters are."""
    data = read_bytes(path)
    try:
        text = data.decode("utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")  # notes in other letters do not matter

    if "\0" in text:
        raise ImageError("The file '{path}' is no text: choose a CSV file of points.", path=path)

    # spreadsheets begin so
    return text.partition("\n")[2] if text.lower().startswith("sep=") else text


def _table(path: Path) -> _Table:
    """The lines of a CSV file that are not empty."""
    text = _text(path)

    first = next((line for line in text.splitlines() if line.strip()), "")
    delimiter = max(",;\t", key=first.count)

    try:
        rows = csv.reader(text.splitlines(), delimiter=delimiter, strict=True)
        lines = [
            (rows.line_num, [cell.strip() for cell in row])
            for row in rows
            if any(c.strip() for c in row)
        ]
    except csv.Error as reason:
        raise ImageError(
            "The file '{path}' is no CSV file, see line {line} ({why}): repair it.",
            path=path,
            line=rows.line_num,
            why=reason,
        ) from None

    head = [name.lower() for name in lines[0][1]] if lines else []
    wanted = ["x", "y"] if {"column", "row"}.isdisjoint(head) else ["column", "row", "x", "y"]
    if any(head.count(name) != 1 for name in wanted):
        raise ImageError(
            "The file '{path}' does not begin with the names column, row, x, y, or x, y:"
            " add that line.",
            path=path,
        )

    return _Table(
        path=path,
        lines=lines[1:],
        n_columns=len(head),
        places=[head.index(name) for name in wanted],
        has_decimal_commas=delimiter == ";",
    )


def _measured(table: _Table, lattice: Lattice) -> _Measured:
    """The points of a table."""
    found = _Measured(np.full((len(lattice), 2), np.nan), {}, [])
    for number, cells in table.lines:
        where = partial(_line, number, table.path)
        if len(cells) <= max(table.places):
            raise ImageError(
                "{where} has {n_cells} of {n_columns} columns: complete or remove it.",
                where=where(),
                n_cells=len(cells),
                n_columns=table.n_columns,
            )

        values = [cells[place] for place in table.places]
        if table.has_decimal_commas:
            values = [value.replace(",", ".") for value in values]
        if values[-2:] == ["", ""] and len(values) == 4:
            continue  # a table of all points, with blanks for those not measured

        xy = [_number(value, where) for value in values[-2:]]
        if len(values) == 2:
            found.loose.append(xy)
            continue

        index = _index(values[:2], where, lattice)
        if index in found.lines:
            raise ImageError(
                "{where} has the point {point} of line {line} again: remove one.",
                where=where(),
                point=lattice.name(index),
                line=found.lines[index],
            )

        found.lines[index] = number
        found.named[index] = xy

    return found


def _line(number: int, path: Path) -> Message:
    return Message("Line {number} of '{path}'", number=number, path=path)


def _index(values: list[str], where: Callable[[], Message], lattice: Lattice) -> int:
    """The index of a point by its column and row, counted from 1."""
    column, row = (_number(value, where) for value in values)
    if not (column in range(1, lattice.columns + 1) and row in range(1, lattice.rows + 1)):
        raise ImageError(
            "{where} has a point ({column:g}, {row:g}), but columns run from 1 to"
            " {columns} and rows from 1 to {rows}: correct it.",
            where=where(),
            column=column,
            row=row,
            columns=lattice.columns,
            rows=lattice.rows,
        )

    return (int(row) - 1) * lattice.columns + int(column) - 1


def _number(text: str, where: Callable[[], Message]) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ImageError(
            "{where} has '{text}' where a number should be: correct it.", where=where(), text=text
        ) from None

    if not np.isfinite(value):
        raise ImageError(
            "{where} has '{text}', which is no finite number: correct or remove the line.",
            where=where(),
            text=text,
        )

    return value
