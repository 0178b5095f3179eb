import re
import sys

import numpy as np
import pytest

import environments
from bench.ablation import TABLE, Wanted, load
from bench.ablation_rows import CORE, ROWS, Change, Row, import_all, instead, options
from bench.ablation_table import ENOUGH, FEW, N_GLASSES, judged, line_of, verdict_of

MACRO = re.compile(r"^#define (\w+) (\d[\d.e+-]*)", re.MULTILINE)
HANDED_OVER = {"most_reads"}  # the kernel's number is only the largest that it takes
SAME = [0.1, 0.01, 1000, 1.0, None, None]
WORSE = [0.2, 0.01, 1000, 1.0, None, None]


def bound(old: object, name: str) -> list[str]:
    """Modules of core that bind an object, numbers under this name alone."""
    return [
        module.__name__
        for module in list(sys.modules.values())
        if getattr(module, "__name__", "").startswith(CORE)
        for here, value in list(vars(module).items())
        if value is old and (here == name or not isinstance(old, int | float | tuple))
    ]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_a_row_changes_what_it_names_everywhere_and_puts_it_back(row):
    """Its targets exist, no module has the old object meanwhile, and all have it again after."""
    import_all()
    targets = [(change, *change.found()) for change in row.changes]
    before = [bound(old, name) for _, _, name, old in targets]
    with row.off():
        for change, _, name, old in targets:
            new = change.found()[2]
            assert new is not old
            assert new != old
            assert bound(old, name) == []
    assert [change.found()[2] is old for change, _, _, old in targets] == [True] * len(targets)
    assert [bound(old, name) for _, _, name, old in targets] == before


def test_a_row_is_put_back_after_a_fault():
    """A solve that stops leaves nothing switched off."""
    row = ROWS[0]
    old = row.changes[0].found()[2]
    with pytest.raises(ZeroDivisionError), row.off():
        raise ZeroDivisionError
    assert row.changes[0].found()[2] is old


def test_a_target_that_is_gone_is_a_fault():
    """A module, a record or a field that no longer exists is never switched off in silence."""
    for change, fault in (
        (instead("map.gone.FAINT", 0), ModuleNotFoundError),
        (instead("map.samples.GONE", 0), AttributeError),
        (options("glass.trust.PART", gone=0), TypeError),
    ):
        with pytest.raises(fault), Row("gone", (change,), "").off():
            pass


def test_an_equal_number_of_another_name_stays():
    """Only the constant of that name changes, though Python has one object for equal numbers."""
    import kiriko.core.map.samples as samples
    import kiriko.core.solve.legibility as legibility

    assert samples.TILE_CELLS == legibility.VIEWER_PX
    with Row("tile", (Change("map.samples.TILE_CELLS", lambda old: old + 1),), "").off():
        assert samples.TILE_CELLS == legibility.VIEWER_PX + 1


def test_options_that_the_kernel_copies_are_measured_by_numpy():
    """A field with the number of a kernel's macro of its name changes nothing there."""
    kernel = environments.ROOT / "core" / "native"
    text = "".join(path.read_text() for path in (*kernel.glob("*.c"), *kernel.glob("*.h")))
    copied = {name: float(number) for name, number in MACRO.findall(text)}
    wrong = [
        row.name
        for row in ROWS
        for change in row.changes
        for name in change.fields
        if name not in HANDED_OVER
        and copied.get(name.upper()) == getattr(change.found()[2], name)
        and not row.by_numpy
    ]
    assert wrong == []


def test_each_row_has_a_name_of_its_own_and_a_reason():
    """Results are found by name, and no value is neutral by itself."""
    names = [row.name for row in ROWS]
    assert len(set(names)) == len(names)
    assert all(row.why for row in ROWS)


@pytest.mark.parametrize(
    ("n_worse", "n_same", "protects", "verdict"),
    [
        (ENOUGH, 0, "", "stays"),
        (0, FEW, "", "goes so far"),
        (0, FEW - 1, "", "open"),
        (0, FEW, "extremes: small glass", "protected"),
        (ENOUGH - 1, N_GLASSES - ENOUGH, "", "open"),
        (ENOUGH - 1, N_GLASSES - ENOUGH + 1, "", "goes"),
    ],
)
def test_the_verdict_is_that_of_the_rule(n_worse, n_same, protects, verdict):
    """A heuristic stays with a gain on three glasses, and goes once three are out of reach."""
    row = Row("row", (instead("map.samples.FAINT", 0),), "", protects)
    numbers = [[WORSE, SAME]] * n_worse + [[SAME, SAME]] * n_same
    assert verdict_of(row, dict(enumerate(numbers))) == verdict


def test_a_surface_that_changes_is_judged_by_the_one_meant_alone():
    """Without a judge a glass does not count: a distance from today's image is no gain."""
    fit = Row("row", (instead("glass.subdivided.MOST_TRIANGLES", -1),), "")
    drawn = Row("row", (instead("map.samples.FAINT", 0),), "")
    better = [[0.2, 0.01, 1000, 1.0, 0.05, 0.005], [0.1, 0.01, 1000, 1.0, 0.1, 0.01]]
    found = {"vase": [WORSE, SAME], "cube": [SAME, SAME], "ball": better}
    assert judged(fit, found) == [(1.0, 1.0, 1.0, 1.0), (0.5, 0.5, 1.0, 1.0)]
    assert [one[0] for one in judged(drawn, {"vase": [WORSE, SAME]})] == [2.0]


def test_a_row_that_stops_the_solver_stays():
    """The fault is its verdict."""
    row = Row("row", (instead("map.samples.FAINT", 0),), "")
    assert verdict_of(row, {"ball": "IndexError: 3"}) == "stays: IndexError: 3"


def test_errors_are_those_of_a_known_offset():
    """A pixel off by 1 counts by half of the seen pixels, and by its share of the light."""
    is_seen = np.array([[True, True, False]])
    wanted = Wanted(np.zeros((1, 3, 3), np.float32), is_seen, np.array([[3.0, 0.5, 0.5]]))
    image = np.zeros((1, 3, 3), np.float32)
    image[0, 0] = 1.0
    assert wanted.errors(image) == pytest.approx((0.5**0.5, 0.75**0.5))


def test_the_table_is_that_of_the_results():
    """docs/ablation.md has the line of each row: `dev.py ablation --table` makes it."""
    text = TABLE.read_text(encoding="utf-8")
    results = load()
    missing = [row.name for row in ROWS if line_of(row, results.get(row.name, {})) not in text]
    assert missing == []
