"""All maps of one viewer at one wavelength that files are made of."""

from collections.abc import Generator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.steps import at, within
from ...solve.channel import Channel
from .options import MapOptions
from .stmap import STMap, of_places, view_stmap, warp_map
from .tables import ffmpeg_command
from .view_from_display import paths_shown, view_from_display
from .warp_mesh import WarpMesh, mesh_error, mesh_grid, mesh_of, quads_of


@dataclass(frozen=True, eq=False)
class ChannelMaps:
    """The maps of a channel; None for those that no file is wanted of.

    warp : from the display's pixels; larger : from parts of these, `times` a side
    view : from the viewer's pixels
    """

    warp: STMap
    view: STMap | None
    larger: STMap | None
    times: int
    mesh: WarpMesh | None


def maps_of(channel: Channel, options: MapOptions) -> Generator[float, None, ChannelMaps]:
    """The maps of a channel for the formats that are wanted; yields progress 0..1."""
    forms = set(options.formats)
    width, height = channel.view_map.display_size
    n_view = channel.viewer.width * channel.viewer.height
    grid = mesh_grid((width, height), options.mesh_step)

    # about as many rays as each part has points
    parts = {
        "warp": width * height,
        "view": n_view if "EXR" in forms else 0,
        "larger": width * height * options.times**2 if "FFMPEG" in forms else 0,
        "mesh": len(grid) if forms & {"OBJ", "DATA"} else 0,
    }
    ends = dict(zip(parts, np.cumsum(list(parts.values())) / sum(parts.values()), strict=True))

    strongest = yield from at(0.0, paths_shown(channel.plan, channel.view_map))
    steps = warp_map(channel, 1, options.overscan, strongest)
    warp = yield from within(steps, 0.0, ends["warp"])
    view = larger = mesh = None
    if parts["view"]:
        view = yield from within(view_stmap(channel, warp), ends["warp"], ends["view"])
    if parts["larger"]:
        larger = warp
        if options.times > 1:
            steps = warp_map(channel, options.times, options.overscan, strongest)
            larger = yield from within(steps, ends["view"], ends["larger"])
    if parts["mesh"]:
        steps = view_from_display(channel.plan, channel.view_map, grid, strongest)
        places = yield from within(steps, ends["larger"], ends["mesh"])
        pixels = grid.pixels((width, height))
        coverage = channel.coverage.of_display.ravel()[pixels].reshape(grid.rows, grid.columns)
        place = channel.plan.rig.place_of(channel.viewer)
        stmap = of_places(place, channel.viewer, grid, places, coverage, options.overscan)
        mesh = mesh_of((width, height), options.mesh_step, stmap, places)

    return ChannelMaps(warp, view, larger, options.times, mesh)


def description(
    channel: Channel, maps: ChannelMaps, names: dict[str, tuple[str, ...]]
) -> dict[str, Any]:
    """Of a channel's maps, as plain data for a file beside them."""
    warp = maps.warp
    coverage = channel.coverage.of_display
    found = {
        "viewer": {
            "name": channel.viewer.name,
            "size": [channel.viewer.width, channel.viewer.height],
        },
        "wavelength_nm": 1e9 * channel.wavelength,
        "index": {
            glass.name: glass.ior.at(channel.wavelength) for glass in channel.plan.rig.glasses
        },
        "files": {form: list(of_form) for form, of_form in names.items()},
        "tolerance_px": channel.view_map.tolerance,
        "coverage": float(coverage.mean()),
        "picture_on_display": float(warp.coverage.mean()),
        "folds": {
            "of_display": float((warp.multiplicity > 1).mean()),
            "most": int(warp.multiplicity.max()),
        },
    }
    if "FFMPEG" in names:
        found["ffmpeg"] = {
            "times": maps.times,
            "command": ffmpeg_command(names["FFMPEG"], warp.size, warp.to_size, maps.times),
        }
    if maps.mesh is not None:
        found["mesh"] = {
            "nodes": [n // maps.mesh.finer + 1 for n in maps.mesh.path.shape[::-1]],
            "faces": len(quads_of(maps.mesh)),
            "off_px": mesh_error(maps.mesh),
        }
    return found
