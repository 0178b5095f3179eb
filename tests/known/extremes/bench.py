"""Extreme cases of the bench: scale and place, meshes, viewers, plates and displays."""

from dataclasses import replace

import numpy as np

from kiriko.core.rig.rig import ConstantIndex, Glass, Mesh, Mirror, Rig
from kiriko.core.solve.solution import Solution

from .. import closed_forms
from ..reference_rigs import box, icosphere, rectangle, rig, rod, split_quads
from .cases import (
    SLAB,
    Extended,
    Floats,
    N,
    Rows,
    X,
    Y,
    Z,
    apart,
    ball_rig,
    case,
    changed,
    exact,
    furthest,
    joined,
    layers,
    limit,
    on,
    ramp,
    rays_of,
    refused,
    slab_rig,
    solve,
    tells,
    traced,
    within,
    without_plate,
    worst,
)

AT_ORIGIN = (
    "Blender rounds coordinates to 6e-8 of their distance from the origin: keep the rig within a"
    " metre or so of it."
)
CLOSED = "Close the glass: where its back is missing, light goes on as if the glass did."
NOTCHED = (
    "Cut notches into the glass itself; a cavity must not touch the outside. What is lost there"
    " is counted."
)
FILLED = "Fill a cavity with the very mesh of its wall, or with a larger one of higher priority."


def differs(here: Solution, there: Solution) -> tuple[float, float]:
    """Greatest distance, display px, between the maps of two solutions at viewer px corners.

    And of colours.
    """
    w, h = here.first.view_map.view_size
    x, y = np.meshgrid(np.arange(w) + 0.3, np.arange(h) + 0.2)
    at = np.stack([x.ravel(), y.ravel()], axis=1)
    one = here.first.view_map.display_from_view(at)
    other = there.first.view_map.display_from_view(at)
    off = np.abs(one - other).max(axis=1)

    with np.errstate(
        invalid="ignore"
    ):  # beside the image places may be off by as many times as they are further off
        known = np.isfinite(off) & ((one >= 0) & (one <= here.first.view_map.display_size)).all(
            axis=1
        )

    is_same = (np.isnan(one[:, 0]) == np.isnan(other[:, 0])).mean() > 0.999 and known.mean() > 0.3
    colours = np.abs(here.source - there.source)
    return (float(np.quantile(off[known], 0.999)) if is_same else np.inf), float(
        np.quantile(colours, 0.999)
    )


def original(quick: bool) -> Rig:
    """The rig that is scaled and moved.

    Nothing in it is symmetric, so that no ray runs along an edge.
    """
    turned = icosphere((0.025, 0.02, 0.022), 3 if quick else 4, centre=(0.0007, 0.0003, -0.0005))
    pixels = 32 if quick else 128
    return rig(turned, pixels=pixels, display_pixels=pixels, field=0.03 if quick else 0.05)


@case("scale", "the whole rig scaled by 1e-6 to 1e6")
def scaled(quick: bool) -> Rows:
    a_rig = original(quick)
    here = solve(a_rig)
    for scale in (1e-6, 1e6) if quick else (1e-6, 1e-3, 10.0, 1e3, 1e6):
        off, colours = differs(here, solve(changed(a_rig, lambda v, scale=scale: v * scale)))
        yield within(f"source image's places, scaled by {scale:g}", off, 1e-9)
        yield within("its colours", colours, 1e-6, "")


@case("scale", "moved by 1 m to 1e7 m")
def moved(quick: bool) -> Rows:
    a_rig = original(quick)
    here = solve(a_rig)
    for far in (1e3, 1e7) if quick else (1.0, 1e3, 1e5, 1e6, 1e7):
        there = solve(changed(a_rig, lambda v, far=far: v + far * np.array([1, -1, 0.5])))
        off, colours = differs(here, there)
        measured = f"source image's places, moved by {far:g} m"
        if far <= 1e3:
            yield within(measured, off, 1e-6)
            yield within("its colours", colours, 1e-6, "")
        # the loss of doubles: half of spacing(far), some
        # thousand times where the map stretches most
        else:
            yield limit(
                measured,
                off,
                3e-9 * far,
                "px",
                AT_ORIGIN,
                tells(there, "Blender rounds coordinates"),
            )


@case("scale", "air of 0.5 mm between two slabs, 10 km from the origin")
def film_far_away(quick: bool) -> Rows:
    slabs = [box([0.3, 0.01, 0.3], (0, y, 0)) for y in (-0.00525, 0.00525)]
    a_rig = slab_rig(
        tuple(Glass(f"g{k}", m, ConstantIndex(N)) for k, m in enumerate(slabs)), pixels=32
    )
    far = changed(a_rig, lambda v: v + 1e4 * X)
    o, d = rays_of(far)
    told = tells(solve(far), "Blender rounds coordinates")
    through = on(o, d, layers((-0.01025, N), (-0.00025, 1.0), (0.00025, N), (0.01025, 1.0)))
    yield limit(
        "landing: nearer than 2.4 mm, faces touch there, and the air is left out",
        furthest(far, traced(far, o, d), through),
        0.05,
        "px",
        AT_ORIGIN,
        told,
    )


