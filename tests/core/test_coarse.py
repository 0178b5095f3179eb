"""First pictures: their contents, when they are made, and
that they change no later result.
"""

from dataclasses import replace
from itertools import count

import numpy as np
import pytest

from kiriko.core.base.errors import RigError
from kiriko.core.lab.atlas.heads import evenly, viewer_at
from kiriko.core.light.compile_plan import make_plan
from kiriko.core.light.mesh_cache import Kept
from kiriko.core.map.points import areas
from kiriko.core.map.sampling import Sampling
from kiriko.core.rig.settings import Settings
from kiriko.core.solve import coarse
from kiriko.core.solve.session import Session
from known import reference_rigs
from known.reference_rigs import bottle, cube_rig, lattice_image
from known.work import drain, solve


def a_rig(pixels=160, **options):
    """As it is large enough for one coarse picture."""
    return cube_rig(pixels=pixels, display_pixels=96, image=lattice_image(64), **options)


def patience(monkeypatch, seconds):
    """How long the rig itself is at work before the first picture is made."""
    patient = replace(coarse.COARSE, tracing_s=seconds, painting_s=seconds)
    monkeypatch.setattr(coarse, "COARSE", patient)


@pytest.fixture
def impatient(monkeypatch):
    patience(monkeypatch, 0.0)


def in_sight(rig, session, shown, **settings):
    return coarse.solve_in_sight(session, rig, Settings(**settings), shown.append)


def test_a_coarse_image_is_enlarged():
    """One of 2 x 2 fills 5 x 4 pixels, each with the value at its place."""
    small = np.arange(12, dtype=np.float32).reshape(2, 2, 3)
    big = coarse.enlarged(small, 4, 5)
    assert big.shape == (5, 4, 3)
    assert np.array_equal(big[:, :, 0], np.repeat([[0, 0, 3, 3], [6, 6, 9, 9]], [3, 2], axis=0))


@pytest.mark.parametrize("progress", [0.0, 0.3, 0.6, 0.85])
def test_the_result_is_that_of_a_plain_solve(monkeypatch, progress):
    """To the bit, wherever it rests for a coarse picture.

    That shows where things are: a shift by 4 pixels is more.
    """
    expected = solve(a_rig(), brightness=True).source
    patience(monkeypatch, np.inf)
    # so that this one is large
    monkeypatch.setattr(coarse, "COARSE", replace(coarse.COARSE, display_px=95))
    shown = []
    work = in_sight(a_rig(), Session(), shown, brightness=True)
    while next(work) < progress:
        pass
    patience(monkeypatch, 0.0)

    assert np.array_equal(drain(work).source, expected)
    (image,) = shown
    assert image.shape == expected.shape
    off, moved = (
        np.abs(other - expected).mean() for other in (image, np.roll(expected, 4, axis=1))
    )

    assert 0 < off < 0.5 * moved


class Slow:
    """A session of which each step takes a second."""

    is_tracing = True

    def solve(self, rig, settings):
        for n in range(200):
            yield n / 400
        return "solved"

    def glance(self, rig, settings):
        yield 0.5
        return np.full((1, 1, 3), rig.viewer.width, np.float32)


def test_the_finer_the_picture_the_later_it_comes(monkeypatch):
    """Each takes 64 times as long as the one before, and comes after 64 times the work."""
    patience(monkeypatch, 2.0)
    clock = count()
    monkeypatch.setattr(coarse, "perf_counter", lambda: float(next(clock)))
    shown = []
    after = []
    steps = enumerate(in_sight(a_rig(1500), Slow(), shown))
    for n, progress in steps:
        assert progress < 0.5
        after += [n] * (len(shown) - len(after))
    assert [image[0, 0, 0] for image in shown] == [36, 250]
    assert after == [2 + 2, 128 + 2 + 2]  # with the steps of the pictures themselves


