"""Measured points of a lattice: reading a CSV file, and checks for swapped, mistaken or mirrored
points.

A paraboloid through a point's neighbours predicts the point. A point is mistaken if it is more than
max(0.3 spacings, 6 times the median distance) from the prediction. Glass bends a lattice, so no
fixed distance from a straight one would do.
"""

import csv
from collections.abc import Callable
from functools import partial
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Bools, Floats
from ...base.errors import ImageError
from ...base.messages import Message, joined
from ...files.disk import read_bytes
from .drawn import Lattice
from .match import (
    ABOVE_ROUGHNESS,
    FEWEST,
    MOST_TURNED_RAD,
    Basis,
    Site,
    match,
    mean_steps,
    neighbours_of,
    predicted,
    roughness,
    without_strangers,
)

MISTAKEN = 0.3  # spacings, distance from the prediction at which a point is reported
N_COMPARED = 400  # samples along each axis to compare a photograph with the picture
# mistakes in the numbering: u mirrored, v mirrored, shift in columns and rows
SHIFTED = Message("shifted by a column or row")
UPSIDE_DOWN = Message("upside down")
MISTAKES = (
    (Message("mirrored"), True, False, 0, 0),
    (UPSIDE_DOWN, False, True, 0, 0),
    (UPSIDE_DOWN, True, True, 0, 0),
    *((SHIFTED, False, False, *step) for step in ((1, 0), (-1, 0), (0, -1), (0, 1))),
)


class _Misplaced(NamedTuple):
    """Points far from their predictions, by site.

    at, wanted : px, x + iy
    spacing : px, of the lattice there
    """

    at: dict[Site, complex]
    wanted: dict[Site, complex]
    spacing: dict[Site, float]