@case("scale", "turned")
def turned(quick: bool) -> Rows:
    a_rig = original(quick)
    here = solve(a_rig)
    turn = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    there = changed(a_rig, lambda v: v @ turn.T)
    viewer = there.viewer
    there = replace(
        there,
        viewers=(replace(viewer, axes=viewer.axes @ turn.T),),
        glasses=tuple(
            replace(g, mesh=replace(g.mesh, corner_normals=g.mesh.corner_normals @ turn.T))
            for g in there.glasses
        ),
    )
    off, colours = differs(here, solve(there))
    yield within("source image's places", off, 1e-6)
    yield within("its colours", colours, 1e-6, "")


@case("scale", "float32 places")
def single_precision(quick: bool) -> Rows:
    a_rig = original(quick)
    o, d = rays_of(a_rig)
    here = traced(a_rig, o, d)
    for far, bound in ((0.0, 5e-4), (1.0, 2e-2), (100.0, 1.0)):
        shift = far * np.array([0.3137, -0.7091, 0.4173])
        single = changed(
            a_rig, lambda v, shift=shift: (v + shift).astype(np.float32).astype(float) - shift
        )
        glasses = tuple(
            replace(
                g, mesh=replace(g.mesh, rounding=2.0**-24 * np.abs(g.mesh.vertices + shift).max())
            )
            for g in single.glasses
        )
        single = replace(single, viewers=a_rig.viewers, glasses=glasses)
        found = traced(single, o, d)
        both = here.has_arrived & found.has_arrived
        off = (
            float(np.quantile(np.abs(found.xy - here.xy)[both], 0.99))
            if both.mean() > 0.3
            else np.inf
        )
        told = tells(solve(single), "Blender rounds coordinates")
        measured = f"landing, all vertices rounded to float32, {far:g} m from the origin"
        if far < 100:
            yield within(measured, np.inf if told else off, bound)
        else:
            yield limit(
                measured, off, bound, "px", AT_ORIGIN, told or off < 0.05
            )  # less needs no remark


@case("scale", "parts of 1e4 times another's size")
def ratio(quick: bool) -> Rows:
    tiny = 25e-6
    a_rig = rig(icosphere(tiny, 4 if quick else 5), field=2 * tiny, picture=tiny, display=2 * tiny)
    o, d = rays_of(a_rig)
    here = traced(a_rig, o, d)
    yield within(
        "landing, ball of 25 um before a plate of 0.5 m",
        furthest(a_rig, here, closed_forms.through_ball(o, d, tiny, N)),
        3e-4 if quick else 1e-5,
    )

    for large in (
        0.08,
        1.0,
        100.0,
    ):  # together with its distance four times as much: just under 1e4 times, and more
        aside = Glass("aside", icosphere(large, 3, centre=(2 * large, 0, 0)), ConstantIndex(N))
        found = traced(replace(a_rig, glasses=(*a_rig.glasses, aside)), o, d)
        off = worst((found.xy - here.xy)[here.has_arrived])
        yield exact(f"what a ball of {large:g} m beside it changes in landings", off, 1e-7, "px")

    glasses = (
        Glass("block", box([0.25] * 3, (0, 0, 0)), ConstantIndex(N)),
        Glass("bubble", icosphere(tiny, 4 if quick else 5), ConstantIndex(1.0)),
    )
    a_rig = rig(glasses, field=2e-5, display=0.1, projection="orthographic", distance=0.3)
    o, d = rays_of(a_rig)
    p, inside = on(o, d, layers((-0.125, N)))
    leaves = on(*closed_forms.through_ball(p, inside, tiny, 1 / N), [(0.125 * Y, Y, N, 1.0)])
    yield within(
        "landing, bubble of 25 um in a block of 0.25 m",
        furthest(a_rig, traced(a_rig, o, d), leaves, 0.01),
        1e-3 if quick else 5e-5,
    )


@case("meshes", "12 triangles to 5 million")
def many_triangles(quick: bool) -> Rows:
    a_rig = slab_rig()
    o, d = rays_of(a_rig)
    yield exact(
        "landing, slab of 12",
        furthest(a_rig, traced(a_rig, o, d), on(o, d, layers((-0.01, N), (0.01, 1)))),
        1e-11,
        "px",
    )

    # faces that turn by less than a quarter of a degree are
    # followed as drawn, which costs less than 1e-3 px
    for level, bound in ((5, 1e-5),) if quick else ((5, 1e-5), (9, 1e-3)):
        a_rig = rig(icosphere(0.025, level))
        o, d = rays_of(a_rig)
        off = furthest(a_rig, traced(a_rig, o, d), closed_forms.through_ball(o, d, 0.025, N))
        yield within(f"landing, ball of {20 * 4**level:,}", off, bound)


