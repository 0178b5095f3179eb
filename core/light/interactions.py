"""The interactions of all kinds of parts, found by role name."""

from importlib import import_module

import numpy as np

from ..rig.rig import MET_ROLES
from .meetings import Interaction

INTERACTIONS: dict[int, Interaction] = {
    role.kind: import_module(f".interaction_{role.name.lower()}", __package__).INTERACTION
    for role in MET_ROLES
}
ENDS = np.array([INTERACTIONS[kind].ends for kind in range(len(INTERACTIONS))])
