"""Faces in one place, however light meets them: shards, two media, a display on glass.

Their gaps and overlaps are nanometres across, as float32 rounds places, and any length along a ray
that grazes them.
"""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.rays import Reason
from kiriko.core.light.trace import trace_all
from kiriko.core.rig.rig import ConstantIndex, Display, Glass
from kiriko.core.rig.settings import Settings
from known.reference_rigs import box, icosphere, rectangle, rig
from known.shards import rounded, shards_of

X, Y, Z = np.eye(3)
SIZE = 0.1


def made_of(*meshes, indices=(1.49,), **bench):
    """A rig with a body that is made of these meshes."""
    indices = np.broadcast_to(indices, len(meshes))
    glasses = (
        Glass(f"{i}", mesh, ConstantIndex(float(n)))
        for i, (mesh, n) in enumerate(zip(meshes, indices, strict=True))
    )
    return rig(tuple(glasses), display=SIZE, field=0.06, **bench)


def traced(a_rig, o, d, **settings):
    return trace_all(compile_plan(a_rig, Settings(**settings)), o, d)


def planes(n, seed):
    """So many planes through the middle of a body, most of which the viewer sees edge-on."""
    random = np.random.default_rng(seed)
    normals = random.normal(size=(n, 3)) * [1, 0.02, 1]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return list(zip(normals, random.uniform(-0.012, 0.012, n), strict=True))


@pytest.mark.usefixtures("has_kernel")
@pytest.mark.parametrize(
    ("body", "seed"),
    [(box([0.05] * 3, degrees_about_z=20), 0), (icosphere(0.025, 2, smooth=False), 2)],
    ids=["cube", "ball"],
)
def test_a_body_cut_into_shards_is_as_good_as_whole(body, seed):
    """No wall between the shards turns light back, as a film of air would: each ray lands where it
    does without them.
    """
    body = rounded(body)
    shards = shards_of(body, planes(5, seed))
    assert len(shards) > 12
    whole = made_of(body)
    o, d = whole.viewer.rays(np.random.default_rng(0).uniform(0, 512, (4000, 2)))
    expected, found = (traced(a_rig, o, d, max_events=400) for a_rig in (whole, made_of(*shards)))
    # light that is turned back often tells how float32 moves and tilts the faces
    is_plain = expected.n_events < 16
    assert is_plain.mean() > 0.9
    assert np.array_equal(found.reason[is_plain], expected.reason[is_plain])
    lands = is_plain & expected.has_arrived
    assert lands.sum() > 1000
    assert np.abs(found.xy - expected.xy)[lands].max() < 0.01


def halves(gap):
    """Of a block of 0.1 m, parted at x = 0, a gap (m) between them or below 0 so much in common."""
    size = [SIZE / 2, SIZE, SIZE]
    return box(size, -X * SIZE / 4), box(size, X * (SIZE / 4 + gap))


def grazing(least, index, n=2000):
    """Rays into the block that meet the plane x = 0 from -x, and the cosines (n,) there, from the
    least on.
    """
    random = np.random.default_rng(3)
    cosine = np.exp(random.uniform(np.log(least), np.log(0.3), n))
    place = random.uniform(0.02, 0.08, n)  # how far behind the block's front
    x = -cosine / np.sqrt(1 - cosine**2) * place
    front = np.stack([x, np.full(n, -SIZE / 2), random.uniform(-0.02, 0.02, n)], axis=1)
    across = index * cosine  # by Snell's law
    d = np.stack([across, np.sqrt(1 - across**2), np.zeros(n)], axis=1)
    return front - 0.5 * d, d, cosine


@pytest.mark.usefixtures("has_kernel")
@pytest.mark.parametrize("gap", [-1.1e-8, -2.7e-9, 5e-10, 2.7e-9, 1.1e-8])
@pytest.mark.parametrize(
    ("indices", "least"), [((1.49, 1.49), 1e-6), ((1.33, 1.49), 1e-3), ((1.49, 1.33), 1e-3)]
)
def test_light_crosses_a_contact_at_any_angle(indices, least, gap):
    """As it does where the faces are in the very same place: in the same direction, and no further
    aside than the gap is long to the ray, or not at all between media of one index.
    """
    o, d, cosine = grazing(least, indices[0])
    expected, found = (traced(made_of(*halves(at), indices=indices), o, d) for at in (0.0, gap))
    assert (expected.n_events >= 3).all()
    assert np.abs(found.directions - expected.directions).max() < 1e-12
    aside = np.cross(found.positions - expected.positions, expected.directions)
    most = 1e-12 + (indices[0] != indices[1]) * 2 * abs(gap) / cosine
    assert (np.linalg.norm(aside, axis=1) <= most).all()


@pytest.mark.usefixtures("has_kernel")
@pytest.mark.parametrize("above", [-2e-9, 2e-9])
def test_a_display_hides_glass_behind_it_at_any_angle(above):
    """Glass whose face is that of the display, but for float32's rounding, is not met before it."""
    random = np.random.default_rng(4)
    glass = box([SIZE, SIZE, 0.02], Z * (above - 0.01))
    on_glass = replace(
        made_of(glass),
        plates=(),
        displays=(Display("display", rectangle(0 * Z, X, Y, 0.2, 0.2), 100, 100),),
    )
    n = 500
    slope = np.exp(random.uniform(np.log(1e-5), 0, n))
    d = np.stack([np.sqrt(1 - slope**2), np.zeros(n), -slope], axis=1)
    at = np.stack([*random.uniform(-0.04, 0.04, (2, n)), np.zeros(n)], axis=1)
    found = traced(on_glass, at - 0.3 * d, d)
    assert (found.reason == Reason.MISSED_GLASS).all()
    assert np.abs(found.positions - at).max() < 1e-6