def strips(cuts: Floats) -> Mesh:
    """The slab in strips along z, cut at places along x."""
    x = np.concatenate([[-0.15], cuts, [0.15]])
    v = np.array(
        [
            [a, y, z]
            for y, z in ((-0.01, -0.15), (-0.01, 0.15), (0.01, 0.15), (0.01, -0.15))
            for a in x
        ]
    )
    index = np.arange(len(v)).reshape(4, -1)
    around = split_quads(np.concatenate([index, index[:1]]))
    low = index[:, 0]
    high = index[:, -1]
    ends = [
        [low[0], low[1], low[2]],
        [low[0], low[2], low[3]],
        [high[0], high[2], high[1]],
        [high[0], high[3], high[2]],
    ]

    return Mesh(v, np.concatenate([around, ends]))


@case("meshes", "slivers of aspect 1e7")
def slivers(quick: bool) -> Rows:
    thin = 0.3e-7
    middle = np.linspace(-0.02, 0.02, 21)
    cuts = np.sort(np.concatenate([middle, middle + thin]))
    a_rig = slab_rig(strips(cuts))
    random = np.random.default_rng(6)
    n = 5000 if quick else 200_000
    target = np.stack(
        [
            random.choice(middle, n) + thin * random.choice([0, 0.5, 1, 0.3, -0.5, 1.5], n),
            np.full(n, -0.01),
            random.uniform(-0.02, 0.02, n),
        ],
        axis=1,
    )
    d = closed_forms.unit(target - a_rig.viewer.position)
    o = np.tile(a_rig.viewer.position, (n, 1))
    found = traced(a_rig, o, d)
    yield exact(
        "rays lost, of those aimed at slivers 30 nm wide and their edges",
        np.count_nonzero(~found.has_arrived),
    )
    yield exact(
        "landing", furthest(a_rig, found, on(o, d, layers((-0.01, N), (0.01, 1)))), 1e-11, "px"
    )


def notched() -> Mesh:
    """A cube with a corner cut out, whose first vertex is the notch's innermost."""
    cells = {(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)} - {(0, 0, 0)}
    corners = []
    for cell in cells:
        for axis in range(3):
            for side in (0, 1):
                beside = list(cell)
                beside[axis] += 2 * side - 1
                if tuple(beside) in cells:
                    continue
                quad = []
                for a, b in ((0, 0), (1, 0), (1, 1), (0, 1)):
                    at = list(cell)
                    at[axis] += side
                    at[(axis + 1) % 3] += a
                    at[(axis + 2) % 3] += b
                    quad.append(at)
                quad = quad if side else quad[::-1]
                corners += [[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]]

    v, index = np.unique(np.reshape(corners, (-1, 3)), axis=0, return_inverse=True)
    t = index.reshape(-1, 3)
    innermost = np.flatnonzero((v == 1).all(axis=1))[0]
    first = np.flatnonzero((t == innermost).any(axis=1))[0]
    t[[0, first]] = t[[first, 0]]
    t[0] = np.roll(t[0], -np.flatnonzero(t[0] == innermost)[0])

    return Mesh((v - 1) * 0.025, t)


@case("meshes", "zero-area and duplicate faces, inverted normals")
def badly_drawn(quick: bool) -> Rows:
    slab = box(SLAB, degrees_about_z=15)
    ball = icosphere(0.025, 3)
    cube = notched()
    t = slab.triangles
    n = len(slab.triangles)
    a, b, c = t[0]
    split = Mesh(
        np.concatenate([slab.vertices, [(slab.vertices[a] + slab.vertices[b]) / 2]]),
        np.concatenate([t[1:], [[a, 8, c], [8, b, c], [a, b, 8]]]),
    )
    some = np.random.default_rng(7).random(n) < 0.5
    twice = replace(
        ball,
        triangles=np.concatenate([ball.triangles, ball.triangles[:, ::-1]]),
        corner_normals=np.concatenate([ball.corner_normals, ball.corner_normals[:, ::-1]]),
        is_smooth=np.ones(2 * len(ball.triangles), bool),
    )

    pairs = {
        "faces of one or two different corners": (
            replace(slab, triangles=np.r_[t, [[0, 0, 1], [2, 2, 2]]]),
            slab,
        ),
        "face of no area that closes a split edge": (split, slab),
        "one face twice": (replace(slab, triangles=np.concatenate([t, t[:1]])), slab),
        "all faces twice": (replace(slab, triangles=np.concatenate([t, t])), slab),
        "all faces of a ball twice, once from behind": (twice, ball),
        "a copy in the same place": (joined(ball, ball), ball),
        "a copy in the same place, of a notched cube": (joined(cube, cube), cube),
        "all faces inverted": (replace(slab, triangles=t[:, ::-1]), slab),
        "half of the faces inverted": (
            replace(slab, triangles=np.where(some[:, None], t[:, ::-1], t)),
            slab,
        ),
    }
    for name, (drawn, meant) in pairs.items():
        a_rig = slab_rig(drawn)
        o, d = rays_of(a_rig)
        yield exact(
            f"landing, {name}",
            apart(traced(a_rig, o, d), traced(slab_rig(meant), o, d)),
            1e-9,
            "px",
        )


