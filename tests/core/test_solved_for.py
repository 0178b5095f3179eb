"""The mark that tells a scene that was solved from others."""

import numpy as np
import pytest

from kiriko.core.solve.solved_for import SolvedFor, from_text, solved_for

RNG = np.random.default_rng(3)
PLACES = RNG.normal(0, 0.3, (4, 3, 4))
THINGS = [
    ((name, np.arange(5.0) + n), place)
    for n, (name, place) in enumerate(zip("abcd", PLACES, strict=True))
]


def scene(changed: int = -1, thing: object = None, place: np.ndarray | None = None) -> SolvedFor:
    """Four things, one of which may be another one or stand elsewhere."""
    things = list(THINGS)
    if changed >= 0:
        old = things[changed]
        things[changed] = (old[0] if thing is None else thing, old[1] if place is None else place)
    return solved_for(things, ("settings", 0.1))


def test_the_order_of_things_does_not_count() -> None:
    """Blender may list a scene's objects in another order after a file was loaded."""
    assert scene().is_same(solved_for(THINGS[::-1], ("settings", 0.1)))


@pytest.mark.parametrize("n", range(4))
def test_what_is_another_thing_or_elsewhere_is_told(n: int) -> None:
    """Another number in one thing, one micrometre, and one second of arc.

    Each is seen from both sides.
    """
    assert not scene().is_same(scene(n, thing=("a", np.arange(5.0) + 1e-9)))
    shifted = PLACES[n].copy()
    turned = PLACES[n].copy()
    shifted[0, 3] += 1e-6
    turned[0, :3] += 5e-6 * np.abs(turned[:, :3]).max()
    for place in (shifted, turned):
        other = scene(n, place=place)
        assert not scene().is_same(other)
        assert not other.is_same(scene())
    assert not scene().is_same(solved_for(THINGS, ("settings", 0.2)))
    assert not scene().is_same(solved_for(THINGS[:3], ("settings", 0.1)))


def test_moved_away_and_back_in_float32_is_the_same() -> None:
    """Half a metre there and back, in the numbers that Blender keeps, leaves a rounding.

    That is no change.
    """
    for n in range(4):
        back = PLACES[n].astype(np.float32)
        back[:, 3] = (back[:, 3] + np.float32(0.5)) - np.float32(0.5)
        assert scene().is_same(scene(n, place=back.astype(float)))


def test_it_survives_being_text() -> None:
    """Written and read again it is the same; nothing was known of results of earlier versions."""
    again = from_text(scene().as_text())
    assert again is not None
    assert scene().is_same(again)
    assert again.is_same(scene())
    for text in ("", "{", "[]", '{"content": ""}', '{"content": "", "places": [[1]]}'):
        assert from_text(text) is None


def test_rounding_is_that_of_the_bench_not_of_its_place() -> None:
    """A bench far from the origin: a move of a micrometre counts there as well."""
    far = [(thing, place + np.array([0, 0, 0, 1e4])) for thing, place in THINGS]
    moved = [(thing, place.copy()) for thing, place in far]
    moved[2][1][0, 3] += 1e-5
    assert solved_for(far, "").is_same(solved_for(far, ""))
    assert not solved_for(far, "").is_same(solved_for(moved, ""))
