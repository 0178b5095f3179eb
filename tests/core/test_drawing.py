"""The drawing of the pipeline: `dev.py pipeline`."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

import environments
from drawing.pipeline import PATH, drawn
from drawing.solved import DISPLAY_PX, solved
from kiriko.core.native import loading


@pytest.fixture(scope="module")
def found():
    return solved()


def words_of(svg):
    """All texts of a drawing, which has to be well-formed."""
    return [part.text for part in ElementTree.fromstring(svg).iter() if part.tag.endswith("text")]


def test_pieces_make_up_the_cut_pixel(found):
    """Two branches share it, and nothing of it is left over or there twice."""
    assert sum(polygon.area for polygon in found.cut) == pytest.approx(1, abs=0.01)
    assert len(list(found.by_branch(found.cut))) == 2


def test_shares_are_those_of_the_display_pixel(found):
    """All are on it, one of them is of the cut pixel, and they cover no more than all of it."""
    column, row = found.display_pixel
    assert (found.shares.display_index == row * DISPLAY_PX + column).all()
    assert 0 < found.shares.display_area.sum() <= 1 + 1e-6
    assert (np.floor(found.shares.view_xy) == found.pixel).all(axis=1).any()


def test_the_drawing_in_the_docs_is_this_one(found):
    """Its words are those that the script draws, and each file that it names is there."""
    words = words_of(PATH.read_text(encoding="utf-8"))
    if loading.library() is not None:
        assert words == words_of(drawn(found))
    for word in words:
        if re.fullmatch(r"[\w/]+\.py", word or ""):
            assert (environments.ROOT / "core" / word).exists(), word
