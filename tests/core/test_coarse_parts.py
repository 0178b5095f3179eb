"""Glass that is too coarse to tell which surface was meant (core/solve/coarse_parts.py)."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from kiriko.core.light.compile_plan import make_plan
from kiriko.core.light.plan import Counts
from kiriko.core.map.view_map import NO_ERROR
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.accuracy import measure
from kiriko.core.solve.coarse_parts import coarsest, followed
from kiriko.core.solve.remarks import remarks_on
from kiriko.core.solve.tessellation import tessellation
from known.judged_meshes import OPTIONS, coarse, disturbed, errors, hull, judged
from known.reference_rigs import rig
from known.work import drain

SLABS = [("wavy slab", 24), ("wavy slab", 32)]
ELLIPSOIDS = [("ellipsoid", 11), ("ellipsoid", (8, 12)), ("ellipsoid", (9, 6)), ("lentil", 12)]
TORI = [("torus", 12), ("torus", 13), ("torus", (16, 6)), ("torus", (24, 6))]


def planned(mesh, surface="automatic"):
    return make_plan(rig(replace(mesh, surface=surface), **OPTIONS), Settings())


def told(mesh, surface="automatic"):
    return drain(tessellation(planned(mesh, surface)))


@pytest.mark.parametrize(("shape", "segments"), [*SLABS, *ELLIPSOIDS, ("lentil", (11, 8))])
def test_what_coarse_regular_glass_costs_is_told(shape, segments):
    """It is at least six tenths of the error against the shape that was meant, and at most twice.

    Facets were told to cost a hundredth of a pixel on waves that they miss by one.
    """
    mesh = coarse(shape, segments)
    found = told(mesh)
    true = errors(shape, mesh, "automatic").rest
    assert found.cause == "coarse"
    assert 0.6 * true < found.error < 2 * true


@pytest.mark.parametrize(
    ("shape", "n", "seed"), [("lentil", 60, 6), ("lentil", 120, 6), ("ellipsoid", 60, 6)]
)
def test_what_coarse_uneven_glass_costs_is_told(shape, n, seed):
    """The same of hulls of so few places that their faces turn far, however they lie."""
    mesh = hull(shape, n, 0.0, seed)
    found = told(mesh)
    true = errors(shape, mesh, "automatic").rest
    assert found.cause == "coarse"
    assert 0.6 * true < found.error < 2 * true


@pytest.mark.parametrize(("shape", "segments"), TORI)
def test_light_that_goes_another_way_is_told(shape, segments):
    """Facets of six around a tube lose light that the torus lets arrive. The share that goes
    another way is no less than that, and no more than twice as much.
    """
    mesh = coarse(shape, segments)
    lost = errors(shape, mesh, "automatic").lost / len(judged(shape).xy)
    found = told(mesh)
    assert found.cause == "coarse"
    assert lost < found.coarse.elsewhere < 2 * lost


@pytest.mark.parametrize("noise", [1e-3, 1e-2])
@pytest.mark.parametrize("name", ["ball, 1280", "ball, 5120", "torus, 4096"])
def test_noise_is_not_taken_for_coarseness(name, noise):
    """All of the mesh is in doubt for its noise: a finer one of as much would not help."""
    mesh = disturbed(name, 0, noise)
    plan = planned(mesh)
    (n_doubted,) = plan.counts.n_doubted
    assert n_doubted > 0.95 * len(mesh.triangles)
    assert coarsest(plan.counts) == -1
    assert drain(tessellation(plan)).cause == "drawn"


@pytest.mark.parametrize(("shape", "segments"), [("ellipsoid", 11), ("torus", 12)])
def test_both_choices_are_as_far_from_each_other(shape, segments):
    """Where all is left as drawn, Automatic and Smooth tell of the same two surfaces."""
    mesh = coarse(shape, segments)
    automatic, smooth = (told(mesh, surface).coarse for surface in ("automatic", "smooth"))
    assert automatic == pytest.approx(smooth, rel=1e-9)


@pytest.mark.parametrize(("shape", "segments"), [("ellipsoid", 11), *TORI[:3]])
def test_automatic_is_not_advised_where_it_is_further_off(shape, segments):
    """Smooth is the nearer one by the rms. Its normals jump by far more than it is off, and the
    note asks for more faces, and for a look at both.
    """
    mesh = coarse(shape, segments)
    smooth, automatic = (errors(shape, mesh, choice).rms for choice in ("smooth", "automatic"))
    assert smooth < automatic
    plan = planned(mesh, "smooth")
    (note,) = notes_of(plan)
    assert "'glass' is too coarse to tell which surface was meant" in note
    assert "Give it more faces, or compare both." in note
    assert "Automatic" not in note


def notes_of(plan):
    """Notes on the mesh of a plan, by a sample of rays."""
    accuracy = drain(measure(plan))
    assert accuracy.tessellation.error > plan.settings.tolerance
    channel = SimpleNamespace(
        plan=plan, accuracy=accuracy, map_error=NO_ERROR, misses={}, glare=None
    )
    notes = [r.told() for r in remarks_on((channel,), np.zeros((1, 1, 3), np.float32))]
    return [note for note in notes if "The mesh costs" in note]


def test_the_coarsest_part_is_the_one_that_is_told():
    """By its share, beyond a half, and whatever number it has."""
    none = (0, 0, 0)
    counts = Counts(none, none, n_doubted=(9, 9, 9), n_coarse=(2, 9, 8), n_curved=(0, 2, 0))
    assert coarsest(counts) == 2
    assert coarsest(replace(counts, n_coarse=(4, 5, 4))) == -1
    assert coarsest(replace(counts, n_coarse=none)) == -1
    assert coarsest(Counts((), (), (), (), ())) == -1


def test_one_part_is_followed_otherwise_and_the_others_stay():
    """Glasses and mirrors are numbered on, as in what is told of them."""
    a_rig = rig(coarse("ball", 8), **OPTIONS)
    (glass,) = a_rig.glasses
    two = replace(a_rig, glasses=(glass, replace(glass, name="other")))
    assert [g.mesh.surface for g in followed(two, "facets", 1).glasses] == ["smooth", "facets"]
    assert [g.mesh.surface for g in followed(two, "facets").glasses] == ["facets", "facets"]
    assert followed(two, "facets", 1).glasses[0] is glass
