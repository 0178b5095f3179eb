"""Images for displays behind glass.

A rig goes in, the source image of its display comes out. Lengths are in metres; images are arrays
of linear light with row 0 at the top. Everything else in this package may change between versions.
"""

from typing import Literal

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


def solve(  # noqa: PLR0913 - each but the rig has a default
    rig: Rig,
    *,
    tolerance: float = 0.1,
    max_events: int = 32,
    only_through_glass: bool = True,
    brightness: bool = False,
    effort: int = 16,
    margin: int = 0,
    wavelength: float = 587.6e-9,
    suppress_glare: float = 0.0,
    ghosts: Literal["mean", "strongest"] = "mean",
    only_through_plate: bool = True,
    disagreement: Literal["sharp", "blended"] = "sharp",
    colours: tuple[float, float, float] = (1.0, 1.0, 1.0),
    sharpen: bool = False,
) -> Solution:
    """Compute the source image of a rig's display.

    Parameters
    ----------
    rig : everything on the bench, m
    tolerance : allowed error of landings, display pixels, 1e-6 to 100
    max_events : surfaces a ray may hit before it counts as lost
    only_through_glass : only rays through glass carry the picture; ignored without glass
    brightness : weigh light by its throughput (Fresnel, absorption) instead of by 1
    effort : rays for a viewer pixel with chaotic light, 1 to 4096
    margin : display pixels by which the covered area grows in the source image
    wavelength : m, of the light in glass without dispersion
    suppress_glare : weight, 0 to 1, of light past the glass, which should be dark
    ghosts : for a display pixel seen by several paths, the "mean" of their demands, or the demand
        of the "strongest"
    only_through_plate : only rays that met a plate carry the picture; ignored without plates
    disagreement : for a display pixel where several viewers need different places of the picture,
        the picture at the weighted mean place ("sharp"), or the weighted mean colour ("blended")
    colours : weights of red, green and blue in the traced light, for glass that absorbs them
    sharpen : after painting, change the source image until all viewers see it nearest to their
        ideal images

    Raises
    ------
    RigError
        One sentence: what is wrong with the rig or a setting, and what to do.
    MeshError
        The same for a mesh.
    """
    settings = locals()
    return run_steps(Session().solve(settings.pop("rig"), Settings(**settings)))
