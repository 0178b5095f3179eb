"""The reference rigs of docs/optics.md as plain data, and the shapes that tests put in their place."""

import numpy as np

from kiriko.core.placement import lattice
from kiriko.core.rig import ConstantIndex, Display, Glass, Mesh, Picture, Plate, Rig, Viewer

QUAD = np.array([[0, 1, 2], [0, 2, 3]])
QUAD_UV = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])[QUAD]


def rectangle(centre, right, up, width, height):
    """A rectangle with UV; its front is right x up."""
    right, up = np.asarray(right, float), np.asarray(up, float)
    corners = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
    return Mesh(np.array([centre + a * width * right + b * height * up for a, b in corners]), QUAD, uv=QUAD_UV)


def box(size, centre=(0, 0, 0), degrees_about_z=0.0):
    """A flat-shaded box."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    a = np.radians(degrees_about_z)
    turn = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    return Mesh(signs * np.asarray(size) / 2 @ turn.T + centre, triangles)


def icosphere(radii, levels, smooth=True, centre=(0, 0, 0)):
    """Ellipsoid of 20 * 4^levels triangles with the surface's own normals at the corners."""
    g = (1 + 5**0.5) / 2
    v = np.array([[-1, g, 0], [1, g, 0], [-1, -g, 0], [1, -g, 0], [0, -1, g], [0, 1, g], [0, -1, -g], [0, 1, -g],
                  [g, 0, -1], [g, 0, 1], [-g, 0, -1], [-g, 0, 1]])  # fmt: skip
    f = np.array([[0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4], [11, 10, 2],
                  [10, 7, 6], [7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9], [4, 9, 5],
                  [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1]])  # fmt: skip
    v = v / np.linalg.norm(v, axis=1, keepdims=True)
    for _ in range(levels):
        pairs = np.sort(np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]]), axis=1)
        unique, inverse = np.unique(pairs, axis=0, return_inverse=True)
        middle = v[unique].sum(axis=1)
        m = (inverse.ravel() + len(v)).reshape(3, -1)
        v = np.concatenate([v, middle / np.linalg.norm(middle, axis=1, keepdims=True)])
        a, b, c = f.T
        f = np.concatenate([np.stack(t, axis=1) for t in
                            ((a, m[0], m[2]), (b, m[1], m[0]), (c, m[2], m[1]), (m[0], m[1], m[2]))])  # fmt: skip
    radii = np.broadcast_to(np.asarray(radii, float), 3)
    normals = v / radii
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    n = len(f)
    return Mesh(v * radii + centre, f, normals[f] if smooth else None, np.full(n, smooth) if smooth else None)


def lattice_image(size=512):
    """The default picture, as Add Rig has it, with its alpha."""
    return np.concatenate([lattice(size), np.ones((size, size, 1), np.float32)], axis=2)


def rig(glass, *, distance=0.15, pixels=512, field=0.05, picture=0.03, display=0.05, display_pixels=512, image=None,
        projection="perspective", ior=1.49, viewer_distance=1.0, plate=0.488):  # fmt: skip
    """The bench of docs/optics.md around the origin: viewer on -y, plate at 45 degrees on +y, display below it."""
    x, y, z = np.eye(3)
    half = field / 2 / (viewer_distance if projection == "perspective" else 1)
    viewer = Viewer(
        "viewer", projection, -viewer_distance * y, np.stack([x, z, y]), (-half, half, -half, half), pixels, pixels
    )
    glasses = glass if isinstance(glass, tuple) else (Glass("glass", glass, ConstantIndex(ior)),)
    return Rig(
        (viewer,),
        glasses,
        (Plate("plate", rectangle(distance * y, x, (y + z) / 2**0.5, plate, plate)),),
        (Display("display", rectangle(distance * (y - z), x, y, display, display), display_pixels, display_pixels),),
        (Picture("picture", lattice_image() if image is None else image, rectangle(0 * x, x, z, picture, picture)),),
    )


def ball_rig(levels=5, **options):
    return rig(icosphere(0.025, levels), **options)


def cube_rig(**options):
    return rig(box([0.05] * 3, degrees_about_z=15.8), **options)
