"""The reference rigs of docs/theory.md as plain data, and the shapes that tests put in
their place.
"""

from dataclasses import replace

import numpy as np

from kiriko.core.bench.placement import lattice
from kiriko.core.rig.rig import ConstantIndex, Display, Glass, Mesh, Picture, Plate, Rig, Viewer

UPRIGHT = np.eye(3)
QUAD = np.array([[0, 1, 2], [0, 2, 3]])
QUAD_UV = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])[QUAD]


def rectangle(centre, right, up, width, height):
    """A rectangle with UV; its front is right x up."""
    right = np.asarray(right, float)
    up = np.asarray(up, float)
    corners = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
    return Mesh(
        np.array([centre + a * width * right + b * height * up for a, b in corners]),
        QUAD,
        uv=QUAD_UV,
    )


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

    # three golden rectangles, each at right angles to the others
    v = np.array([
        [-1, g, 0], [1, g, 0], [-1, -g, 0], [1, -g, 0],
        [0, -1, g], [0, 1, g], [0, -1, -g], [0, 1, -g],
        [g, 0, -1], [g, 0, 1], [-g, 0, -1], [-g, 0, 1],
    ])  # fmt: skip
    f = np.array([
        [0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11],
        [1, 5, 9], [5, 11, 4], [11, 10, 2], [10, 7, 6], [7, 1, 8],
        [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9],
        [4, 9, 5], [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1],
    ])  # fmt: skip

    # each triangle into four, new vertices moved out to the unit sphere
    v = v / np.linalg.norm(v, axis=1, keepdims=True)
    for _ in range(levels):
        pairs = np.sort(np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]]), axis=1)
        unique, inverse = np.unique(pairs, axis=0, return_inverse=True)
        middle = v[unique].sum(axis=1)
        m = (inverse.ravel() + len(v)).reshape(3, -1)
        v = np.concatenate([v, middle / np.linalg.norm(middle, axis=1, keepdims=True)])
        a, b, c = f.T
        quarters = (a, m[0], m[2]), (b, m[1], m[0]), (c, m[2], m[1]), (m[0], m[1], m[2])
        f = np.concatenate([np.stack(quarter, axis=1) for quarter in quarters])

    radii = np.broadcast_to(np.asarray(radii, float), 3)
    normals = v / radii
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    n = len(f)
    return Mesh(
        v * radii + centre,
        f,
        normals[f] if smooth else None,
        np.full(n, smooth) if smooth else None,
    )


def split_quads(index):
    """Triangles of the quads of a grid of vertices (m, n).

    The front is down the rows x along the columns.
    """
    a, b, c, d = (
        corner.ravel()
        for corner in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])
    )
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def smooth_mesh(vertices, triangles, normals):
    """A mesh that is smooth all over, with normals given for the vertices."""
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return Mesh(vertices, triangles, normals[triangles], np.ones(len(triangles), bool))


def uv_ellipsoid(radii, segments=32, rings=16, pole=2):
    """Ellipsoid of 2 segments (rings - 1) triangles as Blender's UV
    sphere is made, its poles on one of the axes.
    """
    theta = np.pi * np.arange(1, rings) / rings
    phi = 2 * np.pi * np.arange(segments) / segments
    theta, phi = (x.ravel() for x in np.meshgrid(theta, phi, indexing="ij"))
    v = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1)
    v = np.roll(np.concatenate([v, [[0, 0, 1.0], [0, 0, -1.0]]]), pole - 2, axis=1)
    index = np.arange((rings - 1) * segments).reshape(rings - 1, segments)
    index = np.concatenate([index, index[:, :1]], axis=1)
    north, south = np.full((2, segments), [[len(v) - 2], [len(v) - 1]])
    top = np.stack([north, index[0, :-1], index[0, 1:]], axis=1)
    bottom = np.stack([index[-1, :-1], south, index[-1, 1:]], axis=1)
    radii = np.broadcast_to(np.asarray(radii, float), 3)
    return smooth_mesh(v * radii, np.concatenate([top, split_quads(index), bottom]), v / radii)


