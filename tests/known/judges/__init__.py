"""Judges of core, by mpmath at fifty digits, on random cases, hard ones among them.

No judge follows core's way: refraction goes by angles, stacks of slabs by the sine that all layers
share, balls and prisms by the roots of their own equations, mirrors from mirror to mirror.
"""

from __future__ import annotations

from .balls import judge_balls
from .mirrors import judge_arrays
from .prisms import judge_prisms
from .refraction import judge_refraction
from .stacks import judge_landings, judge_stacks

JUDGES = (judge_refraction, judge_balls, judge_stacks, judge_landings, judge_prisms, judge_arrays)
