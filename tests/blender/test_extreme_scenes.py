"""The extreme cases of `dev.py extremes` that need
Blender, at small size, each within its own bound.
"""

import pytest

from known.extremes import cases as extreme_cases
from known.extremes.cases import WRONG

NAMES = "scenes in mm, cm, inches and km", "float32 object matrices"


@pytest.mark.parametrize("name", NAMES)
def test_extreme_scene(scene, name):
    """Right within its bound, whatever unit or axes the scene is drawn in."""
    from known.extremes import scenes as extreme_scenes  # noqa: F401 - puts its cases among the others, and needs a Blender that runs

    (case,) = (case for case in extreme_cases.CASES if case.name == name)
    rows = list(case.rows(True))
    assert rows
    assert [row for row in rows if row.verdict == WRONG] == []
