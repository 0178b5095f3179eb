"""Points of a lattice from a file."""

import csv
from pathlib import Path

import numpy as np

from ...arrays import Floats
from ...errors import ImageError
from ...image_io import read_bytes
from ...messages import Message
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
    path = Path(path)
    data = read_bytes(path)
    try:
        text = data.decode("utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")  # notes in other letters do not matter
    if "\0" in text:
        raise ImageError("The file '{path}' is no text: choose a CSV file of points.", path=path)
    if text.lower().startswith("sep="):
        text = text.partition("\n")[2]  # spreadsheets begin so
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
    places = [head.index(name) for name in wanted]
    found = np.full((len(lattice), 2), np.nan)
    loose = []
    seen_in = {}
    for number, cells in lines[1:]:
        where = Message("Line {number} of '{path}'", number=number, path=path)
        if len(cells) <= max(places):
            raise ImageError(
                "{where} has {n_cells} of {n_columns} columns: complete or remove it.",
                where=where,
                n_cells=len(cells),
                n_columns=len(head),
            )
        values = [
            cells[place].replace(",", ".") if delimiter == ";" else cells[place] for place in places
        ]
        if values[-2:] == ["", ""] and len(values) == 4:
            continue  # a table of all points, with blanks for those not measured
        xy = [_number(value, where) for value in values[-2:]]
        if len(values) == 2:
            loose.append(xy)
            continue
        column, row = (_number(value, where) for value in values[:2])
        if not (column in range(1, lattice.columns + 1) and row in range(1, lattice.rows + 1)):
            raise ImageError(
                "{where} has a point ({column:g}, {row:g}), but columns run from 1 to"
                " {columns} and rows from 1 to {rows}: correct it.",
                where=where,
                column=column,
                row=row,
                columns=lattice.columns,
                rows=lattice.rows,
            )
        index = (int(row) - 1) * lattice.columns + int(column) - 1
        if index in seen_in:
            raise ImageError(
                "{where} has the point {point} of line {line} again: remove one.",
                where=where,
                point=lattice.name(index),
                line=seen_in[index],
            )
        seen_in[index] = number
        found[index] = xy
    if not (loose or seen_in):
        raise ImageError("The file '{path}' has no points: choose another one.", path=path)
    if not loose:
        return found
    found = match(np.unique(loose, axis=0), expected, lattice)
    missing = missing_borders(found, expected, lattice)
    if missing:
        raise ImageError(
            "Of the points in '{path}' {missing} is missing, so that which is which cannot"
            " be told: complete them, or name them (column, row, x, y).",
            path=path,
            missing=missing[0],
        )
    return found


def _number(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ImageError(
            "{where} has '{text}' where a number should be: correct it.", where=where, text=text
        ) from None
    if not np.isfinite(value):
        raise ImageError(
            "{where} has '{text}', which is no place: correct or remove the line.",
            where=where,
            text=text,
        )
    return value
