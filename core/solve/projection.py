"""The images of projectors: each shows its share of the image wanted on the screens.

Light of a projector is followed from its pixels, as if it were a viewer that sees the screens: by
the rig's mirrors and through its glass. Both sides of a screen count, so each is traced. Where
several projectors reach a screen, their shares sum to 1: a projector's share falls smoothly to 0
towards the border of its light.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Bools, Floats
from ..base.errors import RigError
from ..base.stages import section
from ..base.steps import Steps, hold_progress, subprogress
from ..base.words import percent
from ..image.seen_image import seeing
from ..light.mesh_cache import MeshCache
from ..light.rig_parts import InsideGlassError
from ..map.shares import ShareBatches, add_at
from ..rig.joined_display import sections_of
from ..rig.rig import Rig
from ..rig.settings import Settings
from ..rig.viewer import Projector, Viewer
from .channel import sample_reached, shares_of
from .memory import check_memory
from .solution import Remark, warning

FINE = 256  # blocks along the longer side of an image, in which distances are measured
LEAST_DARK = 1e-3  # fraction of the image on the screens
LEAST = 0.01  # of the longer side, added to distances: both shares are then smooth where both end


@dataclass(frozen=True, eq=False)
class Projection:
    """A projector's light on the front and on the back of the screens.

    sides : shares between its pixels and those of the joined display
    on_screen : (H, W) weight of its light on each pixel before it is shared with other projectors;
        0 for pixels it does not reach
    """

    projector: Projector
    sides: tuple[ShareBatches, ...]
    on_screen: Floats


def settings_of_projectors(settings: Settings) -> Settings:
    """Settings for a projector's light: all paths count, whatever they pass."""
    return replace(
        settings.of_optics,
        only_through_glass=False,
        only_through_plate=False,
        brightness=False,
        suppress_glare=0.0,
    )


def trace_projector(
    rig: Rig,
    projector: Projector,
    settings: Settings,
    cache: MeshCache,
) -> Generator[float, None, Projection]:
    """Trace the light of one of a rig's projectors; yields progress 0..1.

    Raises
    ------
    RigError, MeshError : it is inside glass; from `sample_reached`
    """
    steps = trace_sides(rig.joined, projector, settings_of_projectors(settings), cache)
    try:
        sides = yield from subprogress(steps, 0.0, 0.9)
    except InsideGlassError as error:
        raise RigError(
            "The projector '{projector}' is inside the glass '{glass}': move it out.",
            projector=projector.name,
            glass=error.message.values["glass"],
        ) from error

    on_screen = yield from hold_progress(0.9, _light_on_screens(rig, projector, sides))
    return Projection(projector, sides, on_screen)


def trace_sides(
    rig: Rig, viewer: Viewer, settings: Settings, cache: MeshCache
) -> Generator[float, None, tuple[ShareBatches, ...]]:
    """Shares between a viewer's pixels and those of the front and of the back of a rig's display;
    yields progress 0..1.

    Raises
    ------
    RigError, MeshError : from `sample_reached`
    """
    display = rig.display
    turned = replace(display.mesh, triangles=display.mesh.triangles[:, ::-1])
    turned = replace(turned, uv=display.mesh.uv[:, ::-1])
    sides = []
    for k, mesh in enumerate((display.mesh, turned)):
        side = replace(rig, viewers=(viewer,), displays=(replace(display, mesh=mesh),))
        check_memory(side, settings)
        steps = sample_reached(side, viewer, settings, cache, lap=lambda part: None)
        _, view_map = yield from subprogress(steps, *section((0.0, 1.0), k, 2))
        sides.append(shares_of(view_map, False, partial(view_map.pieces, at_pixels=True)))
    return tuple(sides)


def _light_on_screens(
    rig: Rig, projector: Projector, sides: Sequence[ShareBatches]
) -> Steps[Floats]:
    """Weight (H, W) of a projector's light: the squared distance to its border in its own image."""
    is_screen = _is_screen(rig).ravel()
    lit = np.zeros((projector.height, projector.width))
    for shares in _all(sides):
        yield 0
        if shares is not None:
            add_at(lit, shares.view_index, shares.area * is_screen[shares.display_index])

    distance, side = _distance_to_border(lit > 0.5)
    area, weight = np.zeros((2, rig.display.height, rig.display.width))
    for shares in _all(sides):
        yield 0
        if shares is not None:
            add_at(area, shares.display_index, shares.area)
            ramp = (_between_blocks(distance, shares.view_xy / side) + LEAST) ** 2
            add_at(weight, shares.display_index, shares.area * ramp)
    return _ratio(weight, area) * _is_screen(rig)


