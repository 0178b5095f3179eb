"""Trees over boxes, and what is made ready in parts."""

import numpy as np
import pytest

from kiriko.core.base.steps import run_steps
from kiriko.core.glass import bounding_shell
from kiriko.core.glass.bounding_shell import bounding_shell_steps
from kiriko.core.glass.surfaces import make_surface
from kiriko.core.light import kernel_trees
from kiriko.core.native import loading
from known.reference_rigs import bottle, icosphere

needs_kernel = pytest.mark.skipif(loading.library() is None, reason="the kernel is not there")

N = 3000


@needs_kernel
def test_a_large_tree_is_the_small_one_with_pauses(monkeypatch):
    """A thread of its own makes it, and it is given up when nobody wants it any longer."""
    at = np.random.default_rng(0).normal(size=(50 * N, 3))  # so many that it takes a while
    boxes = np.stack([at - 0.1, at + 0.1], axis=1)
    monkeypatch.setattr(kernel_trees, "LARGE", len(boxes) + 1)
    whole, items = run_steps(kernel_trees.tree_steps(boxes))
    monkeypatch.setattr(kernel_trees, "LARGE", N - 1)
    pauses = list(kernel_trees.tree_steps(boxes))
    made, same = run_steps(kernel_trees.tree_steps(boxes))
    assert pauses
    assert np.array_equal(made.references[0], whole.references[0])
    assert np.array_equal(same, items)
    unwanted = kernel_trees.tree_steps(boxes)
    next(unwanted)
    unwanted.close()


@needs_kernel
def test_no_tree_is_too_deep():
    """A ray keeps 256 boxes in mind at the most (tree.h), however uneven they are."""
    at = 10.0 ** -np.random.default_rng(0).uniform(0, 150, (N, 3))
    nodes = run_steps(kernel_trees.tree_steps(np.stack([at, at], axis=1)))[0].references[0]
    todo = [(0, 1)]
    most = 0
    while todo:
        number, n_waiting = todo.pop()
        children = nodes["children"][number]
        n_waiting += (children != 0).sum() - 1
        most = max(most, n_waiting)
        todo += [(k, n_waiting) for k in children[children > 0]]
    assert 40 < most <= 256


@pytest.mark.parametrize("mesh", [bottle(), icosphere(0.025, 2)], ids=["bottle", "ball"])
def test_a_hull_in_portions_is_the_hull(mesh, monkeypatch):
    """Whatever the number of faces that are worked on together."""
    curved = make_surface(mesh).curved
    whole = run_steps(bounding_shell_steps(curved))
    monkeypatch.setattr(bounding_shell, "PARTS_AT_ONCE", 1000)
    pauses = list(bounding_shell_steps(curved))
    portioned = run_steps(bounding_shell_steps(curved))
    assert len(pauses) > 20
    for name in whole._fields:
        assert np.array_equal(getattr(portioned, name), getattr(whole, name))
