"""The kinds of parts of a rig, by their effect on light."""

from enum import IntEnum

from .rig import MET_ROLES

# the effect of a surface on a ray, as the table of roles numbers it
Kind = IntEnum("Kind", [(role.name, role.kind) for role in MET_ROLES])