def wound_twice() -> Mesh:
    """A prism along x; its outline goes around y = -10 to 20 mm, and once more around 0 to 15 mm
    within, before it crosses itself and ends where it began.
    """
    outer = (-10, -150), (20, -150), (20, 150), (-10, 150), (-10, -145)
    inner = (15, -140), (15, 145), (0, 145), (0, -135)
    outline = 1e-3 * np.array([*outer, *inner])
    n = len(outline)
    ends = [np.column_stack([np.full(n, x), outline]) for x in (-0.15, 0.15)]
    k = np.arange(n)
    after = (k + 1) % n
    sides = [(k, after, after + n), (k, after + n, k + n)]
    fan = np.stack([np.zeros(n - 2, int), k[1:-1], k[2:]], axis=1)
    return Mesh(
        np.concatenate(ends),
        np.concatenate([*(np.stack(side, axis=1) for side in sides), fan[:, ::-1], fan + n]),
    )


@case("meshes", "open, non-manifold, self-intersecting")
def not_solid(quick: bool) -> Rows:
    slab = box(SLAB)
    o, d = rays_of(slab_rig())
    by_law = on(o, d, layers((-0.01, N), (0.01, 1)))
    is_top = slab.vertices[slab.triangles][..., 2].min(axis=1) > 0.1
    a_rig = slab_rig(replace(slab, triangles=slab.triangles[~is_top]), pixels=64, display_pixels=64)
    o64, d64 = rays_of(a_rig)
    is_silent = not solve(a_rig).notes  # no light goes through the gap
    off = furthest(a_rig, traced(a_rig, o64, d64), on(o64, d64, layers((-0.01, N), (0.01, 1))))
    measured = "landing, slab without its top, where rays meet front and back"
    yield exact(measured, off if is_silent else np.inf, 1e-11, "px")
    is_back = slab.vertices[slab.triangles][..., 1].min(axis=1) > 0
    a_rig = slab_rig(replace(slab, triangles=slab.triangles[~is_back]), pixels=32)
    told = tells(solve(a_rig), "leaks through gaps")
    off = worst(
        traced(a_rig, o64, d64).xy - closed_forms.landing(a_rig, *on(o64, d64, layers((-0.01, N))))
    )
    yield limit(
        "landing, slab without its back, beside glass that does not end",
        off,
        1e-11,
        "px",
        CLOSED,
        told,
    )
    parts = box([0.15, 0.02, 0.3], (-0.075, 0, 0)), box([0.15, 0.02, 0.3], (0.075, 0, 0))
    both = joined(*parts)
    v, index = np.unique(both.vertices, axis=0, return_inverse=True)
    walls = Mesh(v, index.ravel()[both.triangles])
    edge = joined(parts[0], box([0.15, 0.02, 0.3], (0.075, 0.02, 0)))
    v, index = np.unique(edge.vertices, axis=0, return_inverse=True)
    at_edge = Mesh(v, index.ravel()[edge.triangles])
    a_rig = slab_rig(walls)
    yield exact(
        "landing, two halves with merged vertices and a wall between",
        furthest(a_rig, traced(a_rig, o, d), by_law),
        1e-11,
        "px",
    )
    a_rig = slab_rig(at_edge)
    p, leaves = (
        np.where((o[:, :1] + d[:, :1] < 0), one, other)
        for one, other in zip(by_law, on(o, d, layers((0.01, N), (0.03, 1))), strict=True)
    )
    yield exact(
        "landing, two blocks that share an edge",
        furthest(a_rig, traced(a_rig, o, d), (p, leaves)),
        1e-11,
        "px",
    )
    crossing = joined(slab, box(SLAB, (0, 0.01, 0)))
    a_rig = slab_rig(crossing)
    yield exact(
        "landing, two slabs in one mesh that overlap by half",
        furthest(a_rig, traced(a_rig, o, d), on(o, d, layers((-0.01, N), (0.02, 1)))),
        1e-11,
        "px",
    )
    a_rig = slab_rig(wound_twice())
    yield exact(
        "landing, slab of one shell that winds around its inside twice",
        furthest(a_rig, traced(a_rig, o, d), on(o, d, layers((-0.01, N), (0.02, 1)))),
        1e-11,
        "px",
    )
    ball = icosphere(0.025, 3, smooth=False)
    end = 0.02 * np.array([1.0, -1.0, 1.0])

    for name, (start, stop) in (("within", (0 * end, end)), ("without", (end, 0 * end))):
        stick = rod(start, stop, 0.003)
        a_rig = slab_rig(joined(ball, stick))
        two = slab_rig(
            (Glass("ball", ball, ConstantIndex(N)), Glass("rod", stick, ConstantIndex(N)))
        )
        off = apart(traced(a_rig, o, d), traced(two, o, d))
        yield exact(
            f"landing, ball and a rod through its wall, drawn from {name}, as of two objects",
            off,
            1e-9,
            "px",
        )

    touching = joined(slab, box([0.1, 0.01, 0.1], (0, -0.005, 0)))
    found = solve(slab_rig(touching, pixels=64, field=0.3, picture=0.2, display=0.3))
    lost = found.misses["cut off by Max Events"]
    measured = "notch drawn as a cavity that shares a face with the outside: lost of the picture"
    yield limit(measured, lost, 0.5, "of it", NOTCHED, tells(found, "never leaves the glass"))


