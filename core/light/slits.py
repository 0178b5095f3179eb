"""A layer of mirrors as slits between them: where light comes out, and how often it was reflected.

Between two neighbouring mirrors a ray goes to and fro. Unfolded, it goes straight on: the mirrors
it would cross are the reflections, and folding the place where it comes out back into its own slit
gives where it does come out. So a layer of any number of mirrors is one fold, exact to rounding
(docs/closed_forms.md).
"""

import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..rig.rig import MirrorArray


def fold(q: Floats, travel: Floats) -> tuple[Floats, Ints]:
    """One layer of mirrors at the whole numbers: where light
    comes out, and how often it was reflected.

    Parameters
    ----------
    q : (n,) where it enters, in pitches, along the mirrors' normal
    travel : (n,) how far it would go along there without mirrors, in pitches, signed

    Returns
    -------
    q' (n,) in the same slit as q, and n_reflections (n,); its slope is turned round as many times
    """
    slit = np.floor(q)
    unfolded = q + travel
    into = np.floor(unfolded)
    n_reflections = np.abs(into - slit).astype(np.int64)
    inside = unfolded - into
    return slit + np.where(is_odd(n_reflections), 1.0 - inside, inside), n_reflections


def is_odd(n: Ints) -> Bools:
    """Of whole numbers (n,). A bit, as their remainder would take as long as the rest of
    the fold.
    """
    return (n & 1).astype(bool)


def odd_share(r: Floats) -> Floats:
    """Share P (n,) of light with an odd number of reflections, over
    all phases, that would cross r (n,) pitches.
    """
    return 1.0 - np.abs(np.abs(r) % 2 - 1.0)


def odd_number(r: Floats) -> Floats:
    """That odd number of reflections: of the two that are
    possible, |r| rounded up and down, one is odd.
    """
    return 2.0 * np.floor(np.abs(r) / 2) + 1.0


def reflected_share(array: MirrorArray, travel: Floats, is_turned: bool) -> Floats:
    """Share (n,) of light that is reflected an odd, or an
    even, number of times by one layer, and comes out.
    """
    share = odd_share(travel)
    number = odd_number(travel)
    if is_turned:
        return share * array.reflectance**number
    return (1.0 - share) * array.reflectance ** (
        number + np.where(np.abs(travel) < number, -1.0, 1.0)
    )
