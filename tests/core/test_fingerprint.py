"""Equal content, equal fingerprint."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from kiriko.core.base.fingerprint import fingerprint
from kiriko.core.rig.rig import ConstantIndex, Glass, Index, Mesh


@dataclass(frozen=True)
class Cauchy(Index):
    """An index that depends on the wavelength."""

    a: float
    b: float

    def at(self, wavelength: float) -> float:
        return self.a + self.b / wavelength**2


TRIANGLE = Mesh(np.eye(3), np.array([[0, 1, 2]]))
GLASS = Glass("glass", TRIANGLE, ConstantIndex(1.5))


def test_content_counts_and_names_do_not():
    """A copy has the same fingerprint, whatever its name.

    Another number anywhere in it has another one.
    """
    copy = Glass("other", Mesh(np.eye(3), np.array([[0, 1, 2]])), ConstantIndex(1.5))
    assert fingerprint(GLASS) == fingerprint(copy)
    moved = np.eye(3)
    moved[1, 2] = np.nextafter(0.0, 1.0)
    others = (
        replace(GLASS, priority=1),
        replace(GLASS, ior=ConstantIndex(np.nextafter(1.5, 2))),
        replace(GLASS, ior=Cauchy(1.5, 0.0)),
        replace(GLASS, mesh=replace(TRIANGLE, vertices=moved)),
    )

    assert len({fingerprint(glass) for glass in (GLASS, *others)}) == 5
    assert fingerprint(1, (2, 3)) != fingerprint(1, 2, 3)
    assert fingerprint(np.zeros((2, 3))) != fingerprint(np.zeros((3, 2)))


@pytest.mark.parametrize(
    "thing",
    [lambda wavelength: 1.5, object(), [1.5], {"index": 1.5}],
    ids=["function", "object", "list", "dict"],
)
def test_what_has_no_content_is_refused(thing):
    """A function's address tells nothing: once it is gone another function may have it."""
    with pytest.raises(TypeError, match="has no content to compare"):
        fingerprint(replace(GLASS, ior=thing))