@case("meshes", "hollow, nested five deep, touching, overlapping")
def nested(quick: bool) -> Rows:
    indices = 1.3, 1.9, 1.1, 1.7, 1.49
    thick = 0.1, 0.08, 0.06, 0.04, 0.02
    boxes = [box([0.3 - 0.01 * k, t, 0.3 - 0.01 * k]) for k, t in enumerate(thick)]
    inward = [(-t / 2, n) for t, n in zip(thick, indices, strict=True)]
    outward = [(thick[k] / 2, indices[k - 1] if k else 1.0) for k in range(4, -1, -1)]
    slabs = [(box([0.3, 0.01, 0.3], (0, 0.01 * k - 0.02, 0)), n) for k, n in enumerate(indices)]
    a = box(SLAB, (0, -0.005, 0))
    b = box(SLAB, (0, 0.005, 0))

    def glasses(meshes: list[Mesh], of: tuple[float, ...], first: int = 0) -> tuple[Glass, ...]:
        return tuple(
            Glass(f"g{k}", m, ConstantIndex(n), first * (k == 0))
            for k, (m, n) in enumerate(zip(meshes, of, strict=True))
        )

    rigs = {
        "five boxes, each in the one before": (glasses(boxes, indices), inward + outward),
        "box with a cavity": (
            joined(box([0.3, 0.03, 0.3]), box([0.28, 0.01, 0.28])),
            [(-0.015, N), (-0.005, 1.0), (0.005, N), (0.015, 1.0)],
        ),
        "five slabs that touch": (
            glasses([m for m, _ in slabs], indices),
            [*((0.01 * k - 0.025, n) for k, n in enumerate(indices)), (0.025, 1.0)],
        ),
        "box with a cavity, of two boxes that overlap": (
            joined(box(SLAB, (0, -0.005, 0)), box(SLAB, (0, 0.005, 0)), box([0.28, 0.004, 0.28])),
            [(-0.015, N), (-0.002, 1.0), (0.002, N), (0.015, 1.0)],
        ),
        "two slabs that overlap, by priority": (
            glasses([a, b], (1.4, 1.7), 1),
            [(-0.015, 1.4), (0.005, 1.7), (0.015, 1.0)],
        ),
    }
    for name, (glass, faces) in rigs.items():
        a_rig = slab_rig(glass, field=0.04)
        o, d = rays_of(a_rig)
        yield exact(
            f"landing, {name}",
            furthest(a_rig, traced(a_rig, o, d), on(o, d, layers(*faces))),
            1e-11,
            "px",
        )


def filled_cavity(*levels: int) -> Rig:
    """A block with a cavity and a ball of the same size in it, of 20 * 4^levels triangles."""
    block = box([0.3, 0.08, 0.3])
    own = np.cross(
        block.corners[:, 1] - block.corners[:, 0], block.corners[:, 2] - block.corners[:, 0]
    )
    shaded = replace(
        block,
        corner_normals=np.repeat(closed_forms.unit(own)[:, None], 3, axis=1),
        is_smooth=np.zeros(len(own), bool),
    )
    cavity, ball = (icosphere(0.025, level) for level in levels)
    glasses = (
        Glass("block", joined(shaded, cavity), ConstantIndex(N)),
        Glass("ball", ball, ConstantIndex(N)),
    )

    return slab_rig(glasses, field=0.045)


@case("meshes", "ball in a cavity of its own size")
def filled_cavities(quick: bool) -> Rows:
    for levels in ((4, 4), (2, 4)):
        a_rig = filled_cavity(*levels)
        o, d = rays_of(a_rig)
        through = on(o, d, layers((-0.04, N), (0.04, 1.0)))
        found = traced(a_rig, o, d)
        if levels[0] == levels[1]:
            yield exact(
                "landing, the same mesh twice: a solid block",
                furthest(a_rig, found, through),
                1e-11,
                "px",
            )
            continue
        off = np.abs(found.xy - closed_forms.landing(a_rig, *through)).max(axis=1)
        measured = "other triangles: rays off by more than 0.1 px, by the air that is left between"
        small = replace(a_rig, viewers=(replace(a_rig.viewer, width=32, height=32),))
        told = tells(solve(small), "crosses gaps or overlaps")
        yield limit(measured, (~(off < 0.1)).mean(), 0.5, "of them", FILLED, told)