def torus(major, minor, segments=32, rings=16):
    """Torus of 2 segments rings triangles around the y axis.

    Segments along the ring, rings around the tube.
    """
    v, u = (2 * np.pi * np.arange(n) / n for n in (rings, segments))
    v, u = (x.ravel() for x in np.meshgrid(v, u, indexing="ij"))
    normals = np.stack([np.cos(v) * np.cos(u), np.sin(v), np.cos(v) * np.sin(u)], axis=1)
    middle = major * np.stack([np.cos(u), np.zeros_like(u), np.sin(u)], axis=1)
    index = np.pad(
        np.arange(rings * segments).reshape(rings, segments), ((0, 1), (0, 1)), mode="wrap"
    )
    return smooth_mesh(middle + minor * normals, split_quads(index), normals)


def barrel(radius, height, bulge, segments=128, rings=64):
    """A round vessel about z, wider by `bulge` in the middle, smooth around and with flat ends.

    No inner wall.
    """
    z = np.linspace(-height / 2, height / 2, rings + 1)
    a = 2 * np.pi * np.arange(segments) / segments
    r = radius + bulge * np.cos(np.pi * z / height) ** 2
    slope = -bulge * np.pi / height * np.sin(2 * np.pi * z / height)
    r, z, slope, a = (
        x.ravel() for x in np.broadcast_arrays(r[:, None], z[:, None], slope[:, None], a[None])
    )
    v = np.stack([r * np.cos(a), r * np.sin(a), z], axis=1)
    index = np.pad(np.arange(len(v)).reshape(rings + 1, segments), ((0, 0), (0, 1)), mode="wrap")
    side = smooth_mesh(
        v, split_quads(index)[:, ::-1], np.stack([np.cos(a), np.sin(a), -slope], axis=1)
    )
    low, high = (np.full(segments, len(v) + k) for k in (0, 1))
    bottom = np.stack([low, index[0, 1:], index[0, :-1]], axis=1)
    top = np.stack([high, index[-1, :-1], index[-1, 1:]], axis=1)
    ends = np.concatenate([bottom, top])
    own = np.repeat([[0, 0, -1.0], [0, 0, 1.0]], segments, axis=0)

    return Mesh(
        np.concatenate([v, [[0, 0, -height / 2], [0, 0, height / 2]]]),
        np.concatenate([side.triangles, ends]),
        np.concatenate([side.corner_normals, np.repeat(own[:, None], 3, axis=1)]),
        np.r_[side.is_smooth, np.zeros(len(ends), bool)],
    )


def lathed(radius, height, segments=32):
    """A closed body about z, smooth all over with mean normals, of rings.

    It begins and ends on the axis.
    """
    a = 2 * np.pi * np.arange(segments) / segments
    points = np.stack(
        np.broadcast_arrays(
            radius[:, None] * np.cos(a), radius[:, None] * np.sin(a), height[:, None]
        ),
        -1,
    )
    index = np.arange(points[..., 0].size).reshape(points.shape[:2])
    index[[0, -1]] = index[[0, -1], :1]
    triangles = split_quads(np.concatenate([index, index[:, :1]], axis=1))[:, ::-1]
    triangles = triangles[(triangles != np.roll(triangles, 1, axis=1)).all(axis=1)]
    flat = np.zeros((len(triangles), 3, 3))

    return mean_normals(Mesh(points.reshape(-1, 3), triangles, flat, np.ones(len(triangles), bool)))


def bottle(wall=0.004):
    """A hollow vessel of 0.1 m, thicker in the middle than at its ends."""
    outer = barrel(0.022, 0.1, 0.003)
    inner = barrel(0.022 - wall, 0.1 - 2 * wall, 0.002)
    return Mesh(
        np.concatenate([outer.vertices, inner.vertices]),
        np.concatenate([outer.triangles, inner.triangles[:, ::-1] + len(outer.vertices)]),
        np.concatenate([outer.corner_normals, -inner.corner_normals[:, ::-1]]),
        np.concatenate([outer.is_smooth, inner.is_smooth]),
    )