def check(points: Floats, lattice: Lattice) -> None:
    """Raise ImageError if points (m, 2), px, NaN if not measured, do not form a smooth lattice.

    The tolerance is a third of a spacing, or several times the median distance: unevenly bent light
    is not a mistake.
    """
    at = points[:, 0] + 1j * points[:, 1]
    sites = {
        (k % lattice.columns, k // lattice.columns): k for k in np.flatnonzero(np.isfinite(at))
    }
    bases = dict.fromkeys(sites, mean_steps(at, sites))
    good = without_strangers(at, sites, bases, MISTAKEN)
    if not good:
        return

    rough = np.median(list(roughness(at, good, bases).values()) or [0.0])
    most = max(MISTAKEN, ABOVE_ROUGHNESS * rough)
    found = _misplaced(at, sites, good, bases, most)

    if rough > MISTAKEN or len(found.wanted) > len(sites) / 3:
        raise ImageError(
            "The points do not form a lattice of {columns} x {rows} in this order. Number them by"
            " column and row, or correct the lattice.",
            columns=lattice.columns,
            rows=lattice.rows,
        )

    if found.wanted:
        names = {site: lattice.name(sites[site]) for site in found.wanted}
        raise ImageError(
            "Some points look wrong: {problems}. Correct them, or leave them out.",
            problems=joined(_problems(found, names), "; "),
        )


def _misplaced(
    at: NDArray[np.complex128],
    sites: dict[Site, int],
    good: dict[Site, int],
    bases: dict[Site, Basis],
    most: float,
) -> _Misplaced:
    """Sites outside `good` and more than `most` spacings from their predictions."""
    found = _Misplaced({}, {}, {})
    for site in sorted(sites.keys() - good.keys(), key=sites.get):
        near = neighbours_of(site, good)
        if len(near) > 3:
            place, there = predicted(site, near, at[[good[s] for s in near]], bases[site])
            if np.abs(at[sites[site]] - place) > most * np.abs(there).min():
                found.at[site] = at[sites[site]]
                found.wanted[site] = place
                found.spacing[site] = np.abs(there).min()

    return found


def _problems(found: _Misplaced, names: dict[Site, str]) -> list[str]:
    """Messages on misplaced points, swapped pairs first."""

    def is_in_place_of(here: Site, there: Site) -> bool:
        return np.abs(found.at[here] - found.wanted[there]) < MISTAKEN * found.spacing[there]

    messages = []
    swapped = set()

    for one, other in product(names, repeat=2):
        is_new = one != other and not swapped & {one, other}
        if is_new and is_in_place_of(one, other) and is_in_place_of(other, one):
            messages.append(
                Message("points {one} and {other} seem swapped", one=names[one], other=names[other])
            )
            swapped |= {one, other}

    for site in names:
        if site not in swapped:
            far = np.abs(found.at[site] - found.wanted[site])
            messages.append(
                Message(
                    "point {point} is {far:.0f} pixels from its expected position",
                    point=names[site],
                    far=far,
                )
            )

    return messages


def missing_borders(points: Floats, expected: Floats, lattice: Lattice) -> list[str]:
    """Names of outer columns and rows with expected points (m, 2) but no found point (m, 2)."""
    shape = lattice.rows, lattice.columns
    is_found, is_due = (np.isfinite(xy).all(axis=1).reshape(shape) for xy in (points, expected))
    borders = {
        Message("column {number}", number=1): np.s_[:, 0],
        Message("column {number}", number=lattice.columns): np.s_[:, -1],
        Message("row {number}", number=1): np.s_[0],
        Message("row {number}", number=lattice.rows): np.s_[-1],
    }
    return [name for name, k in borders.items() if is_due[k].any() and not is_found[k].any()]


def check_way(points: Floats, expected: Floats) -> None:
    """Raise ImageError if points (m, 2), px, are mirrored or rotated far from the expected ones (m,
    2).
    """
    both = np.isfinite(points).all(axis=1) & np.isfinite(expected).all(axis=1)
    if both.sum() < FEWEST:
        return

    from_middle = expected[both] - expected[both].mean(axis=0)
    linear = np.linalg.lstsq(from_middle, points[both] - points[both].mean(axis=0), rcond=None)[0].T
    if (
        np.linalg.det(linear) < 0
        or np.abs(np.arctan2(linear[1, 0] - linear[0, 1], np.trace(linear))) > MOST_TURNED_RAD
    ):
        raise ImageError(
            "The points are mirrored or rotated. Count columns from the left and rows from the"
            " top, and hold the camera upright like the viewer."
        )


def check_picture(
    points: Floats, lattice: Lattice, photograph: NDArray, picture: NDArray, is_unsure: bool
) -> None:
    """Raise ImageError if a photograph matches the picture better mirrored, upside down or shifted
    by a column or row.

    If all points look alike, only the picture's border distinguishes these cases. With `is_unsure`,
    as when an outer column is missing, the numbering must match clearly better than every mistake.

    Parameters
    ----------
    points : (m, 2) px of the photograph, numbered; NaN if not found
    photograph, picture : (h, w, c), row 0 at the top; the picture contains the lattice
    """
    has_point = np.isfinite(points).all(axis=1)
    u, v = lattice.uv.T

    def terms(u: Floats, v: Floats) -> Floats:
        return np.stack([np.ones_like(u), u, v, u * v, u * u, v * v], axis=-1)

    if has_point.sum() < 2 * terms(u, v).shape[1]:
        return

    # picture positions in the photograph, by a quadratic fit
    fit = np.linalg.lstsq(terms(u, v)[has_point], points[has_point], rcond=None)[0]
    side = (np.arange(N_COMPARED) + 0.5) / N_COMPARED
    u, v = (x.ravel() for x in np.meshgrid(side, side))
    at = terms(u, v) @ fit
    seen, is_inside = _read(photograph, at / photograph.shape[1::-1])

    # only around found points: elsewhere the display may show nothing
    steps = (1 - 2 * lattice.margin) / (np.array([lattice.columns, lattice.rows]) - 1)
    column, row = (
        np.rint((x - lattice.margin) / step).astype(int)
        for x, step in zip((u, 1 - v), steps, strict=True)
    )
    is_inside &= (column >= 0) & (column < lattice.columns) & (row >= 0) & (row < lattice.rows)
    is_inside &= has_point[np.where(is_inside, row * lattice.columns + column, 0)]

    way, more = _most_like(seen, is_inside, picture, np.stack([u, v], axis=1), steps)
    if more > (-0.005 if is_unsure else 0.005):
        raise ImageError(
            "The photograph seems to show the picture {way}. Hold the camera upright like the"
            " viewer, show the whole lattice, or number the points in a CSV file.",
            way=way,
        )


def _most_like(
    seen: NDArray, is_inside: Bools, picture: NDArray, uv: Floats, steps: Floats
) -> tuple[str, float]:
    """The mistake that best matches the picture at UV (n, 2) to the seen colours (n, c), and its
    gain in correlation over no mistake.

    is_inside : (n,) samples to compare
    steps : (2,) between columns and between rows, in UV
    """
    u, v = uv.T
    shown, _ = _read(picture, np.stack([u, 1 - v], axis=1))
    n = min(seen.shape[1], shown.shape[1])
    most, way = -np.inf, ""

    for name, mirror_u, mirror_v, columns, rows in MISTAKES:
        other_u = (1 - u if mirror_u else u) + columns * steps[0]
        other_v = (1 - v if mirror_v else v) + rows * steps[1]
        other, is_there = _read(picture, np.stack([other_u, 1 - other_v], axis=1))

        some = is_inside & is_there
        of_other = _likeness(seen[some, :n], other[some, :n])
        more = of_other - _likeness(seen[some, :n], shown[some, :n])
        if more > most:
            most, way = more, name

    return way, most


def _likeness(a: NDArray, b: NDArray) -> float:
    """Correlation of colours (n, c) after subtracting each channel's mean; 0 without data."""
    if not len(a):
        return 0.0
    a = a - a.mean(axis=0)
    b = b - b.mean(axis=0)
    size = np.sqrt((a * a).sum() * (b * b).sum())
    return float((a * b).sum() / size) if size > 0 else 0.0


def _read(image: NDArray, place: Floats) -> tuple[NDArray, Bools]:
    """Encoded colours (n, 3 or 1) at positions (n, 2), 0..1 from the upper left, and a mask (n,) of
    the positions inside the image.
    """
    height, width = image.shape[:2]
    x, y = np.floor(place * (width, height)).astype(int).T
    inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
    channels = image.reshape(height, width, -1)[
        ..., : 3 if image.ndim == 3 and image.shape[2] >= 3 else 1
    ]

    return np.sqrt(
        np.clip(channels[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)], 0, 1)
    ), inside


