"""Which solids hang together."""

import numpy as np
import pytest

from kiriko.core.light.media import boxes_touch, clusters_of


@pytest.mark.parametrize(("gap", "touch"), [(-1.0, True), (0.0, True), (0.25, True), (0.26, False)])
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("swap", [False, True])
def test_boxes_touch_up_to_the_slack(gap, touch, axis, swap):
    """Along whichever axis they stand side by side, and whichever comes first.

    A box touches itself.
    """
    one = np.array([[0.0, 0, 0], [1, 1, 1]])
    boxes = np.stack([one, one + (1 + gap) * np.eye(3)[axis]])
    found = boxes_touch(boxes[::-1] if swap else boxes, 0.25)
    assert np.array_equal(found, [[True, touch], [touch, True]])


def test_clusters_are_what_hangs_together_by_others():
    touch = np.eye(5, dtype=bool)
    for i, j in ((0, 3), (3, 4)):
        touch[i, j] = touch[j, i] = True
    assert sorted(sorted(map(int, cluster)) for cluster in clusters_of(touch)) == [
        [0, 3, 4],
        [1],
        [2],
    ]
