"""Which solids touch, the bits that they have in masks, and bodies of many of them."""

import numpy as np
import pytest

from kiriko.core.base.errors import RigError
from kiriko.core.glass.surfaces import make_surface
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.media import Solid, boxes_touch, make_media
from kiriko.core.light.trace import trace_all
from kiriko.core.rig.rig import ConstantIndex, Glass, Mesh
from kiriko.core.rig.settings import Settings
from known.reference_rigs import box, icosphere, rig
from known.shards import rounded, shards_of

SIDE = 0.05


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


def traced(glasses, n=4000, **bench):
    """Landings of random rays, by the plan for some glasses."""
    a_rig = rig(glasses, display=0.2, field=0.045, **bench)
    plan = compile_plan(a_rig, Settings(max_events=200))
    o, d = a_rig.viewer.rays(np.random.default_rng(0).uniform(0, 512, (n, 2)))
    return plan, trace_all(plan, o, d)


def balls(n, seed=5, **shape):
    """Balls in a cube of `SIDE` that do not meet, many of which have boxes that do."""
    random = np.random.default_rng(seed)
    middles, radii = np.empty((0, 3)), np.empty(0)
    while len(radii) < n:
        radius = random.uniform(0.001, 0.004)
        middle = random.uniform(radius - 0.024, 0.024 - radius, 3)
        if (np.linalg.norm(middles - middle, axis=1) > 1.01 * (radii + radius)).all():
            middles, radii = np.append(middles, [middle], axis=0), np.append(radii, radius)
    return [icosphere(r, 1, centre=c, **shape) for c, r in zip(middles, radii, strict=True)]


def joined(meshes):
    """Flat meshes as one."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    triangles = [mesh.triangles + first for mesh, first in zip(meshes, starts, strict=False)]
    return Mesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(triangles))


@pytest.mark.parametrize("is_one", [False, True], ids=["objects", "pieces"])
def test_many_bubbles_are_as_good_as_cavities(is_one, has_kernel):
    """Solids of air in glass, as objects or as pieces of one, bend light as cavities in it do, and
    only the glass keeps them from being asked together.
    """
    glass, bubbles = box([SIDE] * 3), balls(120, smooth=False)
    index, air = ConstantIndex(1.49), ConstantIndex(1.0)
    inside = [joined(bubbles)] if is_one else bubbles
    plan, found = traced(
        (Glass("glass", glass, index), *(Glass(f"{i}", m, air) for i, m in enumerate(inside))),
        n=4000 if has_kernel else 300,
    )
    _, expected = traced((Glass("glass", joined([glass, *bubbles]), index),), n=len(found.reason))
    assert boxes_touch(np.stack([b.bounds for b in bubbles]), 0.0).sum() > 140
    assert sum(held.layer.has_engine for held in plan.layers) == 1
    assert np.array_equal(found.reason, expected.reason)
    assert expected.has_arrived.mean() > 0.3
    assert np.abs(found.xy - expected.xy)[expected.has_arrived].max() < 1e-6


def test_many_shards_are_as_good_as_the_whole(has_kernel):
    """More of them than a mask has bits, as pieces of one object."""
    random = np.random.default_rng(1)
    normals = random.normal(size=(8, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    whole = rounded(box([SIDE] * 3, degrees_about_z=20))
    shards = shards_of(whole, list(zip(normals, random.uniform(-0.01, 0.01, 8), strict=True)))
    index = ConstantIndex(1.49)
    plan, found = traced((Glass("glass", joined(shards), index),), n=4000 if has_kernel else 200)
    _, expected = traced((Glass("glass", whole, index),), n=len(found.reason))
    assert len(plan.media.bit) > 60
    is_plain = expected.n_events < 16
    assert np.array_equal(found.reason[is_plain], expected.reason[is_plain])
    lands = is_plain & expected.has_arrived
    assert lands.mean() > 0.3
    assert np.abs(found.xy - expected.xy)[lands].max() < 0.01


def test_a_mask_tells_the_medium_by_priority():
    """At places in random boxes, those of one index among them: the index of the solid of the
    highest priority there, and of air in none, at the surface of each solid around.
    """
    random = np.random.default_rng(6)
    n = 120
    indices = random.choice([1.0, 1.33, 1.49, 1.7], n)
    solids = []
    for i in range(n):
        mesh = box(random.uniform(0.05, 0.3, 3), random.uniform(-0.5, 0.5, 3))
        priority = int(random.integers(3))
        glass = Glass(f"{i}", mesh, ConstantIndex(indices[i]), priority=priority)
        surface = make_surface(mesh)
        solids.append(Solid(surface, f"{i}", i, glass, surface, None))
    boxes = np.stack([solid.surface.bounds for solid in solids])
    rank = [(solid.glass.priority, -abs(solid.surface.volume)) for solid in solids]
    touch = boxes_touch(boxes, 0.0)
    media = make_media(solids, touch, 589.0)
    assert len(set(media.bit.tolist())) < 20
    assert (media.bit[:, None] == media.bit)[touch & ~np.eye(n, dtype=bool)].sum() == 0

    n_several = 0
    for place in random.uniform(-0.6, 0.6, (3000, 3)):
        here = np.flatnonzero(((boxes[:, 0] < place) & (place < boxes[:, 1])).all(axis=1))
        mask = np.bitwise_or.reduce(media.bit[here], initial=np.uint64(0))
        expected = indices[max(here, key=rank.__getitem__)] if len(here) else 1.0
        for solid in here:
            assert media.index(np.array([solid]), np.array([mask])) == expected
        n_several += len(here) > 1
    assert n_several > 100


def test_more_solids_in_one_place_than_a_mask_has_bits_are_refused():
    """With their number, a name, and what to do."""
    shells = tuple(
        Glass(f"shell {i}", box([0.05 * 0.95**i] * 3), ConstantIndex(1.3 + 0.01 * i))
        for i in range(53)
    )
    compile_plan(rig(shells[:52]), Settings())
    with pytest.raises(RigError, match="More than 52 solids around 'shell 52' touch"):
        compile_plan(rig(shells), Settings())
