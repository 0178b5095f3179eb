"""Triangles that spread far over the display light as much of it as if no pixel did without."""

import numpy as np
import pytest

from kiriko.core.map.decimation import THINNING, Thinning, in_pixels
from kiriko.core.map.native_divide import Divided
from kiriko.core.map.share_batches import ShareBatches
from kiriko.core.map.shares import Coverage
from kiriko.core.native import loading
from known.rasterised import rasterise

SIZE = 240, 136
N = 2000


@pytest.fixture(scope="module")
def far():
    """Triangles (n, 3, 2) of a pixel each, from near the middle of a display to all sides, most
    beyond it.
    """
    random = np.random.default_rng(5)
    near = random.normal([100, 60], 20, (N, 1, 2))
    way = random.normal(size=(N, 2, 2)) * 10 ** random.uniform(1, 6, (N, 1, 1))
    display = np.concatenate([near, near + way], axis=1)
    corner = np.stack(np.divmod(np.arange(N), 64)[::-1], axis=1)[:, None]
    return corner + np.array([[0.1, 0.1], [0.9, 0.2], [0.3, 0.8]]), display


def looked_at(pieces, size=SIZE):
    thinning = Thinning(size)
    for some in (slice(0, 700), slice(700, None)):
        thinning.add(*(corners[some] for corners in pieces))
    return thinning


def batches(far, thinning):
    view, display = far
    path = np.arange(len(view), dtype=np.uint64)
    return ShareBatches(
        SIZE,
        (64, 64),
        True,
        lambda: [(view, display.copy(), np.ones(len(view)), path)],
        has_path=True,
        thinning=thinning,
    )


def light(shares):
    """Light of each display pixel (h, w), and the number of shares."""
    n = SIZE[0] * SIZE[1]
    some = list(shares)
    found = sum(np.bincount(part.display_index, part.area, n) for part in some)
    return found.reshape(SIZE[::-1]), sum(map(len, some))


@pytest.fixture(scope="module")
def exact(far):
    """Light of each display pixel where none does without."""
    return light(batches(far, None))


def test_the_light_is_the_same_in_the_mean(far, exact):
    """Of blocks of 8 x 8 pixels: as far off as chance has it, and not on the whole."""
    thinning = looked_at(far)
    exact, n_exact = exact
    found, n_found = light(batches(far, thinning))
    assert n_found < n_exact / 5
    assert found.sum() == pytest.approx(exact.sum(), rel=2e-3)

    def of_blocks(values):
        return values.reshape(17, 8, 30, 8).sum(axis=(1, 3))

    # each choice stands for stride^2 pixels: the variance of a block is no more than the
    # sum over its shares of their area squared
    variance = of_blocks(
        sum(
            np.bincount(part.display_index, part.area**2, exact.size)
            for part in batches(far, thinning)
        ).reshape(exact.shape)
    )
    off = (of_blocks(found) - of_blocks(exact)) / np.sqrt(variance)
    assert abs(off.mean()) < 0.15
    assert np.abs(off).max() < 5
    assert off.std() < 1.1


def test_pixels_are_off_by_no_more_than_their_number_of_pieces_has_it(far, exact):
    """By 1 / sqrt(per_pixel) of their light, rms, over pixels and over blocks as bright; and those
    that get most of their light from a few pieces by far less.
    """
    exact, _ = exact
    found, _ = light(batches(far, looked_at(far)))
    off = np.sqrt(((found - exact) ** 2).sum() / (exact**2).sum())
    assert off < 0.5 / np.sqrt(THINNING.per_pixel)
    order = np.argsort(exact, axis=None)
    for some in np.array_split(order[exact.ravel()[order] > 0], 8):
        a, b = found.ravel()[some], exact.ravel()[some]
        assert np.sqrt(((a - b) ** 2).mean() / (b**2).mean()) < 1 / np.sqrt(THINNING.per_pixel)
        assert a.sum() == pytest.approx(b.sum(), rel=0.02)


def test_pieces_are_whole_where_few_spread(far):
    """The same shares, to the bit: also of those that cover few pixels, or have no place."""
    few = tuple(corners[:6].copy() for corners in far)
    thinning = looked_at(few)
    assert (thinning.strides(*few) == 1).all()
    expected, found = ([*batches(few, some)] for some in (None, thinning))
    for a, b in zip(expected, found, strict=True):
        assert np.array_equal(a.display_index, b.display_index)
        assert np.array_equal(a.area, b.area)

    crowd = looked_at(far)
    small = np.array([[120.0, 60], [130, 60], [120, 70]])
    odd = np.stack([small, np.full((3, 2), np.nan), np.full((3, 2), np.inf), small * 1e9])
    assert (crowd.strides(far[0][:4], odd)[:3] == 1).all()