def rod(start, end, radius, sides=8):
    """A thin flat-shaded prism from one point to another."""
    start = np.asarray(start, float)
    end = np.asarray(end, float)
    along = (end - start) / np.linalg.norm(end - start)
    across = np.cross(along, np.roll(along, 1) + np.array([0.3, 0.5, 0.8]))
    across /= np.linalg.norm(across)
    a = 2 * np.pi * np.arange(sides) / sides
    ring = radius * (np.cos(a)[:, None] * across + np.sin(a)[:, None] * np.cross(along, across))
    index = np.pad(np.arange(2 * sides).reshape(2, sides), ((0, 0), (0, 1)), mode="wrap")
    low, high = (np.full(sides, 2 * sides + k) for k in (0, 1))
    triangles = [
        split_quads(index)[:, ::-1],
        np.stack([low, index[0, 1:], index[0, :-1]], axis=1),
        np.stack([high, index[1, :-1], index[1, 1:]], axis=1),
    ]

    return Mesh(np.concatenate([start + ring, end + ring, [start, end]]), np.concatenate(triangles))


def wavy_slab(n=16, size=0.075, thickness=0.02, amplitude=0.001):
    """Slab across y of 4 n^2 + 8 n triangles: wavy, smooth front
    and back (docs/theory.md), flat sides.
    """
    across = np.linspace(-size / 2, size / 2, n + 1)
    z, x = (a.ravel() for a in np.meshgrid(across, across, indexing="ij"))
    k = 6 * np.pi / size
    m = 5 * np.pi / size
    one = np.ones_like(x)
    w = amplitude * np.sin(k * x) * np.sin(k * z) - thickness / 2
    w_normals = np.stack(
        [
            amplitude * k * np.cos(k * x) * np.sin(k * z),
            -one,
            amplitude * k * np.sin(k * x) * np.cos(k * z),
        ],
        axis=1,
    )
    v = amplitude * np.cos(m * x) * np.cos(m * z) + thickness / 2
    v_normals = np.stack(
        [
            amplitude * m * np.sin(m * x) * np.cos(m * z),
            one,
            amplitude * m * np.cos(m * x) * np.sin(m * z),
        ],
        axis=1,
    )
    back = (len(x) + np.arange(len(x))).reshape(n + 1, n + 1)
    front = back - len(x)
    faces = np.concatenate([split_quads(front[:, ::-1]), split_quads(back)])
    around = np.s_[:, -1], np.s_[::-1, 0], np.s_[-1, ::-1], np.s_[0, :]
    sides = np.concatenate([split_quads(np.stack([front[edge], back[edge]])) for edge in around])
    mesh = smooth_mesh(
        np.stack([np.r_[x, x], np.r_[w, v], np.r_[z, z]], axis=1),
        faces,
        np.concatenate([w_normals, v_normals]),
    )
    corners = mesh.vertices[sides]
    own = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    own /= np.linalg.norm(own, axis=1, keepdims=True)

    return Mesh(
        mesh.vertices,
        np.concatenate([faces, sides]),
        np.concatenate([mesh.corner_normals, np.repeat(own[:, None], 3, axis=1)]),
        np.r_[mesh.is_smooth, np.zeros(len(sides), bool)],
    )


def mean_normals(mesh):
    """The same mesh with normals as Blender makes them: means
    over the smooth faces around a vertex, by angle.

    Over triangles: where quads are plane, as on the ellipsoid and
    the torus, this is Blender's mean over the quads.
    """
    smooth = mesh.triangles[mesh.is_smooth]
    corners = mesh.vertices[smooth]
    ahead = np.roll(corners, -1, axis=1) - corners
    behind = np.roll(corners, 1, axis=1) - corners
    around = np.cross(ahead, behind)
    angle = np.arctan2(np.linalg.norm(around, axis=2), (ahead * behind).sum(axis=2))
    weighted = angle[..., None] * around / np.linalg.norm(around, axis=2, keepdims=True)
    count = len(mesh.vertices)
    mean = np.stack(
        [np.bincount(smooth.ravel(), weighted[..., k].ravel(), count) for k in range(3)], axis=1
    )
    normals = mesh.corner_normals.copy()
    normals[mesh.is_smooth] = (
        mean / np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-300)
    )[smooth]

    return replace(mesh, corner_normals=normals, has_mean_normals=True)


