"""How long it takes to rasterise cells and to paint through the shares: medians of a few runs.

Run it so: `PYTHONPATH=.dev/link:scripts:tests python -m bench.shares [--runs N] [--large]`.
"""

import argparse
import statistics
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from known.rasterised import rasterise, to_display, to_view

CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def viewer_pixels(n: int) -> NDArray[np.float64]:
    """The n x n pixels of a viewer as quads (n * n, 4, 2)."""
    y, x = np.divmod(np.arange(n * n), n)
    return np.stack([x, y], axis=1)[:, None] + CORNERS


def keystone(points: NDArray[np.float64], n: int, size: int) -> NDArray[np.float64]:
    """Viewer pixels turned, flipped and in perspective, about
    filling a display of size x size pixels.
    """
    x, y = np.moveaxis(points / n - 0.5, -1, 0)
    w = 1 + 0.2 * x - 0.15 * y
    return size * (
        np.stack([-0.93 * x - 0.27 * y, -0.25 * x + 0.9 * y], axis=-1) / w[..., None] + 0.5
    )


def median(run: Callable[[], object], runs: int) -> float:
    """Median seconds of a few calls."""
    seconds = []
    for _ in range(runs):
        start = time.perf_counter()
        run()
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds)


def measure(n: int, size: int, runs: int) -> tuple[int, float, float, float]:
    """Number of shares; seconds to rasterise, to sum onto the display and onto the
    viewer's image.
    """
    view = viewer_pixels(n)
    display = keystone(view, n, size)
    shares = rasterise((size, size), (n, n), view, display)
    ones = np.ones(len(shares))
    return (
        len(shares),
        median(lambda: rasterise((size, size), (n, n), view, display), runs),
        median(lambda: to_display(shares, ones), runs),
        median(lambda: to_view(shares, ones), runs),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument(
        "--large", action="store_true", help="also a viewer of 4096 x 4096 pixels (5 GB of memory)"
    )
    arguments = parser.parse_args()
    print("viewer display    shares  rasterise  to_display  to_view   (seconds)")

    for n, size in [(128, 512), (512, 512), (2048, 512), (512, 4096)] + [
        (4096, 512)
    ] * arguments.large:
        print(
            "{:6d} {:7d} {:9d}  {:9.3f}  {:10.3f}  {:7.3f}".format(
                n, size, *measure(n, size, arguments.runs)
            )
        )


if __name__ == "__main__":
    main()