def test_a_coarse_map_quarters_no_pixel():
    """Its quads are whole pixels, where the map itself has quarters: half of each is a triangle."""
    bottle_rig = reference_rigs.rig(bottle(), pixels=36, image=lattice_image(16))

    def areas_of_quads(is_coarse):
        found = drain(Sampling(make_plan(bottle_rig, Settings()), is_coarse).sample())
        return set(2 * areas(found.points.view, found.quads[:, :3]))

    assert areas_of_quads(True) == {1.0}
    assert areas_of_quads(False) > {1.0}


def test_what_is_fast_has_no_coarse_picture(impatient, monkeypatch):
    """Where nothing is traced nothing coarse is faster.

    Nor is it for a small viewer, or for a solve that is nearly done.
    """
    session = Session()
    shown = []
    solve(a_rig(), session)
    assert drain(in_sight(a_rig(), session, shown)).n_rays == 0
    drain(in_sight(a_rig(95), Session(), shown))
    monkeypatch.setattr(coarse, "COARSE", replace(coarse.COARSE, tracing_s=np.inf))
    drain(in_sight(a_rig(), Session(), shown))
    assert not shown


def test_a_solve_that_is_given_up_leaves_what_was_known(impatient):
    """The optics of the solve before do not give way to those of
    the coarse picture: again they need no tracing.
    """
    session = Session()
    shown = []
    solve(a_rig(), session)
    work = in_sight(a_rig(), session, shown, tolerance=0.05)
    while not shown:
        next(work)
    work.close()
    assert solve(a_rig(), session).n_rays == 0


def test_a_coarse_viewer_may_miss_what_the_fine_one_sees(impatient, monkeypatch):
    """Then there is no coarse picture, and the result is the same."""

    def refuse(*_):
        yield 0.0
        raise RigError("The display stays dark.")

    monkeypatch.setattr(Session, "glance", refuse)
    shown = []
    assert np.array_equal(drain(in_sight(a_rig(), Session(), shown)).source, solve(a_rig()).source)
    assert not shown


def test_light_is_looked_for_before_a_job(monkeypatch):
    """What cannot be solved is refused in the words of a plain solve, and nothing else is, where a
    coarse viewer misses light, too. A rig of which a coarse one shows something is not solved.
    """
    seen = a_rig()
    aside = replace(
        seen.picture, mesh=replace(seen.picture.mesh, vertices=seen.picture.mesh.vertices + 10)
    )
    for rig in (a_rig(plate=1e-6), replace(seen, pictures=(aside,))):
        with pytest.raises(RigError) as plain:
            solve(rig)
        with pytest.raises(RigError) as found:
            coarse.check_light(Kept(), rig, Settings())
        assert str(found.value) == str(plain.value)

    def refuse(*_):
        yield 0.0
        raise RigError("The display stays dark.")

    monkeypatch.setattr(Session, "glance", refuse)
    coarse.check_light(Kept(), seen, Settings())
    monkeypatch.undo()
    monkeypatch.setattr(Session, "solve", refuse)
    coarse.check_light(Kept(), seen, Settings())


def test_what_cannot_be_solved_shows_nothing(impatient):
    """Settings that are none, a plate that no ray meets, a
    picture out of sight: refused as by a plain solve.
    """
    seen = a_rig()
    aside = replace(
        seen.picture, mesh=replace(seen.picture.mesh, vertices=seen.picture.mesh.vertices + 10)
    )

    for rig, settings in (
        (seen, {"tolerance": 0.0}),
        (a_rig(plate=1e-6), {}),
        (replace(seen, pictures=(aside,)), {}),
    ):
        shown = []
        with pytest.raises(RigError) as plain:
            solve(rig, **settings)
        with pytest.raises(RigError) as found:
            drain(in_sight(rig, Session(), shown, **settings))
        assert str(found.value) == str(plain.value)
        assert not shown


