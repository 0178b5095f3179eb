"""What is made ready in parts is what is made at once."""

import numpy as np
import pytest

from kiriko.core.base.steps import finish
from kiriko.core.glass import bounding_shell
from kiriko.core.glass.bounding_shell import making_hull
from kiriko.core.glass.surfaces import make_surface
from kiriko.core.light.native import growing
from kiriko.core.native import loading
from known.reference_rigs import bottle, icosphere

needs_kernel = pytest.mark.skipif(loading.library() is None, reason="the kernel is not there")

N = 3000
# places (n, 3) of boxes: anywhere, in a plane, all in one place, many in the same places
SPREADS = {
    "anywhere": lambda at: at,
    "in a plane": lambda at: at * [1, 1, 0],
    "in one place": lambda at: 0 * at,
    "on a grid": np.round,
    "few far away": lambda at: at**3,
}


def boxes_at(spread, least=0.0):
    """Boxes (n, 2, 3) of many sizes."""
    dice = np.random.default_rng(0)
    at = spread(dice.normal(size=(N, 3)))
    size = least + 0.2 * dice.random((N, 1)) ** 4
    return np.stack([at - size, at + size], axis=1)


def grown(boxes, at_once, monkeypatch):
    """Nodes and items of a tree, and over how many boxes each call made a part of it."""
    monkeypatch.setattr(growing, "AT_ONCE", at_once)
    calls = []
    make_nodes = growing._make_nodes
    with monkeypatch.context() as patch:
        patch.setattr(
            growing, "_make_nodes", lambda some: calls.append(len(some)) or make_nodes(some)
        )
        made, items = finish(growing.making_tree(boxes))
    return made.kept[0], items, calls


def walk(nodes, items):
    """Of each node from the root on the sides of its boxes, and the items in those at an end."""
    todo = [0]
    while todo:
        node = nodes[todo.pop()]
        ends = []
        for first, count in zip(node["first"], node["count"], strict=True):
            if count:
                ends.append(items[first : first + count].tolist())
            elif first >= 0:
                todo.append(first)
                ends.append("a node")
        yield node["sides"].tolist(), ends


@needs_kernel
@pytest.mark.parametrize("spread", SPREADS)
@pytest.mark.parametrize("least", [0.0, 0.1])
@pytest.mark.parametrize("at_once", [60, 300, 1000])
def test_a_tree_in_parts_is_the_tree(spread, least, at_once, monkeypatch):
    """Box by box and item by item, in the same order; and no part is larger than it may be."""
    boxes = boxes_at(SPREADS[spread], least)
    whole = grown(boxes, N, monkeypatch)
    parts = grown(boxes, at_once, monkeypatch)
    assert whole[2] == [N]
    assert len(parts[2]) > 1
    assert max(parts[2]) <= at_once
    assert list(walk(*parts[:2])) == list(walk(*whole[:2]))
    assert len(parts[0]) == len(whole[0])
    assert sorted(parts[1]) == list(range(N))


@needs_kernel
@pytest.mark.parametrize("at_once", [20, 700, N])
def test_no_tree_is_too_deep(at_once, monkeypatch):
    """A ray keeps 256 boxes in mind at the most (tree.h), however uneven they are."""
    at = 10.0 ** -np.random.default_rng(0).uniform(0, 150, (N, 3))
    nodes, _, _ = grown(np.stack([at, at], axis=1), at_once, monkeypatch)
    todo = [(0, 1)]
    most = 0
    while todo:
        number, n_waiting = todo.pop()
        first, count = nodes["first"][number], nodes["count"][number]
        n_waiting += (first >= 0).sum() - 1
        most = max(most, n_waiting)
        todo += [(k, n_waiting) for k in first[(first >= 0) & (count == 0)]]
    assert 40 < most <= 256


@pytest.mark.parametrize("mesh", [bottle(), icosphere(0.025, 2)], ids=["bottle", "ball"])
def test_a_hull_in_portions_is_the_hull(mesh, monkeypatch):
    """Whatever the number of faces that are worked on together."""
    curved = make_surface(mesh).curved
    whole = finish(making_hull(curved))
    monkeypatch.setattr(bounding_shell, "PARTS_AT_ONCE", 1000)
    pauses = list(making_hull(curved))
    portioned = finish(making_hull(curved))
    assert len(pauses) > 20
    for name in whole._fields:
        assert np.array_equal(getattr(portioned, name), getattr(whole, name))
