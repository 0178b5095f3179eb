"""How much memory a solve takes, told before it is taken.

The amounts are those that `dev.py bench` measures beside this estimate: within a
factor of 2 from 100 MB on, with the compiled kernel and without it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..base.free_memory import check_free, is_free
from ..base.messages import Message
from ..map.points import BYTES_OF_POINT
from ..map.rasterise import SHARES_AT_ONCE
from ..map.shares import MOST_KEPT
from ..map.view_map import ViewMap
from ..native.loading import library
from ..rig.rig import Display, Rig
from ..rig.settings import Settings
from ..rig.viewer import Viewer


@dataclass(frozen=True)
class Bytes:
    """Bytes of a solve, fitted to the peaks of `dev.py bench`.

    always : of every solve
    rays_by_numpy, shares_by_numpy : of batches of rays, and of a share of a batch, more without
        the kernel
    display, viewer, picture : of a pixel
    share, triangle, ray : of one that is kept
    asked : of a display pixel, for each of several viewers: what it sees of it, which place of the
        picture it asks for, and how far from there the one is that is shown
    """

    always: float = 30e6
    rays_by_numpy: float = 15e6
    shares_by_numpy: int = 230
    display: int = 55
    viewer: int = 40
    picture: int = 20
    share: int = 62
    triangle: int = 2000
    ray: int = 120
    asked: int = 112


@dataclass(frozen=True)
class Numbers:
    """Numbers of things that a solve makes, fitted to the same solves; see `estimated`.

    display_shares, viewer_shares : shares for a pixel of the display, and for one of the viewer's
        up to so many a display pixel (most_viewer_shares)
    quads : times the display's side in tolerances, up to most_quads a viewer pixel
    cells : times the 2/5th power of that
    rays : for a cell, up to most_rays a viewer pixel
    """

    display_shares: float = 1.2
    viewer_shares: float = 1.5
    most_viewer_shares: int = 14
    quads: int = 7
    most_quads: int = 512
    cells: int = 5
    rays: int = 40
    most_rays: float = 1.5


BYTES = Bytes()
NUMBERS = Numbers()


def estimated(rig: Rig, settings: Settings, view_map: ViewMap | None = None) -> dict[str, float]:
    """Bytes that a solve is about to take beside the process as it is, by their use.

    Where borders run, how many shares come of the pixels that are cut there, and how much of the
    display light reaches, is known only from a view map: without one borders count for nothing,
    and light reaches all of the display. Other viewers count as much as that of the map.

    Curved glass has a map with derivatives of all orders, in display sides. Quads of side h are off
    by h^2 of it, so that the tolerance asks for 1 / h^2 of them, in proportion to the display's
    side in tolerances. Cells are off by h^5, which asks for its 2/5th power. That holds within a
    triangle of the mesh; the map has kinks of a higher order between them: where cells would be
    smaller, any viewer pixel that needs several quads may be cut.
    """
    display = _n_pixels(rig.display)
    sizes = [_n_pixels(viewer) for viewer in rig.viewers]
    viewer = sum(sizes)
    meshes = [part.mesh for part in rig.curved_parts()]
    n_curved = sum(mesh.n_curved for mesh in meshes)
    sides = max(rig.display.width, rig.display.height) / settings.tolerance * (n_curved > 0)

    # quads, cells and rays that the tolerance asks for
    n_quads = sum(min(NUMBERS.quads * sides, NUMBERS.most_quads * size) for size in sizes)
    n_cells = NUMBERS.cells * sides**0.4
    n_rays = sum(
        min(NUMBERS.rays * n_cells, NUMBERS.most_rays * size)
        if n_cells < n_curved
        else NUMBERS.most_rays * min(NUMBERS.quads * sides, size)
        for size in sizes
    )

    # shares are kept up to a number, first those that pixels ask for
    n_cut, n_points = 0.0, 0
    if view_map is None:
        n_shares = sum(
            NUMBERS.display_shares * display
            + min(NUMBERS.viewer_shares * size, NUMBERS.most_viewer_shares * display)
            for size in sizes
        )
    else:
        n_quads = 0.0  # they are among the shares
        n_shares = len(sizes) * float(view_map.shares_by_kind[0])
        n_cut = len(sizes) * float(view_map.shares_by_kind[1:].sum())
        n_points = len(sizes) * len(view_map.points)
    n_kept = min(n_shares, MOST_KEPT)
    n_more = min(n_quads, max(MOST_KEPT - n_shares, 0.0))

    n_triangles = sum(len(mesh.triangles) for mesh in meshes)
    cut_shares = BYTES.share * min(n_cut, MOST_KEPT - n_kept)
    by_numpy = BYTES.rays_by_numpy + BYTES.shares_by_numpy * min(n_shares + n_cut, SHARES_AT_ONCE)
    return {
        "display": BYTES.display * display
        + BYTES.asked * display * (len(sizes) if len(sizes) > 1 else 0),
        "light": BYTES.share * n_kept,
        "viewer": BYTES.viewer * viewer,
        "picture": BYTES.picture * float(rig.pictures[0].n_pixels),
        "tolerance": BYTES.share * n_more + BYTES.ray * n_rays,
        "glass": BYTES.triangle * n_triangles,
        "borders": cut_shares + BYTES_OF_POINT * n_points,
        "always": BYTES.always + by_numpy * (library() is None),
    }


def _n_pixels(part: Viewer | Display) -> float:
    """Of the image of a viewer or a display."""
    return float(part.width) * part.height


def check_memory(
    rig: Rig, settings: Settings, are_known: Sequence[bool] = (), is_told_again: bool = False
) -> None:
    """Raise RigError when a solve would take more memory than is free.

    are_known : which of the viewers' maps are there already; none where it is empty
    is_told_again : by `check_traced`: a solve is not refused for light that may not be there
    """
    known = dict(enumerate(are_known))
    new = tuple(viewer for k, viewer in enumerate(rig.viewers) if not known.get(k, False))
    n_known = len(rig.viewers) - len(new)
    rig = replace(rig, viewers=new or rig.viewers[:1])
    parts = estimated(rig, settings)
    if new and n_known:
        # a viewer that was alone has not been asked; one alone is not counted above
        n_asked = (n_known == 1) + (len(new) == 1)
        parts["display"] += BYTES.asked * _n_pixels(rig.display) * n_asked
    light = parts.pop("light")
    if is_told_again and is_free(sum(parts.values())):
        return
    parts["display"] += light

    # what helps most is less of what takes most
    remedy = _remedies(rig, settings)[max(parts, key=parts.get)]
    check_free(sum(parts.values()), Message("Solving"), remedy)


def check_traced(rig: Rig, viewer: Viewer, settings: Settings, view_map: ViewMap) -> None:
    """Raise RigError when all that is made of a viewer's map, and of those of the rig's other
    viewers, which count as much, would take more memory than is free.
    """
    parts = estimated(rig, settings, view_map)
    to_come = {
        "display": parts["display"] + parts["light"],
        "picture": parts["picture"],
        "borders": parts["borders"],
    }
    remedies = _remedies(rig, settings) | {"borders": _less_to_cut(viewer, settings, view_map)}
    remedy = remedies[max(to_come, key=to_come.get)]
    check_free(sum(to_come.values()) + parts["always"], Message("Solving"), remedy)


def _remedies(rig: Rig, settings: Settings) -> dict[str, Message]:
    """What helps where a part takes most memory, by its name."""
    display = rig.display
    viewer = max(rig.viewers, key=_n_pixels)
    picture = rig.picture_place
    return {
        "display": Message(
            "lower the resolution of the display '{display}' ({width} x {height})",
            display=display.name,
            width=display.width,
            height=display.height,
        ),
        "viewer": Message(
            "lower the resolution of the viewer '{viewer}' ({viewer_width} x {viewer_height})",
            viewer=viewer.name,
            viewer_width=viewer.width,
            viewer_height=viewer.height,
        ),
        "picture": Message(
            "choose a smaller image for the picture '{picture}' ({width} x {height})",
            picture=picture.name,
            width=picture.width,
            height=picture.height,
        ),
        "tolerance": Message(
            "raise the tolerance ({tolerance:g} display pixels)", tolerance=settings.tolerance
        ),
        "glass": Message("give the glass fewer triangles"),
        "always": Message("close other programs"),
    }


def _less_to_cut(viewer: Viewer, settings: Settings, view_map: ViewMap) -> Message:
    """What to do about pixels that borders cut, or that are sampled."""
    resolution = Message(
        "the resolution of the viewer '{viewer}' ({viewer_width} x {viewer_height})",
        viewer=viewer.name,
        viewer_width=viewer.width,
        viewer_height=viewer.height,
    )

    is_sampled = len(view_map.samples) > len(view_map.points) / 2
    if not is_sampled:
        return Message("lower {resolution}", resolution=resolution)
    return Message(
        "lower Effort ({effort}), or {resolution}", effort=settings.effort, resolution=resolution
    )
