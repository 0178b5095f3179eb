"""How many rays a view map is guessed to take, whenever that is mended."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from kiriko.core.map.ray_guess import Rays, RaysAhead


@contextmanager
def guessed() -> Iterator[list[tuple[int, float]]]:
    """Gather the rays so far, and those in all by each guess, of the view maps made meanwhile."""
    found = []
    expect = RaysAhead.expect

    def kept(ahead: RaysAhead, rays: Rays) -> None:
        expect(ahead, rays)
        found.append((ahead.done.every, ahead.expected))

    RaysAhead.expect = kept
    try:
        yield found
    finally:
        RaysAhead.expect = expect


def factors(guesses: list[tuple[int, float]], n_rays: int) -> np.ndarray:
    """Rays to come by each guess (n,), as a part of those that
    came, where 10 % to 90 % are told to be done.
    """
    n_done, expected = np.array(guesses).T
    some = (n_done >= 0.1 * expected) & (n_done <= 0.9 * expected)
    return (expected - n_done)[some] / (n_rays - n_done)[some]