def read_points(path: Path | str, lattice: Lattice, expected: Floats) -> Floats:
    """Measured points (m, 2), px, from a CSV file; NaN for missing ones.

    The first line names the columns: column, row, x and y, in any order, the first two counted from
    1; or x and y alone, and `match` then numbers the points. The separator is a comma, semicolon or
    tab; with semicolons, numbers may have a decimal comma.

    Parameters
    ----------
    expected : (m, 2) px, approximate positions, NaN for points out of view

    Raises
    ------
    ImageError : the file cannot be read, or has invalid positions
    """
    table = _table(Path(path))
    measured = _measured(table, lattice)

    if not (measured.loose or measured.lines):
        raise ImageError("The file '{path}' has no points. Choose another file.", path=table.path)
    if not measured.loose:
        return measured.named

    found = match(np.unique(measured.loose, axis=0), expected, lattice)
    missing = missing_borders(found, expected, lattice)
    if missing:
        raise ImageError(
            "The file '{path}' has no points in {missing}, so they cannot be numbered. Add the"
            " points, or name them (column, row, x, y).",
            path=table.path,
            missing=missing[0],
        )

    return found


class _PointTable(NamedTuple):
    """Numbered lines of a CSV file, after the header with `n_columns` names.

    places : column numbers of x and y, or of column, row, x and y
    """

    path: Path
    lines: list[tuple[int, list[str]]]
    n_columns: int
    places: list[int]
    has_decimal_commas: bool


class _Measured(NamedTuple):
    """Points of a file.

    named : (m, 2) px, NaN if missing
    lines : line numbers of the named points, by index
    loose : positions of unnumbered points
    """

    named: Floats
    lines: dict[int, int]
    loose: list[list[float]]


def _text(path: Path) -> str:
    """The text of a file in UTF-16, UTF-8 or Latin-1."""
    data = read_bytes(path)
    try:
        text = data.decode("utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")  # only comments can contain other characters

    if "\0" in text:
        raise ImageError(
            "The file '{path}' is not a text file. Choose a CSV file of points.", path=path
        )

    # spreadsheets may add a line with the separator
    return text.partition("\n")[2] if text.lower().startswith("sep=") else text


def _table(path: Path) -> _PointTable:
    """The non-empty lines of a CSV file."""
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
            "The file '{path}' is not a valid CSV file. Correct line {line} ({why}).",
            path=path,
            line=rows.line_num,
            why=reason,
        ) from None

    head = [name.lower() for name in lines[0][1]] if lines else []
    wanted = ["x", "y"] if {"column", "row"}.isdisjoint(head) else ["column", "row", "x", "y"]
    if any(head.count(name) != 1 for name in wanted):
        raise ImageError(
            "The file '{path}' has no header. Begin it with the line column, row, x, y or x, y.",
            path=path,
        )

    return _PointTable(
        path=path,
        lines=lines[1:],
        n_columns=len(head),
        places=[head.index(name) for name in wanted],
        has_decimal_commas=delimiter == ";",
    )


def _measured(table: _PointTable, lattice: Lattice) -> _Measured:
    """The points of a table."""
    found = _Measured(np.full((len(lattice), 2), np.nan), {}, [])
    for number, cells in table.lines:
        where = partial(_line, number, table.path)
        if len(cells) <= max(table.places):
            raise ImageError(
                "{where} has {n_cells} of {n_columns} columns. Complete or remove it.",
                where=where(),
                n_cells=len(cells),
                n_columns=table.n_columns,
            )

        values = [cells[place] for place in table.places]
        if table.has_decimal_commas:
            values = [value.replace(",", ".") for value in values]
        if values[-2:] == ["", ""] and len(values) == 4:
            continue  # not measured, in a table of all points

        xy = [_number(value, where) for value in values[-2:]]
        if len(values) == 2:
            found.loose.append(xy)
            continue

        index = _index(values[:2], where, lattice)
        if index in found.lines:
            raise ImageError(
                "{where} repeats the point {point} of line {line}. Remove one of them.",
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
    """Index of a point from its column and row, counted from 1."""
    column, row = (_number(value, where) for value in values)
    if not (column in range(1, lattice.columns + 1) and row in range(1, lattice.rows + 1)):
        raise ImageError(
            "{where} has a point ({column:g}, {row:g}), but columns run from 1 to {columns} and"
            " rows from 1 to {rows}. Correct it.",
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
        value = np.nan

    if not np.isfinite(value):
        raise ImageError(
            "{where} has '{text}' instead of a number. Correct or remove the line.",
            where=where(),
            text=text,
        )

    return value