def nine(**options):
    """A rig with a 3 x 3 grid of viewers, 60 mm each way."""
    alone = a_rig(**options)
    offsets = evenly((3, 3, 1), (0.06, 0.06, 0.0))
    viewers = [viewer_at(alone.viewer, alone.picture_place, offset) for offset in offsets]
    named = [replace(viewer, name=f"{k}") for k, viewer in enumerate(viewers)]
    return replace(alone, viewers=tuple(named))


def eroded(mask):
    """A mask without the pixels next to others."""
    padded = np.pad(mask, 1)
    h, w = mask.shape
    around = [padded[y : y + h, x : x + w] for y in range(3) for x in range(3)]
    return np.logical_and.reduce(around)


def test_a_first_picture_is_that_of_the_viewer_in_the_middle():
    """Of nine viewers it has the middle one as if it were alone, and those at the corners."""
    rig = nine()
    first, settings = coarse.coarsest(rig, Settings(margin=3))
    sizes = {viewer.name: (viewer.width, viewer.height) for viewer in first.viewers}
    assert sizes == {"4": (32, 32)} | dict.fromkeys("0268", (12, 12))
    assert {viewer.name: viewer.weight for viewer in first.viewers}["4"] == 1
    assert settings == Settings(tolerance=2.0, margin=3, disagreement="blended")


def test_who_counts_more_is_nearer_to_the_middle():
    """Of three viewers in a row the last takes the middle's place where it counts for ten."""
    row = replace(nine(), viewers=nine().viewers[3:6])
    heavy = replace(row, viewers=(*row.viewers[:2], replace(row.viewers[2], weight=10.0)))
    for rig, name in ((row, "4"), (heavy, "5")):
        weights = {
            viewer.name: viewer.weight for viewer in coarse.coarsest(rig, Settings())[0].viewers
        }
        assert max(weights, key=weights.get) == name


def test_two_viewers_share_the_pixels_of_one():
    """Neither is in the middle, and they are settled as in the rig itself."""
    two = replace(nine(), viewers=nine().viewers[:2])
    first, settings = coarse.coarsest(two, Settings())
    assert [viewer.width for viewer in first.viewers] == [23, 23]
    assert settings.disagreement == "sharp"


def test_a_first_picture_shows_what_only_others_see():
    """The viewer in the middle sees the middle of the display alone: beside it the others light
    what the result lights, and where it sees anything the picture is its own, to a hundredth.
    """
    rig = nine()
    narrow = replace(rig.viewers[4], window=tuple(0.3 * np.array(rig.viewers[4].window)))
    rig = replace(rig, viewers=(*rig.viewers[:4], narrow, *rig.viewers[5:]))
    image = np.ones((8, 8, 4), np.float32)
    image[:4] = 0.5, 0.25, 1.0, 1.0
    rig = replace(rig, pictures=(replace(rig.picture, image=image),))

    def glance(viewers):
        first, settings = coarse.coarsest(rig, Settings())
        return drain(Session().glance(replace(first, viewers=viewers(first.viewers)), settings))

    every = glance(lambda viewers: viewers)
    alone = glance(lambda viewers: viewers[-1:])
    is_lit = solve(rig).source.any(axis=2)
    assert alone.any(axis=2)[is_lit].mean() < 0.5
    assert every.any(axis=2)[is_lit].mean() > 0.95  # to the outline, known to a coarse pixel
    inner = eroded(alone.any(axis=2))
    assert np.abs(every - alone)[inner].max() < 0.02


def test_a_viewer_who_sees_no_picture_is_not_left_out():
    """So nothing is shown of a rig that is refused for it, as for no other fault."""
    rig = nine()
    away = replace(rig.viewers[1], axes=rig.viewers[1].axes * [[1], [-1], [-1]], name="away")
    rig = replace(rig, viewers=(rig.viewers[0], away, *rig.viewers[2:]))
    first, settings = coarse.coarsest(rig, Settings())
    assert "away" in {viewer.name for viewer in first.viewers}
    with pytest.raises(RigError) as found:
        drain(Session().glance(first, settings))
    with pytest.raises(RigError) as plain:
        solve(rig)
    assert str(found.value) == str(plain.value)
