"""Display error against edge length, as `dev.py irregular --regular`
measures it: orders, and how much better curved faces are.
"""

from pathlib import Path

import pytest

from known.judged_meshes import FLOOR, SHAPES, drawn, order
from known.judged_meshes import rms_error as errors

SEGMENTS = 32, 64, 128
MEASURED = Path(__file__).resolve().parents[2] / "docs" / "measured.md"
KINDS = "facet normals", "interpolated normals", "curved faces"


def fitted(shape, kind, mean=False):
    counts = [len(drawn(shape, s, kind).glasses[0].mesh.triangles) for s in SEGMENTS]
    found = [errors(shape, s, kind, mean) for s in SEGMENTS]
    assert min(found) > FLOOR
    return order(counts, found)


@pytest.mark.parametrize("shape", SHAPES)
def test_interpolated_normals_are_of_second_order_and_curved_faces_of_fourth(shape):
    """With the surface's own normals; facet normals are of first order, with much scatter."""
    assert 0.6 < fitted(shape, "facet normals") < 1.6
    assert 1.8 < fitted(shape, "interpolated normals") < 2.4
    assert fitted(shape, "curved faces") > 3.9


@pytest.mark.parametrize("shape", SHAPES)
def test_curved_faces_are_of_fourth_order_with_blenders_mean_normals(shape):
    """They find the normals from the vertices; next to the wavy slab's straight rims less well."""
    assert fitted(shape, "curved faces", mean=True) > (3.5 if shape == "wavy slab" else 3.7)


@pytest.mark.parametrize("mean", [False, True], ids=["own", "mean"])
@pytest.mark.parametrize("shape", ["ball", "ellipsoid", "torus"])
def test_at_32_by_16_faces_curved_ones_are_more_than_20_times_better(shape, mean):
    """An artist's usual mesh."""
    assert errors(shape, 32, "interpolated normals", mean) > 20 * errors(
        shape, 32, "curved faces", mean
    )


@pytest.mark.parametrize("shape", SHAPES)
def test_the_tables_have_the_numbers_that_are_measured(shape):
    """The rows of 32 segments, to the digits that they have."""
    text = MEASURED.read_text(encoding="utf-8")
    n = len(drawn(shape, 32, "curved faces").glasses[0].mesh.triangles)
    (row,) = (
        line
        for line in text.splitlines()
        if line.startswith(f"| {shape}") and f"| {n:,} |".replace(",", " ") in line
    )
    told = [float(cell) for cell in row.split("|")[3:6]]
    assert told == pytest.approx([errors(shape, 32, kind) for kind in KINDS], rel=0.05)
