"""Estimate of a solve's memory before it is allocated.

`dev.py bench` measures the same amounts: from 100 MB on the estimate is within a factor of 2, with
and without the compiled kernel.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..base.free_memory import check_free, is_free
from ..base.messages import Message
from ..map.points import BYTES_OF_POINT
from ..map.rasterise import SHARES_AT_ONCE
from ..map.shares import MOST_CACHED
from ..map.view_map import ViewMap
from ..native.loading import library
from ..rig.rig import Display, Rig
from ..rig.settings import Settings
from ..rig.viewer import Viewer


@dataclass(frozen=True)
class Bytes:
    """Bytes, fitted to the peaks of `dev.py bench`.

    always : for every solve
    rays_by_numpy, shares_by_numpy : for ray batches, and for each share of a batch, without the
        kernel
    display, viewer, picture : for each pixel
    share, triangle, ray : for each one stored
    lookup : for each display pixel and viewer, if there are several viewers
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
    lookup: int = 112


@dataclass(frozen=True)
class Numbers:
    """Sizes of a solve, fitted to the same benches; see `estimated`.

    display_shares, viewer_shares : shares for each display pixel and for each viewer pixel, the
        latter up to most_viewer_shares for each display pixel
    quads : factor of the display's side in tolerances, up to most_quads for each viewer pixel
    cells : factor of the 2/5th power of that side
    rays : for each cell, up to most_rays for each viewer pixel
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
    """Bytes a solve is about to allocate, by their use.

    The length of borders, the shares of the pixels they cut and the lit part of the display are
    known from a view map only. Without one, borders count as nothing and the whole display as lit.
    Each other viewer counts like the map's.

    A curved glass has a map with derivatives of all orders, in display sides. A quad of side h has
    an error of h^2, so the tolerance needs 1 / h^2 quads, in proportion to the display's side in
    tolerances. A cell has an error of h^5, which gives the 2/5th power. Both hold within a triangle
    of the mesh. Between triangles the map has kinks of a higher order: if cells would be smaller
    than triangles, any viewer pixel of several quads may be cut.
    """
    display = _n_pixels(rig.display)
    sizes = [_n_pixels(viewer) for viewer in rig.viewers]
    viewer = sum(sizes)
    meshes = [part.mesh for part in rig.curved_parts()]
    n_curved = sum(mesh.n_curved for mesh in meshes)
    sides = max(rig.display.width, rig.display.height) / settings.tolerance * (n_curved > 0)

    # quads, cells and rays for the tolerance
    n_quads = sum(min(NUMBERS.quads * sides, NUMBERS.most_quads * size) for size in sizes)
    n_cells = NUMBERS.cells * sides**0.4
    n_rays = sum(
        min(NUMBERS.rays * n_cells, NUMBERS.most_rays * size)
        if n_cells < n_curved
        else NUMBERS.most_rays * min(NUMBERS.quads * sides, size)
        for size in sizes
    )

    # Shares are stored up to a limit, those that pixels show first.
    n_cut, n_points = 0.0, 0
    if view_map is None:
        n_shares = sum(
            NUMBERS.display_shares * display
            + min(NUMBERS.viewer_shares * size, NUMBERS.most_viewer_shares * display)
            for size in sizes
        )
    else:
        n_quads = 0.0  # included in the shares
        n_shares = len(sizes) * float(view_map.shares_by_kind[0])
        n_cut = len(sizes) * float(view_map.shares_by_kind[1:].sum())
        n_points = len(sizes) * len(view_map.points)
    n_cached = min(n_shares, MOST_CACHED)
    n_more = min(n_quads, max(MOST_CACHED - n_shares, 0.0))

    n_triangles = sum(len(mesh.triangles) for mesh in meshes)
    cut_shares = BYTES.share * min(n_cut, MOST_CACHED - n_cached)
    by_numpy = BYTES.rays_by_numpy + BYTES.shares_by_numpy * min(n_shares + n_cut, SHARES_AT_ONCE)
    return {
        "display": BYTES.display * display
        + BYTES.lookup * display * (len(sizes) if len(sizes) > 1 else 0),
        "light": BYTES.share * n_cached,
        "viewer": BYTES.viewer * viewer,
        "picture": BYTES.picture * float(rig.pictures[0].n_pixels),
        "tolerance": BYTES.share * n_more + BYTES.ray * n_rays,
        "glass": BYTES.triangle * n_triangles,
        "borders": cut_shares + BYTES_OF_POINT * n_points,
        "always": BYTES.always + by_numpy * (library() is None),
    }


def _n_pixels(part: Viewer | Display) -> float:
    """Pixels of a viewer's or a display's image."""
    width, height = part.image_size
    return float(width) * height


def check_memory(
    rig: Rig, settings: Settings, are_cached: Sequence[bool] = (), is_checked_again: bool = False
) -> None:
    """Raise RigError if a solve needs more memory than is free.

    are_cached : whether each viewer's map exists already; empty for none
    is_checked_again : whether `check_traced` repeats the check later; light that may never arrive
        is then no reason to refuse
    """
    cached = dict(enumerate(are_cached))
    new = tuple(viewer for k, viewer in enumerate(rig.viewers) if not cached.get(k, False))
    n_cached = len(rig.viewers) - len(new)
    rig = replace(rig, viewers=new or rig.viewers[:1])
    parts = estimated(rig, settings)
    if new and n_cached:
        # A lone viewer has no `lookup` bytes; they arise when a second viewer joins.
        n_lookups = (n_cached == 1) + (len(new) == 1)
        parts["display"] += BYTES.lookup * _n_pixels(rig.display) * n_lookups
    light = parts.pop("light")
    if is_checked_again and is_free(sum(parts.values())):
        return
    parts["display"] += light

    # Reduce the largest use first.
    remedy = _remedies(rig, settings)[max(parts, key=parts.get)]
    check_free(sum(parts.values()), Message("Solving"), remedy)


def check_traced(rig: Rig, viewer: Viewer, settings: Settings, view_map: ViewMap) -> None:
    """Raise RigError if painting a viewer's map needs more memory than is free.

    The rig's other viewers count like this one.
    """
    parts = estimated(rig, settings, view_map)
    to_come = {
        "display": parts["display"] + parts["light"],
        "picture": parts["picture"],
        "borders": parts["borders"],
    }
    remedies = _remedies(replace(rig, viewers=(viewer,)), settings)
    remedies["borders"] = _less_to_cut(remedies, settings, view_map)
    remedy = remedies[max(to_come, key=to_come.get)]
    check_free(sum(to_come.values()) + parts["always"], Message("Solving"), remedy)


def _remedies(rig: Rig, settings: Settings) -> dict[str, Message]:
    """Remedy for each use of memory, by its name."""
    display = rig.display
    viewer = max(rig.viewers, key=_n_pixels)
    picture = rig.picture_place
    lower = Message(
        "lower the resolution of the display '{display}' ({width} x {height})",
        display=display.name,
        width=display.width,
        height=display.height,
    )
    if display.views is not None:
        lower = Message("{remedy}, or use fewer than {n} views", remedy=lower, n=display.views.n)
    return {
        "display": lower,
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


def _less_to_cut(remedies: dict[str, Message], settings: Settings, view_map: ViewMap) -> Message:
    """Remedy for pixels that borders cut or that are sampled."""
    is_sampled = len(view_map.samples) > len(view_map.points) / 2
    if not is_sampled:
        return remedies["viewer"]

    return Message(
        "lower Effort ({effort}), or {remedy}", effort=settings.effort, remedy=remedies["viewer"]
    )
