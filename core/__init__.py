"""Kiriko without Blender: from a rig to the source image of its display.

Public are the ten names below; every other module may change between versions. Lengths are in
metres, images are arrays of linear light with row 0 at the top. Outside of Blender this package is
`kiriko_optics`. Only core/blender imports bpy.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .files.image_io import write
    from .rig.mesh import Mesh
    from .rig.parts import Display, Glass, Picture, Plate
    from .rig.rig import Rig
    from .rig.viewer import Viewer
    from .solve.solution import Solution

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

# modules of the public names, imported on first use: Blender registers faster
MODULES = {
    "Display": ".rig.parts",
    "Glass": ".rig.parts",
    "Mesh": ".rig.mesh",
    "Picture": ".rig.parts",
    "Plate": ".rig.parts",
    "Rig": ".rig.rig",
    "Solution": ".solve.solution",
    "Viewer": ".rig.viewer",
    "write": ".files.image_io",
}


def __getattr__(name: str) -> Any:
    """Import a public name."""
    if name not in MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(MODULES[name], __name__), name)


def solve(rig: "Rig", **settings: Any) -> "Solution":
    """Compute the source image of a rig's display.

    Parameters
    ----------
    rig : everything on the bench, m
    **settings : fields of `rig.settings.Settings`, such as `tolerance` (display px, 0.1)

    Raises
    ------
    RigError, MeshError
        One sentence on the rig's fault, with a remedy.
    """
    from .base.steps import run_steps
    from .rig.settings import Settings
    from .solve.session import Session

    return run_steps(Session().solve(rig, Settings(**settings)))
