"""How fast light is in a glass."""

from dataclasses import dataclass

WAVELENGTH = 587.6e-9  # m, the helium d line, at which indices of refraction are given


class Index:
    """An index of refraction as data: a frozen dataclass with the numbers of a formula.

    A function has no content to compare, so that nothing tells whether it is still the same.
    """

    def at(self, wavelength: float) -> float:
        """Index of refraction at a wavelength in metres."""
        raise NotImplementedError

    def __call__(self, wavelength: float) -> float:
        """The same, as scripts of 0.1 ask for it."""
        return self.at(wavelength)


@dataclass(frozen=True)
class ConstantIndex(Index):
    """An index of refraction that does not depend on the wavelength."""

    value: float

    def at(self, wavelength: float) -> float:
        """Index of refraction at any wavelength."""
        return self.value
