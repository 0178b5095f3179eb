"""A wave plate: delays light polarised across its fast axis."""

from .interaction_plate import flat_surface
from .interaction_polariser import interact, placed_film
from .meetings import Interaction

INTERACTION = Interaction(interact, flat_surface, element=placed_film)
