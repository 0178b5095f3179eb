"""Light through shapes that have a closed form, written
without Kiriko's tracer: the judge of the tests.

The formulas are derived in docs/theory.md.
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
    """Exact: with b the ray's distance from the centre, sin a = b
    / R, the ray turns by 2 (a - a') towards the axis.
    """
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
        a = (q * q).sum(-1)
        b = (p * q).sum(-1)
        c = (p * p).sum(-1) - 1
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
    corner, *others = mesh.vertices[
        np.argsort(np.linalg.norm(mesh.vertices - mesh.vertices[0], axis=1))
    ]
    return corner, others[0] - corner, others[1] - corner


def landing(rig, o, d):
    """Display pixels (n, 2) of rays that leave the glass: ideal
    plate, then the display's plane; NaN if never there.
    """
    corner, *plate = sides(rig.plates[0].mesh)
    normal = unit(np.cross(*plate))
    t = ((corner - o) @ normal) / (d @ normal)
    p = o + t[:, None] * d
    on_plate = np.all(
        [abs((p - corner) @ side / (side @ side) - 0.5) <= 0.5 for side in plate], axis=0
    )
    p = np.where(((t > 0) & on_plate)[:, None], p, np.nan)
    d = -d + 2 * (d @ normal)[:, None] * normal
    display = rig.displays[0]
    uv = display.mesh.uv.reshape(-1, 2)
    corners = display.mesh.vertices[display.mesh.triangles].reshape(-1, 3)
    origin, right, up = (
        corners[np.argmin(np.abs(uv - at).sum(axis=1))] for at in ((0, 0), (1, 0), (0, 1))
    )
    right, up = right - origin, up - origin
    facing = np.cross(right, up)
    t = ((origin - p) @ facing) / (d @ facing)
    q = np.where((t > 0)[:, None], p + t[:, None] * d, np.nan) - origin
    u = q @ right / (right @ right)
    v = q @ up / (up @ up)

    return np.stack([u * display.width, (1 - v) * display.height], axis=1)


def seen_image(rig, source, through, sub=4, **shape):
    """A source image (H, W, 3) as the viewer sees it: sub x sub
    points a pixel, each on a display pixel as a square.
    """
    viewer = rig.viewers[0]
    display = rig.displays[0]
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


# |cos| to the normal, in or out, below which a landing runs away and no mesh can be held to it
GRAZING = 0.1
INTERFACES = 8  # followed at most
STEPS = 100_000  # of a march; only an endless loop has more


def torus(major, minor):
    """Signed distance (n, 1) and its gradient (n, 1, 3) of a torus around the y axis."""

    def parts(p):
        x, y, z = p.T
        rho = np.hypot(x, z)
        from_ring = np.hypot(rho - major, y)
        with np.errstate(invalid="ignore", divide="ignore"):
            across = (rho - major) / from_ring
            gradient = np.stack([across * x / rho, y / from_ring, across * z / rho], axis=1)
        return (from_ring - minor)[:, None], gradient[:, None]

    return parts


def wavy_faces(size, amplitude):
    """Heights along y of the front and back face at (x, z), with
    slopes (d/dx, d/dz): waves that are 0 at the edges.
    """
    k = 6 * np.pi / size
    m = 5 * np.pi / size

    def front(x, z):
        slopes = np.cos(k * x) * np.sin(k * z), np.sin(k * x) * np.cos(k * z)
        return amplitude * np.sin(k * x) * np.sin(k * z), *(amplitude * k * s for s in slopes)

    def back(x, z):
        slopes = np.sin(m * x) * np.cos(m * z), np.cos(m * x) * np.sin(m * z)
        return amplitude * np.cos(m * x) * np.cos(m * z), *(-amplitude * m * s for s in slopes)

    return front, back


def wavy_slab(size, thickness, amplitude):
    """Functions (n, 6), negative inside and never above the
    distance, with gradients: two wavy faces, four sides.
    """
    front, back = wavy_faces(size, amplitude)
    steep = np.hypot(
        1, amplitude * 6 * np.pi / size
    )  # no face is steeper, so that height / steep <= distance

    def parts(p):
        x, y, z = p.T
        zero = np.zeros_like(x)
        one = np.ones_like(x)
        w, wx, wz = front(x, z)
        v, vx, vz = back(x, z)
        values = [
            (w - thickness / 2 - y) / steep,
            (y - thickness / 2 - v) / steep,
            x - size / 2,
            -x - size / 2,
            z - size / 2,
            -z - size / 2,
        ]
        gradients = [
            (wx / steep, -one / steep, wz / steep),
            (-vx / steep, one / steep, -vz / steep),
            (one, zero, zero),
            (-one, zero, zero),
            (zero, zero, one),
            (zero, zero, -one),
        ]

        return np.stack(values, axis=1), np.stack([np.stack(g, axis=1) for g in gradients], axis=1)

    return parts


def greatest(parts, p):
    """Value (n,) and gradient (n, 3) of a solid's outermost part
    at p, and by how much it is ahead of the next one.
    """
    values, gradients = parts(p)
    which = values.argmax(axis=1)
    rows = np.arange(len(p))
    ahead = (
        np.diff(np.sort(values, axis=1)[:, -2:], axis=1)[:, 0]
        if values.shape[1] > 1
        else np.full(len(p), np.inf)
    )
    return values[rows, which], gradients[rows, which], ahead


def crossing(parts, p, d, side, bound, least):
    """Distance (n,) to the first crossing from `side` (1 outside, -1 inside), NaN if none.

    Nearest miss (n,).
    """
    n = len(p)
    root = np.full(n, np.nan)
    miss = np.full(n, np.inf)
    low = np.zeros(n)
    high = np.full(n, np.nan)
    t = np.zeros(n)
    before = np.full(n, -np.inf)
    last = side * greatest(parts, p)[0]
    live = np.arange(n)
    t += np.maximum(last, least)  # no step is longer than the way to the surface, or than `least`

    for _ in range(STEPS):
        at = p[live] + t[live, None] * d[live]
        value = side * greatest(parts, at)[0]
        is_dip = (before[live] > last[live]) & (last[live] < value)
        miss[live[is_dip]] = np.minimum(miss[live[is_dip]], last[live[is_dip]])
        has_crossed = value < 0
        high[live[has_crossed]] = t[live[has_crossed]]
        goes_on = ~has_crossed & ~(
            (np.linalg.norm(at, axis=1) > bound) & ((at * d[live]).sum(axis=1) > 0)
        )
        live = live[goes_on]
        value = value[goes_on]
        if not len(live):
            break
        low[live] = t[live]
        before[live] = last[live]
        last[live] = value
        t[live] += np.maximum(value, least)

    # a chord shorter than `least` has no bracket: a ray that crosses back in the first step is lost
    bracketed = np.flatnonzero(np.isfinite(high) & ((low > 0) | (side > 0)))
    a = low[bracketed]
    b = high[bracketed]
    q = p[bracketed]
    e = d[bracketed]
    t = (a + b) / 2

    for _ in range(80):
        value, gradient, _ = greatest(parts, q + t[:, None] * e)
        a = np.where(side * value > 0, t, a)
        b = np.where(side * value > 0, b, t)
        with np.errstate(invalid="ignore", divide="ignore"):
            newton = t - value / (gradient * e).sum(axis=1)
        step = np.where((newton >= a) & (newton <= b), newton, (a + b) / 2)
        if (step == t).all():
            break
        t = step

    root[bracketed] = t
    return root, miss


def follow(o, d, parts, n, bound, bend, grazing=GRAZING):
    """Points and directions after them (n, 8, 3) of rays from
    outside through a solid, NaN-padded; is_regular (n,).

    The whole row is NaN when the ray misses the solid, is totally reflected, or has not left after
    8 interfaces. A regular ray neither grazes (entering, leaving, passing by) nor meets an edge.
    `bound` is the radius of a ball around the solid, `bend` the least radius of curvature: a chord
    met at cosine c is c^2 bend / 2 deep.
    """
    shallow = grazing**2 / 2 * bend
    points, directions = np.full((2, len(o), INTERFACES, 3), np.nan)
    is_known = np.zeros(len(o), bool)
    is_regular = np.ones(len(o), bool)
    p = np.array(o, float)
    d = np.array(d, float)
    live = np.arange(len(o))

    for k in range(INTERFACES + 1):
        side = -1 if k % 2 else 1
        t, miss = crossing(parts, p, d, side, bound, bend / 200)
        is_regular[live[miss < shallow]] = False
        hit = np.isfinite(t)
        if side > 0:  # nothing more is met: the ray is known if it met anything
            is_known[live[~hit]] = k > 0
        p = p[hit] + t[hit, None] * d[hit]
        d = d[hit]
        live = live[hit]
        if k == INTERFACES or not len(live):
            break
        _, gradient, ahead = greatest(parts, p)
        normal = unit(gradient)
        before = d
        d = snell(d, normal, *((1, n) if side > 0 else (n, 1)))
        passes = np.isfinite(d[:, 0])
        steepest = np.minimum(
            np.abs((before * normal).sum(axis=1)), np.abs((d * normal).sum(axis=1))
        )
        is_regular[live] &= (steepest > grazing) & (ahead > shallow)
        p = p[passes]
        d = d[passes]
        live = live[passes]
        points[live, k], directions[live, k] = p, d

    points[~is_known], directions[~is_known] = np.nan, np.nan
    return points, directions, is_known & is_regular


def last(points, directions, is_regular):
    """Where and in which direction rays that were followed leave the solid."""
    rows = np.arange(len(points))
    k = np.isfinite(points[..., 0]).sum(axis=1) - 1
    return points[rows, k], directions[rows, k], is_regular


def through_torus(o, d, major, minor, n, grazing=GRAZING):
    """Exact to rounding: roots of the signed distance, its
    gradient. Points, directions (n, 3), is_regular (n,).
    """
    return last(*follow(o, d, torus(major, minor), n, major + minor, minor, grazing))


def through_wavy_slab(o, d, size, thickness, amplitude, n, grazing=GRAZING):
    """Exact to rounding: roots of the height over the
    faces. Points, directions (n, 3), is_regular (n,).
    """
    parts = wavy_slab(size, thickness, amplitude)
    bend = min(size / 2, 1 / max(amplitude * (6 * np.pi / size) ** 2, 1e-300))
    bound = np.linalg.norm([size / 2, thickness / 2 + amplitude, size / 2])
    return last(*follow(o, d, parts, n, bound, bend, grazing))


def abbe_number(index):
    """V = (nd - 1) / (nF - nC) of an index; infinite without dispersion."""
    between = index.at(486.1327e-9) - index.at(656.2725e-9)
    return (index.at(587.6e-9) - 1) / between if between else np.inf
