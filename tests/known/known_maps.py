"""Warp maps whose ways are known: the identity, and a quarter turn, which any flip would spoil."""

import numpy as np

from kiriko.core.lab.warp.map_files import ChannelMaps
from kiriko.core.lab.warp.stmap import STMap, WarpMesh


def straight(x, y):
    """(s, t) of places on the display, 0..1 from its left and lower edge."""
    return np.stack([x, y], axis=-1)


def turned(x, y):
    """The same, a quarter turn against the clock on."""
    return np.stack([y, 1 - x], axis=-1)


def middles_of(size):
    """Places x and y (h, w), 0..1 and y from below, of an image's pixels."""
    w, h = size
    return np.meshgrid((np.arange(w) + 0.5) / w, 1 - (np.arange(h) + 0.5) / h)


def asked_for(way, size, picture):
    """The picture's pixels (h, w, 2) that a way asks for, from the upper left."""
    st = way(*middles_of(size))
    return np.stack([st[..., 0] * picture[0], (1 - st[..., 1]) * picture[1]], axis=2)


def stmap_of(way, x, y, picture):
    """A map that covers all, by places x and y (h, w)."""
    shape = x.shape
    return STMap(picture, way(x, y), np.ones(shape), np.ones(shape, int), np.zeros((*shape, 2, 2)))


def maps_by(way, size, picture, times, step):
    """All maps of a way from a display to a picture, of these sizes; step: of the mesh, px."""
    warp, larger = (
        stmap_of(way, *middles_of((size[0] * k, size[1] * k)), picture) for k in (1, times)
    )
    x, y = (np.linspace(0, 1, n + 1) for n in size)
    of_nodes = stmap_of(way, *np.meshgrid(x, 1 - y), picture)
    mesh = WarpMesh(size, step, of_nodes, np.ones(of_nodes.size[::-1], np.uint64))
    return ChannelMaps(warp, warp, larger, times, mesh)
