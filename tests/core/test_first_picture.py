"""First pictures: their contents, when they are made, and that they change no later result."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.errors import RigError
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.mesh_cache import MeshCache
from kiriko.core.map.points import areas
from kiriko.core.map.sampling import Sampling
from kiriko.core.rig.settings import Settings
from kiriko.core.solve import first_picture
from kiriko.core.solve.session import Session
from known import reference_rigs
from known.reference_rigs import bottle, cube_rig, lattice_image
from known.work import drain, solve


def a_rig(pixels=160, **options):
    """As it is large enough for one coarse picture."""
    return cube_rig(pixels=pixels, display_pixels=96, image=lattice_image(64), **options)


def patience(monkeypatch, seconds):
    """How long the rig itself is at work before the first picture is made."""
    monkeypatch.setattr(first_picture, "WAIT_S", seconds)


@pytest.fixture
def impatient(monkeypatch):
    patience(monkeypatch, 0.0)


def in_sight(rig, session, shown, **settings):
    return first_picture.solve_in_sight(session, rig, Settings(**settings), shown.append)


def test_a_coarse_image_is_enlarged():
    """One of 2 x 2 fills 5 x 4 pixels, each with the value at its place."""
    small = np.arange(12, dtype=np.float32).reshape(2, 2, 3)
    big = first_picture.enlarged(small, 4, 5)
    assert big.shape == (5, 4, 3)
    assert np.array_equal(big[:, :, 0], np.repeat([[0, 0, 3, 3], [6, 6, 9, 9]], [3, 2], axis=0))


@pytest.mark.parametrize("progress", [0.0, 0.3, 0.5])
def test_the_result_is_that_of_a_plain_solve(monkeypatch, progress):
    """To the bit, wherever it rests for a coarse picture.

    That shows where things are: a shift by 4 pixels is more.
    """
    expected = solve(a_rig(), brightness=True).source
    patience(monkeypatch, np.inf)
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


def test_a_coarse_map_quarters_no_pixel():
    """Its quads are whole pixels, where the map itself has quarters: half of each is a triangle."""
    bottle_rig = reference_rigs.rig(bottle(), pixels=36, image=lattice_image(16))

    def areas_of_quads(is_coarse):
        found = drain(Sampling(compile_plan(bottle_rig, Settings()), is_coarse).sample())
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
    patience(monkeypatch, np.inf)
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

    monkeypatch.setattr(Session, "solve_preview", refuse)
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
            first_picture.check_light(MeshCache(), rig, Settings())
        assert str(found.value) == str(plain.value)

    def refuse(*_):
        yield 0.0
        raise RigError("The display stays dark.")

    monkeypatch.setattr(Session, "solve_preview", refuse)
    first_picture.check_light(MeshCache(), seen, Settings())
    monkeypatch.undo()
    monkeypatch.setattr(Session, "solve", refuse)
    first_picture.check_light(MeshCache(), seen, Settings())


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


def test_several_viewers_share_the_pixels_of_one():
    """With the margin and the tolerance of their display's coarse pixels."""
    alone = cube_rig(pixels=160, display_pixels=1024)
    two = replace(alone, viewers=(alone.viewer, replace(alone.viewer, name="other")))
    first, settings = first_picture.coarser(two, Settings(margin=3))
    assert [viewer.width for viewer in first.viewers] == [23, 23]
    assert first.display.width == 512
    assert settings == Settings(tolerance=2.0, margin=2)
