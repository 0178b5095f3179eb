"""Index of refraction as data, by wavelength: formulas, each with the range it was fitted in."""

from dataclasses import dataclass

import numpy as np

from ..base.errors import RigError, out_of_range
from ..base.messages import Message

# m, lines of helium (d) and hydrogen (F, C), the references of ISO 7944
WAVELENGTH = 587.6e-9  # the reference for indices of refraction
F_LINE, C_LINE = 486.1327e-9, 656.2725e-9

Span = tuple[float, float]
VISIBLE: Span = (360e-9, 830e-9)  # m, the range of CIE 1931 (ISO/CIE 11664-1)

# m, dominant wavelengths of red, green and blue: where the line from white (D65) through a primary
# meets the spectral locus of CIE 1931, to 1 nm
Primaries = tuple[float, float, float]
SRGB_PRIMARIES: Primaries = (611e-9, 549e-9, 464e-9)  # chromaticities of ITU-R BT.709
P3_PRIMARIES: Primaries = (615e-9, 544e-9, 464e-9)  # chromaticities of SMPTE EG 432-1


class Index:
    """An index of refraction as data: a frozen dataclass with the numbers of a formula.

    A function would have no content to compare for changes.
    """

    def at(self, wavelength: float) -> float:
        """Index of refraction at a wavelength, m."""
        raise NotImplementedError

    def check(self, owner: str) -> None:
        """Raise RigError for numbers out of bounds."""


@dataclass(frozen=True)
class ConstantIndex(Index):
    """An index of refraction independent of the wavelength."""

    value: float

    def at(self, wavelength: float) -> float:
        """Index of refraction at any wavelength."""
        return self.value


def _check_span(wavelength: float, span: Span) -> None:
    """Raise RigError for a wavelength outside the span of a formula, m."""
    if not span[0] <= wavelength <= span[1]:
        raise RigError(
            "The wavelength of {nm:g} nm is outside the formula of a glass ({least:g} to {most:g}"
            " nm): change the primaries of the display, or the dispersion of the glass.",
            nm=1e9 * wavelength,
            least=1e9 * span[0],
            most=1e9 * span[1],
        )


@dataclass(frozen=True)
class AbbeIndex(Index):
    """Cauchy's formula with two terms, n = A + B / wavelength^2, through an index and an Abbe
    number.

    nd : index at WAVELENGTH
    abbe : V = (nd - 1) / (nF - nC), exact at the lines F and C; above 0
    """

    nd: float
    abbe: float

    def at(self, wavelength: float) -> float:
        """Index of refraction at a wavelength, m.

        Raises
        ------
        RigError : not visible light
        """
        _check_span(wavelength, VISIBLE)
        slope = (self.nd - 1) / self.abbe / (F_LINE**-2 - C_LINE**-2)
        return self.nd + slope * (wavelength**-2 - WAVELENGTH**-2)

    def check(self, owner: str) -> None:
        """Raise RigError for an Abbe number of 0 or less, or so small that the index of some
        visible light is 0 or less.
        """
        ends = (WAVELENGTH**-2 - end**-2 for end in VISIBLE)
        lines = F_LINE**-2 - C_LINE**-2
        excess = 1 - 1 / self.nd if self.nd > 0 else 0.0  # Glass reports an index of 0 or less
        least = max(0.0, *(excess * end / lines for end in ends))
        if not (np.isfinite(self.abbe) and self.abbe > least):
            raise out_of_range(owner, Message("Abbe Number"), self.abbe, least)


@dataclass(frozen=True)
class SellmeierIndex(Index):
    """Sellmeier's formula: n^2 = 1 + sum(strength * l^2 / (l^2 - resonance)), l in um.

    terms : (strength, resonance in um^2)
    span : m, least and greatest wavelength of the fit
    """

    terms: tuple[tuple[float, float], ...]
    span: Span

    def at(self, wavelength: float) -> float:
        """Index of refraction at a wavelength, m; raises RigError outside the span."""
        _check_span(wavelength, self.span)
        square = (1e6 * wavelength) ** 2
        return float(np.sqrt(1 + sum(b * square / (square - c) for b, c in self.terms)))


@dataclass(frozen=True)
class PowerIndex(Index):
    """A sum of powers of the wavelength: n = sum(factor * l^exponent), l in um.

    terms : (factor, exponent)
    span : m, least and greatest wavelength of the fit
    """

    terms: tuple[tuple[float, int], ...]
    span: Span

    def at(self, wavelength: float) -> float:
        """Index of refraction at a wavelength, m; raises RigError outside the span."""
        _check_span(wavelength, self.span)
        return float(sum(factor * (1e6 * wavelength) ** power for factor, power in self.terms))


@dataclass(frozen=True)
class ShiftedIndex(Index):
    """The dispersion of a formula at another index: a melt, or a material of the artist's.

    nd : index at WAVELENGTH
    """

    formula: Index
    nd: float

    def at(self, wavelength: float) -> float:
        """Index of refraction at a wavelength, m; raises RigError outside the formula's span."""
        return self.nd + (self.formula.at(wavelength) - self.formula.at(WAVELENGTH))
