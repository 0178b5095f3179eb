"""Lists of frames."""

import re
from itertools import pairwise

import numpy as np
import pytest

from kiriko.core.base.errors import RigError
from kiriko.core.files.frame_list import MOST, frames_of, in_ranges


@pytest.mark.parametrize(
    ("text", "frames"),
    [
        ("7", (7,)),
        ("1-5", (1, 2, 3, 4, 5)),
        ("1-250:2", tuple(range(1, 251, 2))),
        ("1-10:3", (1, 4, 7, 10)),
        ("1, 5,10-12", (1, 5, 10, 11, 12)),
        ("10-12,1,11-13", (10, 11, 12, 1, 13)),
        ("-3--1", (-3, -2, -1)),
        ("-1-1", (-1, 0, 1)),
        ("4-4:9", (4,)),
    ],
)
def test_frames_are_those_of_the_list_in_its_order_each_once(
    text: str, frames: tuple[int, ...]
) -> None:
    assert frames_of(text) == frames


@pytest.mark.parametrize(
    "text", ["", "a", "1-", "1..5", "1,,2", "1-5:", "1-5:-1", "1.5", "1-5:2:3"]
)
def test_a_text_that_is_no_list_is_refused_in_a_sentence(text: str) -> None:
    with pytest.raises(RigError, match=r"is not a list of frames: .*\.$") as caught:
        frames_of(text)
    assert f"'{text}'" in str(caught.value)


@pytest.mark.parametrize("part", ["5-1", "1-5:0"])
def test_a_range_that_has_no_frame_is_named(part: str) -> None:
    with pytest.raises(RigError, match=rf"'{part}' is not a list of frames: .*\.$"):
        frames_of(f"1,{part}")


def test_no_frame_is_beyond_those_of_blender() -> None:
    assert frames_of(f"{MOST}") == (MOST,)
    with pytest.raises(RigError, match="numbers up to 1048574"):
        frames_of(f"1-{MOST + 1}")


@pytest.mark.parametrize(
    ("text", "normal"),
    [
        ("1-3,2-4", "1-4"),
        ("1,1", "1"),
        ("1-9:3,2-9:3", "1-2,4-5,7-8"),
        ("\uff11-\uff13", "1-3"),
        ("9, 1-5:2", "1-5:2,9"),
        ("1-250:2", "1-249:2"),
        ("-3--1", "-3--1"),
        ("1,3", "1,3"),
    ],
)
def test_a_list_has_one_form_that_schedulers_read(text: str, normal: str) -> None:
    assert in_ranges(frames_of(text)) == normal


def test_ranges_have_the_same_frames_and_never_overlap() -> None:
    """As Open Job Description wants them: each begins behind the end of the one before it."""
    rng = np.random.default_rng(4)
    for n in (1, 5, 40, 300):
        frames = rng.integers(-400, 400, n).tolist()
        text = in_ranges(frames)
        assert list(frames_of(text)) == sorted(set(frames))
        ends = [
            (int(a), int(b or a))
            for a, b in re.findall(r"(-?\d+)(?:-(-?\d+)(?::\d+)?)?(?:,|$)", text)
        ]
        assert all(before[1] < one[0] for before, one in pairwise(ends))
