"""Light through shapes that have a closed form, written without Kiriko's tracer: the judge of the tests.

The formulas are derived in docs/closed_forms.md.
"""

import numpy as np


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def snell(d, normal, n1, n2):
    """Refraction by angles: tangential part scaled by n1 / n2, the rest along the normal."""
    side = np.sign((d * normal).sum(-1, keepdims=True))
    normal = normal * side
    tangential = (d - (d * normal).sum(-1, keepdims=True) * normal) * n1 / n2
    rest = 1 - (tangential**2).sum(-1, keepdims=True)
    return tangential + np.sqrt(np.where(rest < 0, np.nan, rest)) * normal


def through_ball(o, d, radius, n):
    """Exact: with b the ray's distance from the centre, sin a = b / R, the ray turns by 2 (a - a') towards the axis."""
    nearest = o - (o * d).sum(-1, keepdims=True) * d
    b = np.linalg.norm(nearest, axis=-1)
    a = np.arcsin(np.where(b < radius, b / radius, np.nan))
    inside = np.arcsin(np.sin(a) / n)
    outward = nearest / np.where(b > 0, b, 1)[:, None]

    def turned(angle):  # the ray's direction and its perpendicular, turned towards the axis
        return np.cos(angle)[:, None] * d - np.sin(angle)[:, None] * outward

    entry = nearest - (radius * np.cos(a))[:, None] * d
    leaves = entry + (2 * radius * np.cos(inside))[:, None] * turned(a - inside)
    return leaves, turned(2 * (a - inside))


def through_ellipsoid(o, d, radii, n):
    """Exact: the quadric's roots and gradient."""
    radii = np.asarray(radii, float)

    def crossing(p, d, far):
        p, q = p / radii, d / radii
        a, b, c = (q * q).sum(-1), (p * q).sum(-1), (p * p).sum(-1) - 1
        disc = b * b - a * c
        root = np.sqrt(np.where(disc < 0, np.nan, disc))
        return (-b + root) / a if far else (-b - root) / a

    p1 = o + crossing(o, d, False)[:, None] * d
    d1 = snell(d, unit(p1 / radii**2), 1, n)
    p2 = p1 + crossing(p1, d1, True)[:, None] * d1
    return p2, snell(d1, unit(p2 / radii**2), n, 1)


def through_slab(o, d, normal, near, thickness, n):
    """Exact: the ray keeps its direction and is shifted; `near` is a point of the first face."""
    t = ((near - o) * normal).sum(-1) / (d * normal).sum(-1)
    p1 = o + t[:, None] * d
    d1 = snell(d, normal, 1, n)
    return p1 + (thickness / np.abs((d1 * normal).sum(-1)))[:, None] * d1, d


def sides(mesh):
    """A corner of a rectangle and the sides that leave it."""
    corner, *others = mesh.vertices[np.argsort(np.linalg.norm(mesh.vertices - mesh.vertices[0], axis=1))]
    return corner, others[0] - corner, others[1] - corner


def landing(rig, o, d):
    """Display pixels (n, 2) of rays that leave the glass: ideal plate, then the display's plane; NaN if never there."""
    corner, *plate = sides(rig.plates[0].mesh)
    normal = unit(np.cross(*plate))
    t = ((corner - o) @ normal) / (d @ normal)
    p = o + t[:, None] * d
    on_plate = np.all([abs((p - corner) @ side / (side @ side) - 0.5) <= 0.5 for side in plate], axis=0)
    p = np.where(((t > 0) & on_plate)[:, None], p, np.nan)
    d = -d + 2 * (d @ normal)[:, None] * normal
    display = rig.displays[0]
    uv, corners = display.mesh.uv.reshape(-1, 2), display.mesh.vertices[display.mesh.triangles].reshape(-1, 3)
    origin, right, up = (corners[np.argmin(np.abs(uv - at).sum(axis=1))] for at in ((0, 0), (1, 0), (0, 1)))
    right, up = right - origin, up - origin
    facing = np.cross(right, up)
    t = ((origin - p) @ facing) / (d @ facing)
    q = np.where((t > 0)[:, None], p + t[:, None] * d, np.nan) - origin
    u, v = q @ right / (right @ right), q @ up / (up @ up)
    return np.stack([u * display.width, (1 - v) * display.height], axis=1)


def seen_image(rig, source, through, sub=4, **shape):
    """A source image (H, W, 3) as the viewer sees it: sub x sub points a pixel, each on a display pixel as a square."""
    viewer, display = rig.viewers[0], rig.displays[0]
    x, y = np.meshgrid(np.arange(viewer.width), np.arange(viewer.height))
    image = np.zeros((viewer.width * viewer.height, 3))
    for dx in (np.arange(sub) + 0.5) / sub:
        for dy in (np.arange(sub) + 0.5) / sub:
            o, d = viewer.rays(np.stack([(x + dx).ravel(), (y + dy).ravel()], axis=1))
            xy = landing(rig, *through(o, d, **shape))
            inside = ((xy >= 0) & (xy < [display.width, display.height])).all(axis=1)
            column, row = np.where(inside[:, None], xy, 0).astype(int).T
            image += source[row, column] * inside[:, None]
    return image.reshape(viewer.height, viewer.width, 3) / sub**2