@case("meshes", "glass at the plate and at the display")
def at_the_plate(quick: bool) -> Rows:
    normal = (Y - Z) / 2**0.5
    along = (Y + Z) / 2**0.5
    axes = np.stack([X, normal, along], axis=1)
    flat = box([0.2, 0.02, 0.2])

    for name, off in (
        ("lying on the plate, before it", -0.01),
        ("lying on the plate, behind it", 0.01),
        ("cut by the plate", 0.0),
        ("cut near its face", 0.0099999999),
    ):
        centre = 0.15 * Y + off * normal
        a_rig = rig(replace(flat, vertices=flat.vertices @ axes.T + centre), display=0.2)
        o, d = rays_of(a_rig)
        found = traced(a_rig, o, d)
        # through the glass as if there were no plate, then the plate: it is parallel to the glass,
        # so light is shifted along it by the same before and behind, and the order does not matter
        # but for the turn
        near = centre - 0.01 * normal
        far = centre + 0.01 * normal
        p, inside = on(o, d, [(near, normal, 1.0, N)])
        p, inside = (
            on(p, inside, [(0.15 * Y, normal, N, N)])
            if off > -0.01
            else on(p, inside, [(far, normal, N, N)])
        )
        inside = -inside + 2 * (inside * normal).sum(1, keepdims=True) * normal
        p, leaves = on(p, inside, [(far, normal, N, 1.0)])
        t = (-0.15 - p[:, 2]) / leaves[:, 2]
        expected = p + t[:, None] * leaves
        wrong = np.inf if not found.has_arrived.all() else 0.0
        yield exact(
            f"landing, glass {name}", worst(found.positions - expected) + wrong, 1e-15 * 8, "m"
        )

    for name, z in (
        ("before the display", -0.14),
        ("cut by the display", -0.15),
        ("behind the display", -0.16),
    ):
        block = Glass("block", box([0.2, 0.2, 0.02], (0, 0.15, z)), ConstantIndex(N))
        a_rig = slab_rig((Glass("slab", box(SLAB), ConstantIndex(N)), block))
        o, d = rays_of(a_rig)
        p, leaves = on(o, d, layers((-0.01, N), (0.01, 1)))
        p, leaves = on(p, leaves, [(0.15 * Y, normal, 1, 1)])
        leaves = -leaves + 2 * (leaves * normal).sum(1, keepdims=True) * normal
        faces = (
            [((z + 0.01) * Z, Z, 1, N), (-0.15 * Z, Z, N, N)]
            if z > -0.16
            else [(-0.15 * Z, Z, 1, 1)]
        )
        expected, _ = on(p, leaves, faces)
        found = traced(a_rig, o, d)
        wrong = np.inf if not found.has_arrived.all() else 0.0
        yield exact(
            f"landing, glass {name}", worst(found.positions - expected) + wrong, 1e-15 * 8, "m"
        )


@case("meshes", "a mirror on the glass's back")
def silvered(quick: bool) -> Rows:
    random = np.random.default_rng(8)
    for name, degrees in (
        ("as seen", 0.0),
        ("from 60 degrees, beyond which it would be reflected anyway", 60.0),
    ):
        turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
        turn *= np.sign(np.linalg.det(turn))
        base = slab_rig()
        back = Mirror("back", rectangle(0.01 * Y, X, Z, 0.3, 0.3))
        turned_rig = changed(replace(base, mirrors=(back,)), lambda v, turn=turn: v @ turn.T)
        a = np.radians(degrees)
        o, d = rays_of(base)
        if degrees:
            d = closed_forms.unit(d + np.tan(a) * X)
            o = o * np.array([1, 0, 1]) - 0.01 * Y - 0.1 * d
        found = traced(
            without_plate(
                replace(
                    turned_rig,
                    displays=(replace(base.display, mesh=rectangle(-9 * Z, X, Y, 0.1, 0.1)),),
                )
            ),
            o @ turn.T,
            d @ turn.T,
        )
        p, inside = on(o, d, [(-0.01 * Y, Y, 1.0, N), (0.01 * Y, Y, N, N)])
        p, leaves = on(p, inside * np.array([1, -1, 1]), [(-0.01 * Y, Y, N, 1.0)])
        off = worst(found.positions @ turn - p, found.directions @ turn - leaves)
        yield exact(f"exit point (m) and direction, {name}", off, 1e-15 * 4)