def test_strides_keep_enough(far):
    """Shares enough of each piece, and of each that is more than a small part of the light."""
    thinning = looked_at(far)
    strides = thinning.strides(*far)
    assert strides.max() > 4
    for stride in np.unique(strides)[1:]:
        which = np.flatnonzero(strides == stride)[:20]
        for view, display in zip(far[0][which], far[1][which], strict=True):
            whole = rasterise(SIZE, (64, 64), view[None], display[None])
            assert len(whole) >= THINNING.least_shares * stride**2
            row, column = np.divmod(whole.display_index, SIZE[0])
            block = row // THINNING.block_px * -(-SIZE[0] // THINNING.block_px)
            block += column // THINNING.block_px
            part = (whole.area / whole.display_area)[0] / thinning.light[block].min()
            assert THINNING.per_pixel * part * stride**2 <= 1 + 1e-9


@pytest.mark.skipif(loading.library() is None, reason="no compiled kernel")
def test_numpy_and_the_kernel_choose_the_same_pixels(far):
    """Strides, pixels, and the light of each."""
    some = tuple(corners[:1500] for corners in far)
    found, n_found = light(batches(some, looked_at(some)))
    with loading.off():
        expected, n_expected = light(batches(some, looked_at(some)))
    assert n_found == n_expected
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)


def test_each_pixel_of_a_block_is_chosen_as_often():
    """Also where the display ends within a block: what falls beside it is left out."""
    stride, n = 5, 40_000
    blocks = -(-SIZE[0] // stride) * -(-SIZE[1] // stride)
    last = np.full(n, blocks - 1)
    ones = np.ones(n)
    whole = Divided(last, np.zeros((n, 2)), np.zeros((3, n), np.float32), ones, ones, np.arange(n))
    view = np.random.default_rng(3).uniform(0, 64, (n, 3, 2))
    found = in_pixels(whole, view, stride, SIZE)
    # 136 = 27 * 5 + 1 rows, 240 = 48 * 5 columns
    row, column = np.divmod(found.display_index, SIZE[0])
    assert set(row) == {135}
    assert set(column) == set(range(235, 240))
    counts = np.bincount(column - 235)
    assert np.abs(counts - n / 25).max() < 5 * np.sqrt(n / 25)
    assert (found.display_area == 25).all()


def test_faint_light_beside_bright_light_stays():
    """Where strips of bright light two blocks wide stand among faint light, nothing of it goes:
    the bright light of elsewhere is no measure for it.
    """
    size = 256, 256
    random = np.random.default_rng(3)
    corner = np.array([[0.1, 0.1], [0.9, 0.2], [0.3, 0.8]])
    width = 2 * THINNING.block_px

    def strip(left, right):
        return [[[left, 0], [right, 0], [right, 256]], [[left, 0], [right, 256], [left, 256]]]

    bright = np.concatenate([2 * strip(x, x + width) for x in range(0, 256, 2 * width)]).astype(
        float
    )
    faint = np.array(100 * strip(-50, 306), float) + random.uniform(-20, 20, (200, 1, 2))
    scale = np.repeat([1.0, 0.01], [len(bright), len(faint)])[:, None, None]
    display = np.concatenate([bright, faint])
    view = corner * scale + random.integers(0, 60, (len(display), 1, 2))

    def pieces():
        return [(view, display.copy(), np.ones(len(view)), None)]

    exact, found = (Coverage(size, (64, 64)) for _ in range(2))
    thinning = looked_at((view, display), size)
    for coverage, some in ((exact, None), (found, thinning)):
        for shares in ShareBatches(size, (64, 64), False, pieces, thinning=some):
            coverage.add(shares)
    is_faint = np.arange(256) % (2 * width) >= width
    np.testing.assert_allclose(found.weight[:, is_faint], exact.weight[:, is_faint], rtol=1e-9)
    np.testing.assert_allclose(found.weight, exact.weight, rtol=0.01)
    assert (found.of_display == exact.of_display).all()


def test_the_display_is_covered_as_if_no_piece_were_thinned(far):
    """To a thousandth, and no pixel that was seen whole is dark."""
    covered = []
    for thinning in (None, looked_at(far)):
        coverage = Coverage(SIZE, (64, 64))
        for shares in batches(far, thinning):
            coverage.add(shares)
        covered.append(coverage.of_display)
    exact, found = covered
    assert found.mean() == pytest.approx(exact.mean(), abs=1e-3)
    assert (found[exact == 1] > 0).all()
