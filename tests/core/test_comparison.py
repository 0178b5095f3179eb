"""Before and after, against glass whose effect is known."""

import numpy as np
import pytest

from kiriko.core.base.steps import run_steps
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.comparison import Comparer, fitted, side_by_side
from kiriko.core.solve.session import Session
from known.reference_rigs import cube_rig

SMALL = {"pixels": 64, "display_pixels": 64}


def compared(a_rig, comparer=None):
    settings = Settings()
    solution = run_steps(Session().solve(a_rig, settings))
    return run_steps((comparer or Comparer()).compare(solution, a_rig, settings))


def test_glass_that_does_not_refract_needs_no_compensation() -> None:
    """Before and after are one image where light went through the glass."""
    a_rig = cube_rig(ior=1.0, **SMALL)
    found = compared(a_rig)
    assert found.before == pytest.approx(found.after, abs=2e-3)
    assert np.abs(found.after - found.ideal).mean() < 0.02


def test_before_is_what_brute_force_sees_of_the_plain_picture() -> None:
    """The plain picture on the display, read where single rays through the glass land."""
    from kiriko.core.light.compile_plan import compile_plan
    from kiriko.core.light.trace import trace

    a_rig = cube_rig(**SMALL)
    comparer = Comparer()
    found = compared(a_rig, comparer)
    plain = comparer._plain

    # nine rays a pixel
    x, y = np.meshgrid((np.arange(64 * 3) + 0.5) / 3, (np.arange(64 * 3) + 0.5) / 3)
    xy = np.stack([x.ravel(), y.ravel()], axis=1)
    landed = trace(compile_plan(a_rig, Settings()), *a_rig.viewer.rays(xy)).xy
    is_there = np.isfinite(landed).all(axis=1)
    column, row = np.clip(np.floor(landed[is_there]).astype(int), 0, 63).T
    seen = np.zeros((len(xy), 3))
    seen[is_there] = plain[row, column]
    by_force = seen.reshape(64, 3, 64, 3, 3).mean(axis=(1, 3))

    assert np.abs(found.before - by_force).mean() < 0.02 * by_force.max()
    assert np.abs(found.after - by_force).mean() > 5 * np.abs(found.before - by_force).mean()


@pytest.mark.parametrize("size", [(32, 64), (64, 16), (7, 5)])
def test_source_fits_into_the_viewers_image(size: tuple[int, int]) -> None:
    """A grey image stays grey, in its shape, in the middle."""
    viewer = cube_rig(**SMALL).viewer
    found = fitted(np.full((*size, 3), 0.25, np.float32), viewer)
    is_grey = found[..., 0] > 0.1
    height, width = np.ptp(np.argwhere(is_grey), axis=0) + 1
    assert max(height, width) == 64
    assert height / width == pytest.approx(size[0] / size[1], rel=0.05)
    assert found[is_grey] == pytest.approx(0.25, abs=1e-5)


def test_side_by_side() -> None:
    both = side_by_side(np.zeros((2, 3, 3)), np.full((2, 3, 3), 0.5), 1)
    assert both[0, :, 0].tolist() == [0, 0, 0, 1, 0.5, 0.5, 0.5]