def bend(b: Floats, radius: float) -> Floats:
    """Angle by which rays at distances b from a ball's centre bend at its surface; NaN
    beside it.
    """
    b = np.where(b < radius, b, np.nan)
    return np.arcsin(b / radius) - np.arcsin(b / (N * radius))


def hollow_ball(wall: float, quick: bool) -> Mesh:
    """A ball of 25 mm that is but a wall."""
    outer, inner = (icosphere(radius, 3 if quick else 5) for radius in (0.025, 0.025 - wall))
    turned = replace(
        inner, triangles=inner.triangles[:, ::-1], corner_normals=-inner.corner_normals[:, ::-1]
    )
    return joined(outer, turned)


@case("meshes", "hollow ball with a wall of 1 mm to 10 nm")
def thin_walls(quick: bool) -> Rows:
    for wall, bound in (
        (1e-3, 1e-2 if quick else 1e-4),
        (1e-6, 1e-3 if quick else 1e-4),
        (1e-8, 1e-6),
    ):
        a_rig = rig(hollow_ball(wall, quick), field=0.036)
        o, d = rays_of(a_rig)
        nearest = o - (o * d).sum(axis=1, keepdims=True) * d
        b = np.linalg.norm(nearest, axis=1)
        # n r sin a is kept: in and out of the wall twice, the ray
        # turns about the centre and stays as far from it
        outside, inside = (bend(b, r) for r in (0.025, 0.025 - wall))
        turn = 2 * (outside - inside)[:, None]
        up = nearest / b[:, None]
        leaves = np.cos(turn) * d - np.sin(turn) * up
        through = b[:, None] * (np.cos(turn) * up + np.sin(turn) * d), leaves
        yield within(
            f"landing, wall of {wall:g} m", furthest(a_rig, traced(a_rig, o, d), through), bound
        )


@case("meshes", "panel of 1 um")
def thin_panel(quick: bool) -> Rows:
    mesh = box([0.3, 1e-6, 0.3], degrees_about_z=40)
    a = np.radians(40)
    normal = np.array([-np.sin(a), np.cos(a), 0])
    a_rig = slab_rig(mesh)
    o, d = rays_of(a_rig)
    through = on(o, d, [(-0.5e-6 * normal, normal, 1, N), (0.5e-6 * normal, normal, N, 1)])
    yield exact("landing", furthest(a_rig, traced(a_rig, o, d), through), 1e-11, "px")
    o, d = rays_of(slab_rig())

    for thick in (1e-7, 1e-9):
        a_rig = slab_rig(box([0.3, thick, 0.3]))
        through = on(o, d, layers((-thick / 2, N), (thick / 2, 1)))
        yield exact(
            f"landing, panel of {thick:g} m",
            furthest(a_rig, traced(a_rig, o, d), through),
            1e-11,
            "px",
        )

    pair = [box([0.3, 1e-6, 0.3], (0, y, 0)) for y in (-1e-6, 1e-6)]
    pair_rig = slab_rig(tuple(Glass(f"panel {k}", m, ConstantIndex(N)) for k, m in enumerate(pair)))
    through = on(o, d, layers((-1.5e-6, N), (-0.5e-6, 1), (0.5e-6, N), (1.5e-6, 1)))
    yield exact(
        "landing, two of 1 um with 1 um of air between",
        furthest(pair_rig, traced(pair_rig, o, d), through),
        1e-11,
        "px",
    )


@case("meshes", "fibre of 10 000 total reflections")
def fibre(quick: bool) -> Rows:
    n_reflections = 300 if quick else 10_000
    inside = np.radians(40)
    width = 0.1 * np.tan(inside) / n_reflections
    a_rig = without_plate(rig(box([width, 0.1, 0.3]), pixels=16))
    start = np.linspace(-0.4, 0.4, 7) * width
    entry = np.arcsin(N * np.sin(inside))
    d = np.tile([np.sin(entry), np.cos(entry), 0], (7, 1))
    o = np.stack([start, np.full(7, -0.05), np.linspace(-0.1, 0.1, 7)], axis=1) - 0.01 * d
    found = traced(a_rig, o, d, max_events=n_reflections + 10)

    # unfolded: the mirror images of the fibre side by side, of
    # which every other one is the wrong way round
    p, _ = on(o, d, [(-0.05 * Y, Y, 1, N), (0.05 * Y, Y, N, N)])
    across = p[:, 0] / Extended(width) + Extended(0.5)
    number = np.floor(across)
    place = across - number
    expected = (np.where(number % 2 == 0, place, 1 - place) - 0.5) * width
    yield exact(
        "where light comes out, of the fibre's width",
        worst(found.positions[:, 0] - expected) / width,
        n_reflections * float(np.spacing(0.05)) / width,
        "",
    )
    yield exact("reflections missed or too many", worst(found.n_events - 2 - np.abs(number)))
    a = np.radians(20)
    turn = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    mesh = box([1e-4, 0.1, 0.1], (0, 0.05, 0))
    a_rig = rig(
        replace(mesh, vertices=mesh.vertices @ turn.T),
        field=5e-5,
        projection="orthographic",
        pixels=16,
    )
    yield refused(a_rig, "meets more surfaces than Max Events")


