"""Images for displays behind glass.

A rig goes in, the source image of its display comes out. Lengths are in metres; images are arrays
of linear light with row 0 at the top. Everything else in this package may change between versions.
"""

from typing import Any

from ._core.base.steps import run_steps
from ._core.files.image_io import write
from ._core.rig.mesh import Mesh
from ._core.rig.parts import Display, Glass, Picture, Plate
from ._core.rig.rig import Rig
from ._core.rig.settings import Settings
from ._core.rig.viewer import Viewer
from ._core.solve.session import Session
from ._core.solve.solution import Solution

__all__ = [
    "Display",
    "Glass",
    "Mesh",
    "Picture",
    "Plate",
    "Rig",
    "Solution",
    "Viewer",
    "solve",
    "write",
]


def solve(rig: Rig, **settings: Any) -> Solution:
    """Compute the source image of a rig's display.

    Parameters
    ----------
    rig : everything on the bench, m
    **settings : `tolerance` (display px, 0.1), `effort` (rays for a viewer pixel with chaotic
        light, 16), `brightness` (weigh light by its throughput, False) and the other fields of
        the class Settings

    Raises
    ------
    RigError, MeshError
        One sentence on the rig's fault and its remedy.
    """
    return run_steps(Session().solve(rig, Settings(**settings)))
