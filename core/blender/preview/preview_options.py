"""How a preview is rendered."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Options:
    """How a preview is rendered.

    Parameters
    ----------
    size : width and height of the whole frame in pixels; None: the viewer's
    percentage : of that size
    border : left, right, bottom, top of the part to render, 0..1 of the frame; None: all of it
    samples : per pixel
    fresnel : glass splits light as real glass does (noise); else it
        refracts all of it, or mirrors all where that is total reflection
    surroundings : objects without a role and the world are there too
    filter_width : None: each pixel is the mean over its
        square; else pixels, of a Blackman-Harris filter
    """

    size: tuple[int, int] | None = None
    percentage: int = 100
    border: tuple[float, float, float, float] | None = None
    samples: int = 16
    fresnel: bool = True
    surroundings: bool = False
    filter_width: float | None = None