@case("rig", "viewer inside the glass, or behind the plate")
def odd_viewers(quick: bool) -> Rows:
    yield refused(slab_rig(box([3, 3, 3]), pixels=16), "is inside the glass")
    yield refused(
        slab_rig(box([0.02] * 3, (0, -1, 0)), pixels=16, projection="orthographic"),
        "cuts the plane",
    )
    needle = box([1e-6, 0.2, 1e-6], (0.0013, -1, 0.0017))
    yield refused(slab_rig(needle, pixels=16, projection="orthographic"), "cuts the plane")
    a_rig = slab_rig(pixels=16)
    behind = replace(a_rig.viewer, position=Y.copy(), axes=np.stack([-X, Z, -Y]))
    yield refused(replace(a_rig, viewers=(behind,)), "display stays dark")


@case("rig", "viewer at infinity")
def orthographic(quick: bool) -> Rows:
    a_rig = ball_rig(quick, projection="orthographic")
    o, d = rays_of(a_rig)
    through = closed_forms.through_ball(o, d, 0.025, N)
    yield within(
        "landing, orthographic",
        furthest(a_rig, traced(a_rig, o, d), through),
        3e-4 if quick else 1e-5,
    )
    near = traced(a_rig, o, d)

    for far in (1e3, 1e6):
        a_rig = ball_rig(quick, viewer_distance=far)
        o, d = rays_of(a_rig)
        through = closed_forms.through_ball(o.astype(Extended), d.astype(Extended), 0.025, N)
        found = traced(a_rig, o, d)
        yield within(
            f"landing, {far:g} m away", furthest(a_rig, found, through), 3e-4 if quick else 1e-5
        )

    both = found.has_arrived & near.has_arrived & (found.branch == near.branch)
    yield within(
        "orthographic beside 1e6 m away", np.quantile(np.abs(found.xy - near.xy)[both], 0.99), 1e-3
    )


@case("rig", "plate or display edge-on, no path")
def edge_on(quick: bool) -> Rows:
    a_rig = slab_rig(pixels=16)
    plate = replace(a_rig.plates[0], mesh=rectangle(0.15 * Y, X, Y, 0.3, 0.3))
    yield refused(replace(a_rig, plates=(plate,)), "no ray reaches the plate")
    flat = slab_rig(pixels=16, projection="orthographic")

    for name, base in (("perspective", a_rig), ("orthographic", flat)):
        display = replace(base.display, mesh=rectangle(0.15 * (Y - Z), X, Z, 0.1, 0.1))
        yield refused(replace(base, displays=(display,)), "display")
        assert name

    o, d = rays_of(flat)
    for power in (2, 4, 8):
        angle = 10.0**-power
        up = np.cos(angle) * Z + np.sin(angle) * Y
        tilted = replace(
            flat, displays=(replace(flat.display, mesh=rectangle(0.15 * (Y - Z), X, up, 0.1, 0.1)),)
        )
        o[:, 2] = np.linspace(-0.4, 0.4, len(o)) * 0.1 * angle
        found = traced(tilted, o, d)
        through = on(o, d, layers((-0.01, N), (0.01, 1)))
        expected = closed_forms.landing(tilted, *through)
        off = (
            worst((found.xy - expected)[found.has_arrived])
            if found.has_arrived.mean() > 0.5
            else np.inf
        )
        yield exact(f"landing, display 1e-{power} rad from edge-on", off, 1e-11 / angle, "px")

    yield refused(
        rig(box([0.02] * 3, (0.5, 0, 0)), pixels=16), "no ray from the viewer hits the glass"
    )
    yield refused(slab_rig(pixels=16, display=1e-9), "no ray reaches the display")


@case("rig", "one pixel, 8192 x 8192 pixels")
def sizes(quick: bool) -> Rows:
    for viewer, display in (
        ((1, 64), (64, 1), (1, 1)) if quick else ((1, 64), (64, 1), (1, 1), (512, 8192))
    ):
        # a display a little larger than the field; index 1: a ramp lies on it as it is
        a_rig = slab_rig(
            pixels=viewer,
            display_pixels=display,
            ior=1.0,
            projection="orthographic",
            image=ramp(),
            field=0.02,
            display=0.02,
            picture=0.04,
        )
        found = solve(a_rig)
        x = 0.25 + 0.5 * (np.arange(display) + 0.5) / display
        off = worst(found.source[..., 0] - x) if display == 1 or viewer > 1 else 0.0
        yield within(
            f"{viewer}^2 viewer, {display}^2 display pixels: colours of a ramp", off, 1e-6, ""
        )
        yield exact("area seen", abs(found.weight.sum() / viewer**2 - 1), 1e-12, "")