def lattice_image(size=512):
    """The default picture, as Add Rig has it, with its alpha."""
    return np.concatenate([lattice(size), np.ones((size, size, 1), np.float32)], axis=2)


def zone_plate(size=1024, rings=100):
    """A picture with fine detail (size, size, 4): rings in each colour that get finer outward."""
    y, x = (np.mgrid[:size, :size] + 0.5) / size - 0.5
    phase = np.pi * rings * (x * x + y * y)
    colours = [0.5 + 0.5 * np.cos(phase + shift) for shift in (0, 2, 4)]
    return np.stack([*colours, np.ones_like(x)], axis=2).astype(np.float32)


def finer(rig, times):
    """The rig seen in more viewer pixels, so many times as many each way."""
    viewer = rig.viewer
    width, height = round(times * viewer.width), round(times * viewer.height)
    return replace(rig, viewers=(replace(viewer, width=width, height=height),))


def rig(
    glass,
    *,
    distance=0.15,
    pixels=512,
    field=0.05,
    picture=0.03,
    display=0.05,
    display_pixels=512,
    image=None,
    projection="perspective",
    ior=1.49,
    viewer_distance=1.0,
    plate=0.488,
):
    """The bench of docs/theory.md around the origin: viewer on
    -y, plate at 45 degrees on +y, display below it.
    """
    x, y, z = np.eye(3)
    half = field / 2 / (viewer_distance if projection == "perspective" else 1)
    viewer = Viewer(
        "viewer",
        projection,
        -viewer_distance * y,
        np.stack([x, z, y]),
        (-half, half, -half, half),
        pixels,
        pixels,
    )
    glasses = glass if isinstance(glass, tuple) else (Glass("glass", glass, ConstantIndex(ior)),)

    return Rig(
        (viewer,),
        glasses,
        (Plate("plate", rectangle(distance * y, x, (y + z) / 2**0.5, plate, plate)),),
        (
            Display(
                "display",
                rectangle(distance * (y - z), x, y, display, display),
                display_pixels,
                display_pixels,
            ),
        ),
        (
            Picture(
                "picture",
                lattice_image() if image is None else image,
                rectangle(0 * x, x, z, picture, picture),
            ),
        ),
    )


def glass_rig(mesh, **options):
    """The bench on which glass is measured as artists bring it, 50 mm in size."""
    return rig(mesh, **{"field": 0.06, "picture": 0.035, "display": 0.1} | options)


def facetted_rig(pixels=64):
    """A flat-shaded ball that sends light all over the display and leaves parts of it faint, and a
    picture of many colours.
    """
    colours = np.random.default_rng(0).random((24, 24, 4))
    colours[..., 3] = 1
    image = colours.repeat(8, axis=0).repeat(8, axis=1).astype(np.float32)
    mesh = icosphere(0.025, 3, smooth=False)
    return glass_rig(mesh, pixels=pixels, display_pixels=pixels, image=image)


def ball_rig(levels=5, **options):
    return rig(icosphere(0.025, levels), **options)


def cube_rig(**options):
    return rig(box([0.05] * 3, degrees_about_z=15.8), **options)


def taken(a_rig, turn=UPRIGHT, scale=1.0, shift=0.0, dtype=float):
    """The whole rig turned by a matrix (3, 3), scaled and moved, its places in a type of number."""

    def mesh(m):
        vertices = (scale * m.vertices @ turn.T + shift).astype(dtype).astype(float)
        normals = None if m.corner_normals is None else m.corner_normals @ turn.T
        return replace(m, vertices=vertices, corner_normals=normals)

    v = a_rig.viewer
    parts = {
        name: tuple(replace(part, mesh=mesh(part.mesh)) for part in getattr(a_rig, name))
        for name in ("glasses", "plates", "displays", "pictures", "mirrors")
    }
    viewer = replace(v, position=scale * turn @ v.position + shift, axes=v.axes @ turn.T)
    return replace(a_rig, viewers=(viewer,), **parts)


def rotation(random):
    """Any rotation (3, 3)."""
    q = np.linalg.qr(random.normal(size=(3, 3)))[0]
    return q * np.sign(np.linalg.det(q))
