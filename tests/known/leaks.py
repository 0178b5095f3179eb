"""Rays aimed at all vertices and edges of closed meshes, from outside and from inside: none may
escape.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kiriko.core.base.steps import run_steps
from kiriko.core.light import kernel_tracer
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.plan import Plan
from kiriko.core.light.rays import Rays, Reason
from kiriko.core.light.trace import TRACED_AT_ONCE
from kiriko.core.native import loading
from kiriko.core.rig.rig import ConstantIndex, Mesh
from kiriko.core.rig.settings import Settings
from known.closed_forms import unit
from known.reference_rigs import icosphere, mean_normals, rig, smooth_mesh, split_quads, torus

Floats = NDArray[np.float64]

# cosine to all facets around from which on a ray to a place has to meet the surface, flat or curved
TRANSVERSE = 0.1
STRAIGHT = 1.0
BENT = 1.49


def lumpy(levels: int) -> Mesh:
    """A ball with bumps and dents, with normals as Blender makes them."""
    ball = icosphere(1.0, levels)
    x, y, z = 3 * ball.vertices.T
    radius = 0.022 * (1 + 0.12 * np.sin(2 * x + 0.3) * np.cos(y) + 0.1 * np.sin(1.7 * z + x))
    vertices = radius[:, None] * ball.vertices
    return mean_normals(smooth_mesh(vertices, ball.triangles, vertices))


def fine_box(n: int) -> Mesh:
    """A flat box of 12 n^2 triangles."""
    size = np.array([0.05, 0.04, 0.03])
    u, v = (a.ravel() for a in np.meshgrid(*2 * [np.linspace(-0.5, 0.5, n + 1)], indexing="ij"))
    faces = [
        np.roll(np.stack([side * (u * 0 + 0.5), side * u, v], axis=1), k, axis=1)
        for k in range(3)
        for side in (1, -1)
    ]
    index = np.arange(len(u)).reshape(n + 1, n + 1)
    triangles = np.concatenate([split_quads(index + k * len(u)) for k in range(6)])
    vertices, at = np.unique(np.round(np.concatenate(faces), 12), axis=0, return_inverse=True)
    return Mesh(vertices * size, at.ravel()[triangles])


def flat(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices, mesh.triangles)


# a mesh by its size, 0 or 1 for about 5 000 and 82 000 triangles, and a place inside
SHAPES: dict[str, tuple[Callable[[int], Mesh], tuple[float, float, float]]] = {
    "ball": (lambda size: icosphere(0.025, 4 + 2 * size), (0.0, 0.0, 0.0)),
    "torus": (lambda size: torus(0.018, 0.007, *((72, 36), (288, 142))[size]), (0.018, 0.0, 0.0)),
    "lumpy": (lambda size: lumpy(4 + 2 * size), (0.002, -0.001, 0.003)),
    "box": (lambda size: fine_box((21, 83)[size]), (0.004, 0.002, -0.003)),
}
KINDS = {"facets": flat, "curved": lambda mesh: mesh}
START = (0.13, -0.31, 0.21)  # outside


class Leaks(NamedTuple):
    """Of rays: how many there were, and had to meet something.

    Were lost inside, changed sides unseen, met nothing.
    """

    n_rays: int
    certain: int
    lost: int
    odd: int
    missed: int

    def __add__(self, other: "Leaks") -> "Leaks":
        return Leaks(*(a + b for a, b in zip(self, other, strict=True)))


class Aims(NamedTuple):
    """All vertices and all middles of edges of a mesh, targets (n,
    3); and pairs of a target and a facet around it.

    around, facet (p,) indices; normals (t, 3) of the facets
    """

    targets: Floats
    around: NDArray[np.int64]
    facet: NDArray[np.int64]
    normals: Floats

    def must_be_met(self, d: Floats) -> NDArray[np.bool_]:
        """Have rays with directions d (n, 3) to meet the mesh?

        So it is where they come to all facets around their target from the same side, and steeply.
        """
        cosine = (d[self.around] * self.normals[self.facet]).sum(axis=1)
        low = np.full(len(d), np.inf)
        high = np.full(len(d), -np.inf)
        np.minimum.at(low, self.around, cosine)
        np.maximum.at(high, self.around, cosine)
        return (low > TRANSVERSE) | (high < -TRANSVERSE)


def aims_at(mesh: Mesh) -> Aims:
    """Where the rays go that may not leak."""
    n = len(mesh.vertices)
    edges = mesh.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    low = edges.min(axis=1)
    high = edges.max(axis=1)
    _, first, edge = np.unique(low * n + high, return_index=True, return_inverse=True)
    a, b, c = np.moveaxis(mesh.corners, 1, 0)
    return Aims(
        np.concatenate([mesh.vertices, mesh.vertices[edges[first]].mean(axis=1)]),
        np.concatenate([mesh.triangles.ravel(), n + edge.ravel()]),
        np.tile(np.repeat(np.arange(len(mesh.triangles)), 3), 2),
        unit(np.cross(b - a, c - a)),
    )


def leaks(plan: Plan, aims: Aims, start: Floats, every: int, is_inside: bool) -> Leaks:
    """Follow rays from a place to targets.

    Straight on, through a solid of index 1, the number of events is known.
    """
    d = unit(aims.targets - start)
    certain = aims.must_be_met(d)[::every]
    d = d[::every]
    is_straight = plan.rig.glasses[0].ior.at(0) == STRAIGHT
    found = Leaks(0, 0, 0, 0, 0)
    if loading.library() is not None:
        # or rays that were lost on the way would begin again in air
        run_steps(kernel_tracer.prepare_steps(plan))
        run_steps(kernel_tracer.plan_steps(plan))

    for first in range(0, len(d), TRACED_AT_ONCE):
        some = slice(first, first + TRACED_AT_ONCE)
        rays = Rays(np.broadcast_to(start, d[some].shape), d[some], None, False)
        if is_inside:
            rays.mask[:] = plan.parts.bit[0]
            rays.has_met_glass[:] = True
        run_steps(plan.tracer.follow(plan, rays))
        lost = (rays.reason == Reason.LOST_INSIDE) & (
            is_straight | (rays.n_events < plan.settings.max_events)
        )
        odd = is_straight & ~lost & (rays.n_events % 2 != is_inside)
        missed = certain[some] & (rays.n_events == 0)
        found += Leaks(
            len(lost), int(certain[some].sum()), int(lost.sum()), int(odd.sum()), int(missed.sum())
        )

    return found


def leak_cases(size: int) -> Iterator[tuple[str, str, Mesh]]:
    """Shapes of a size, as drawn and, where there is something curved, as meant."""
    for shape, (make, _) in SHAPES.items():
        mesh = make(size)
        for kind, of in KINDS.items():
            if kind == "facets" or shape != "box":
                yield shape, kind, of(mesh)


def leaks_of(shape: str, mesh: Mesh, every: int = 1) -> Leaks:
    """All leaks of a mesh, or of a part of its targets."""
    aims = aims_at(mesh)
    inside = np.array(SHAPES[shape][1])
    outside = np.array(START)
    straight = compile_plan(rig(mesh, ior=STRAIGHT, distance=10.0), Settings())
    glass = replace(straight.rig.glasses[0], ior=ConstantIndex(BENT))
    media = replace(straight.media, indices=np.array([[1.0, BENT]]))
    bent = replace(straight, rig=replace(straight.rig, glasses=(glass,)), media=media)
    return (
        leaks(straight, aims, outside, every, False)
        + leaks(straight, aims, inside, every, True)
        + leaks(bent, aims, outside, every, False)
    )