def _all(sides: Sequence[ShareBatches]) -> Generator:
    """All batches, with pauses."""
    for batches in sides:
        yield from batches.pausing()


def _ratio(of: Floats, to: Floats) -> Floats:
    """A quotient; 0 where there is nothing."""
    return of / np.where(to > 0, to, 1.0)


def _is_screen(rig: Rig) -> Bools:
    """Which pixels (H, W) of the joined display belong to screens, which come last."""
    first = sections_of(rig.lit)[len(rig.displays)].top
    rows = np.arange(rig.display.height) >= first
    return np.broadcast_to(rows[:, None], (rig.display.height, rig.display.width))


def _distance_to_border(is_lit: Bools) -> tuple[Floats, int]:
    """Distance of blocks of pixels (h, w) to the nearest dark one, in longer sides of the image,
    and the side of a block, px; a dark block is added at each end.
    """
    height, width = is_lit.shape
    side = -(-max(height, width) // FINE)
    blocks = np.pad(is_lit, [(0, -height % side), (0, -width % side)])
    blocks = blocks.reshape(len(blocks) // side, side, -1, side).all(axis=(1, 3))
    is_lit = np.pad(blocks, 1)

    # along rows, then between rows
    columns = np.arange(is_lit.shape[1])
    before = np.maximum.accumulate(np.where(is_lit, 0, columns), axis=1)
    after = np.minimum.accumulate(np.where(is_lit, columns[-1], columns)[:, ::-1], axis=1)[:, ::-1]
    along = np.minimum(columns - before, after - columns).astype(float) ** 2
    rows = np.arange(len(is_lit))
    square = np.full(is_lit.shape, np.inf)
    for row in rows:
        np.minimum(square, along[row] + ((rows - row) ** 2)[:, None], out=square)

    return np.sqrt(square) * side / max(height, width), side


def _between_blocks(values: Floats, places: Floats) -> Floats:
    """Values (n,) at places (n, 2), in blocks, interpolated between the middles of blocks."""
    x, y = (places + 0.5).astype(int).T
    u, v = (places.T + 0.5) % 1
    upper = values[y, x] * (1 - u) + values[y, x + 1] * u
    lower = values[y + 1, x] * (1 - u) + values[y + 1, x + 1] * u
    return upper * (1 - v) + lower * v


def blend_weights(projections: Sequence[Projection]) -> list[Floats]:
    """Each projector's share (H, W) of the light of each pixel of the screens; they sum to 1 on all
    pixels that any projector reaches.
    """
    whole = sum(one.on_screen for one in projections)
    return [_ratio(one.on_screen, whole) for one in projections]


def project(
    projections: Sequence[Projection], rig: Rig, source: NDArray[np.float32]
) -> Generator[float, None, tuple[NDArray[np.float32], ...]]:
    """Images (h, w, 3) of the projectors, linear, for the image (H, W, 3) wanted on the joined
    display; yields progress 0..1.

    A pixel that only a part of a screen receives shows the mean of this part.
    """
    is_screen = _is_screen(rig)[..., None].astype(np.float32)
    images = []
    for k, (one, weight) in enumerate(zip(projections, blend_weights(projections), strict=True)):
        shown = np.concatenate([source * weight[..., None] * is_screen, is_screen], axis=2)
        total = np.zeros((one.projector.height, one.projector.width, 4))
        for batches in one.sides:
            steps = seeing(batches, shown.astype(np.float32))
            total += yield from hold_progress(k / len(projections), steps)
        images.append(_ratio(total[..., :3], total[..., 3:]).astype(np.float32))
    return tuple(images)


def remarks_on_projectors(
    projections: Sequence[Projection], rig: Rig, source: NDArray[np.float32]
) -> tuple[Remark, ...]:
    """Remarks on projectors that light no screen, and on parts of the screens without light."""
    remarks = [
        warning(
            "The projector '{projector}' lights no screen: aim it at one.",
            projector=one.projector.name,
        )
        for one in projections
        if not one.on_screen.any()
    ]

    is_wanted = (source.max(axis=2) > 0) & _is_screen(rig)
    is_lit = np.any([one.on_screen > 0 for one in projections], axis=0)
    dark = np.count_nonzero(is_wanted & ~is_lit) / max(np.count_nonzero(is_wanted), 1)
    if dark > LEAST_DARK:
        remarks.append(
            warning(
                "No projector reaches {share} of the image on the screens: move the projectors, or"
                " add one.",
                share=percent(dark),
            )
        )
    return tuple(remarks)
