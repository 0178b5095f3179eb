"""Light through the systems of `core/bench/systems.py`, each written down as the sequence of
surfaces that it meets: planes, spheres and cylinders in closed form, without meshes.
"""

import numpy as np

X, Y, Z = np.eye(3)
SLOPE = 2**-0.5
WATER, ACRYLIC = 1.333, 1.49


def unit(v):
    return np.asarray(v, float) / np.linalg.norm(v, axis=-1, keepdims=True)


def to_plane(o, d, point, normal):
    t = ((point - o) @ normal) / (d @ normal)
    return o + t[:, None] * d


def mirror(point, normal):
    """Reflection at a plane."""
    n = unit(normal)

    def step(o, d):
        return to_plane(o, d, np.asarray(point), n), d - 2 * (d @ n)[:, None] * n

    return step


def plate(point, normal):
    """An ideal plate: the part of the direction along it turns round."""
    n = unit(normal)

    def step(o, d):
        return to_plane(o, d, np.asarray(point), n), 2 * (d @ n)[:, None] * n - d

    return step


def back(point, normal):
    """A retroreflector."""

    def step(o, d):
        return to_plane(o, d, np.asarray(point), unit(normal)), -d

    return step


def lens(centre, normal, focal_length):
    """A converging thin lens, by its focal plane: a ray leaves towards the point where the ray
    parallel to it through the centre meets that plane.
    """
    c, n = np.asarray(centre), unit(normal)

    def step(o, d):
        p = to_plane(o, d, c, n)
        focus = c + d * (focal_length / np.abs(d @ n))[:, None]
        return p, unit(focus - p)

    return step


def snell(d, n, eta):
    """Refracted directions; normals (n, 3) against the rays, eta = n1 / n2."""
    c = -(d * n).sum(axis=1, keepdims=True)
    return unit(eta * d + (eta * c - np.sqrt(1 - eta**2 * (1 - c**2))) * n)


def interface(point, normal, n1, n2):
    """Refraction at a plane."""
    n = unit(normal)

    def step(o, d):
        p = to_plane(o, d, np.asarray(point), n)
        return p, snell(d, -np.sign(d @ n)[:, None] * n, n1 / n2)

    return step


def ball(radius, n1, n2, inward):
    """Refraction at a sphere about the origin, at its near or its far side."""

    def step(o, d):
        b = (o * d).sum(axis=1)
        root = np.sqrt(b**2 - (o * o).sum(axis=1) + radius**2)
        t = -b - root if inward else -b + root
        p = o + t[:, None] * d
        n = p / radius
        return p, snell(d, n if inward else -n, n1 / n2)

    return step


def column(radius):
    """Reflection at a cylinder about z, from outside."""

    def step(o, d):
        a, b = (d[:, :2] ** 2).sum(axis=1), (o[:, :2] * d[:, :2]).sum(axis=1)
        c = (o[:, :2] ** 2).sum(axis=1) - radius**2
        p = o + ((-b - np.sqrt(b**2 - a * c)) / a)[:, None] * d
        n = unit(p * [1, 1, 0])
        return p, d - 2 * (d * n).sum(axis=1, keepdims=True) * n

    return step


DIAGONAL = Y + Z  # normal of planes that turn the view down

# the surfaces of each system on the way from the viewer to its flat display
SEQUENCES = {
    "PEPPER": [mirror(0 * X, DIAGONAL)],
    "ANAMORPHOSIS": [column(0.04)],
    "AIRR": [back(0.16 * Y, Y), mirror(0 * X, DIAGONAL)],
    "AIRR_POLARISED": [back(0.16 * Y, Y), mirror(0 * X, DIAGONAL)],
    "KOIZUMI_SANO": [mirror(0 * X, Z), plate(0.3 * Y, Y), mirror(0.09 * Z, Z)],
    "ENCHANTABLE": [mirror(0 * X, Z), plate(0.3 * Y, Y)],
    "SCOOPIRIT_ABOVE": [mirror(0 * X, Z), plate(0.3 * Y, Y)],
    "SCOOPIRIT_UNDER": [
        interface(0 * X, Z, 1, WATER), interface(-0.1 * Z, Z, WATER, 1), plate(-0.12 * Z, Z),
    ],
    "I_BALL": [
        ball(0.05, 1, ACRYLIC, True), ball(0.047, ACRYLIC, 1, True),
        ball(0.047, 1, ACRYLIC, False), ball(0.05, ACRYLIC, 1, False),
        lens(-0.12 * Z, Z, 0.08), mirror(-0.3 * Z, Y - Z),
    ],
    "EYEPIECE": [lens(0 * X, Y, 0.05), plate(0.15 * Y, Y - Z)],
}  # fmt: skip


def landings(name, rig, o, d):
    """Landings (n, 2) of rays, px of the rig's flat display."""
    for step in SEQUENCES[name]:
        o, d = step(o, d)
    mesh = rig.display.mesh
    corners = {
        tuple(uv): at
        for uv, at in zip(mesh.uv.reshape(-1, 2), mesh.corners.reshape(-1, 3), strict=True)
    }
    a, b, c = corners[0, 0], corners[1, 0], corners[0, 1]
    p = to_plane(o, d, a, np.cross(b - a, c - a)) - a
    u, v = ((p @ side) / (side @ side) for side in (b - a, c - a))
    return np.stack([u * rig.display.width, (1 - v) * rig.display.height], axis=1)
