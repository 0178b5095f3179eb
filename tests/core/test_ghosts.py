"""Ghosts: which path a display pixel shows, against random rays and sums by hand."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from kiriko.core.base.errors import RigError
from kiriko.core.image.ghosts import NO_PATH, SeenPaths, paths_of
from kiriko.core.image.picture import picture_from_view
from kiriko.core.image.pyramid import Pyramid
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.trace import trace_all
from kiriko.core.map.pieces import Piece
from kiriko.core.map.shares import Shares
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session
from known.reference_rigs import ball_rig, bottle, cube_rig, lattice_image, rig
from known.work import solve

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def seen_twice(**options):
    """A bottle, whose rims show the view of its middle again."""
    return rig(
        bottle(),
        pixels=96,
        display_pixels=96,
        image=lattice_image(128),
        field=0.06,
        picture=0.05,
        display=0.1,
        **options,
    )


@cache
def solved(ghosts):
    """It, each way by a session of its own."""
    return solve(seen_twice(), ghosts=ghosts)


def some_shares(random, n, n_pixels, n_paths):
    size = n_pixels, 1
    return Shares(
        size,
        size,
        random.integers(0, n_pixels, n).astype(np.int32),
        np.zeros((n, 2)),
        np.zeros((3, n), np.float32),
        random.random(n),
        random.random(n),
        random.random(n),
        random.integers(1, 1 + n_paths, n).astype(np.uint64),
    )


def test_the_strongest_path_has_the_largest_sum():
    """However shares come, some at a time: against sums in a dictionary."""
    random = np.random.default_rng(0)
    for _ in range(20):
        n_pixels = 7
        batches = [some_shares(random, n, 7, 4) for n in (30, 1, 0, 12)]
        paths = SeenPaths((n_pixels, 1))
        sums = {}
        for shares in batches:
            paths.add(shares)
            for pixel, path, area, t in zip(
                *(
                    getattr(shares, name).tolist()
                    for name in ("display_index", "path", "area", "throughput")
                ),
                strict=True,
            ):
                sums[pixel, path] = sums.get((pixel, path), 0.0) + area * t * t
        found = paths.strongest()
        weights, contested = paths.weights()
        for pixel in range(n_pixels):
            here = {path: weight for (at, path), weight in sums.items() if at == pixel}
            assert found[pixel] == (max(here, key=here.get) if here else NO_PATH)
            assert weights[0, pixel] == pytest.approx(sum(here.values()), abs=1e-12)
            rest = 1 - max(here.values()) / sum(here.values()) if here else 0
            assert contested[0, pixel] == pytest.approx(rest, abs=1e-12)


def test_a_path_is_a_branch_and_the_way_round():
    """Turned over it is another path; turned, moved or stretched it is the same."""
    turned = SQUARE @ np.array([[0.6, 0.8], [-0.8, 0.6]]) * 3 + 7
    over = SQUARE[:, ::-1]
    view = np.stack([SQUARE] * 4)
    display = np.stack([SQUARE, turned, over, turned[:, ::-1]])
    branch = np.full(4, 12, np.uint64)
    found = paths_of(Piece(view, display, np.ones(4), branch))
    assert found[0] == found[1] != found[2] == found[3]
    assert (paths_of(Piece(display, view, np.ones(4), branch)) == found).all()
    assert (paths_of(Piece(view[:, :3], display[:, :3], np.ones(4), branch)) == found).all()
    assert (paths_of(Piece(view, display, np.ones(4), branch + np.uint64(8))) != found).all()


def test_a_pixel_shows_what_its_strongest_path_asks_for():
    """Against the mean colour of random rays of the path that
    most rays of a pixel take, where that is clear.

    Which way round a ray's surroundings are shown is told by two more rays beside it.
    """
    a_rig = seen_twice()
    n = 300_000
    side = 96
    step = 1e-4
    xy = np.random.default_rng(3).uniform(0, side, (n, 2))
    plan = compile_plan(a_rig, Settings())
    landings, across, along = (
        trace_all(plan, *a_rig.viewer.rays(xy + shift)) for shift in ([0, 0], [step, 0], [0, step])
    )
    is_on, pixel = landings.pixels(side, side)
    is_on &= (across.branch == landings.branch) & (along.branch == landings.branch)
    ax, ay = (across.xy - landings.xy).T
    bx, by = (along.xy - landings.xy).T
    path = landings.branch ^ (ax * by - ay * bx < 0)
    pixel = pixel[is_on]
    path = path[is_on]
    xy = xy[is_on]
    names, number = np.unique(path, return_inverse=True)
    counts = np.zeros((side * side, len(names)))
    np.add.at(counts, (pixel, number), 1)
    order = np.sort(counts, axis=1)
    first = order[:, -1]
    second = order[:, -2]
    is_clear = (first > 12) & (second > 3) & (second < 0.7 * first)

    assert is_clear.sum() > 200
    colours = Pyramid(a_rig.picture.image).sample(
        picture_from_view(a_rig.picture_place, a_rig.viewer, xy)
    )
    is_best = number == counts.argmax(axis=1)[pixel]
    expected = np.stack(
        [np.bincount(pixel[is_best], c[is_best], side * side) for c in colours.T], axis=1
    )
    expected /= np.maximum(first, 1)[:, None]
    mean, found = solved("mean"), solved("strongest")
    off = np.abs(found.source.reshape(-1, 3) - expected)[is_clear]
    before = np.abs(mean.source.reshape(-1, 3) - expected)[is_clear]

    assert off.mean() < 0.25 * before.mean()


def test_nothing_changes_where_each_pixel_is_seen_once():
    """Without ghosts both ways paint the same; coverage and map are the same in any case."""
    a_rig = ball_rig(3, pixels=64, display_pixels=64, picture=0.02)
    one = solve(a_rig)
    other = solve(a_rig, ghosts="strongest")
    is_shown = one.weight > 0

    assert np.abs(one.source - other.source)[is_shown].max() < 1e-6
    one, other = solved("mean"), solved("strongest")
    np.testing.assert_allclose(one.display_coverage, other.display_coverage, atol=1e-9)

    assert one.picture_coverage == pytest.approx(other.picture_coverage, abs=1e-12)
    assert (other.weight <= one.weight * (1 + 1e-12)).all()
    assert (other.weight[one.weight > 0] > 0).all()
    assert np.abs(one.source - other.source).max() > 0.1


def test_a_change_of_mind_traces_nothing():
    """Ghosts are settled when painting.

    Another picture is painted by the same paths, the same as from scratch.
    """
    a_rig = seen_twice()
    kept = Session()
    solve(a_rig, kept)
    assert solve(a_rig, kept, ghosts="strongest").n_rays == 0
    flipped = replace(a_rig.picture, image=a_rig.picture.image[::-1].copy())
    other = replace(a_rig, pictures=(flipped,))
    found = solve(other, kept, ghosts="strongest")
    assert found.n_rays == 0
    assert np.array_equal(found.source, solve(other, ghosts="strongest").source)


def test_ghosts_of_another_name_are_refused():
    with pytest.raises(RigError, match="Ghosts is 'none': set it to one of 'mean', 'strongest'"):
        solve(cube_rig(pixels=16), ghosts="none")
