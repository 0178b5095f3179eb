"""Displays that are no single rectangle: a curved screen, a box of panels, a plane with part of the image."""

from dataclasses import replace

import closed_forms
import numpy as np
from reference_rigs import QUAD, QUAD_UV, box, rectangle, rig
from work import solve

from kiriko.core.display import display_plane, uv_islands
from kiriko.core.plan import Settings, make_plan
from kiriko.core.rig import Mesh
from kiriko.core.surfaces import make_surface
from kiriko.core.trace import trace_all


def with_display(a_rig, mesh):
    return replace(a_rig, displays=(replace(a_rig.display, mesh=mesh),))


def traced(a_rig, n=65):
    x, y = np.meshgrid(np.linspace(0, 512, n), np.linspace(0, 512, n))
    o, d = a_rig.viewer.rays(np.stack([x.ravel(), y.ravel()], axis=1))
    return o, d, trace_all(make_plan(a_rig, Settings()), o, d)


def cylinder(columns, radius=0.04, half_angle=0.7, height=0.06):
    """A screen curved about the x axis of its own, hollow towards +z, standing in the display's place."""
    angle = np.linspace(-half_angle, half_angle, columns + 1)
    middle = np.array([0, 0.15, -0.15 + radius])
    across = np.stack([radius * np.sin(angle), np.zeros_like(angle), -radius * np.cos(angle)], axis=1)
    low, high = middle + across - [0, height / 2, 0], middle + across + [0, height / 2, 0]
    k = np.arange(columns)
    quads = np.stack([k, k + 1, k + 1 + columns + 1, k + columns + 1], axis=1)
    u = (angle / half_angle + 1) / 2
    uv = np.concatenate([np.stack([u, 0 * u], axis=1), np.stack([u, 0 * u + 1], axis=1)])
    triangles = quads[:, QUAD].reshape(-1, 3)
    return Mesh(np.concatenate([low, high]), triangles, uv=uv[triangles])


def test_landings_on_a_curved_screen_are_those_on_the_cylinder():
    """A cylinder of 2000 strips: display pixels equal the analytic cylinder's to the strips' sag."""
    radius, half_angle, height = 0.04, 0.7, 0.06
    base = rig(box([0.3, 0.02, 0.3]))
    o, d, landings = traced(with_display(base, cylinder(2000, radius, half_angle, height)))
    p, i = closed_forms.through_slab(o, d, np.array([0, 1.0, 0]), np.array([0, -0.01, 0]), 0.02, 1.49)
    n = np.array([0, 1, -1]) / 2**0.5
    p = p + ((np.array([0, 0.15, 0]) - p) @ n / (i @ n))[:, None] * i
    i = -i + 2 * (i @ n)[:, None] * n
    at, to = (p - [0, 0.15, -0.15 + radius])[:, [0, 2]], i[:, [0, 2]]
    a, b, c = (to * to).sum(1), (at * to).sum(1), (at * at).sum(1) - radius**2
    t = (-b + np.sqrt(b * b - a * c)) / a  # the far side: the screen is hollow towards the light
    q = p + t[:, None] * i - [0, 0.15, -0.15 + radius]
    u = (np.arctan2(q[:, 0], -q[:, 2]) / half_angle + 1) / 2
    v = q[:, 1] / height + 0.5
    assert landings.has_arrived.mean() > 0.9
    found = landings.has_arrived
    expected = np.stack([u * 512, (1 - v) * 512], axis=1)[found]
    assert np.abs(landings.xy[found] - expected).max() < 1e-3


def test_a_box_of_panels_is_two_islands_and_no_cell_joins_them():
    """Two panels side by side in space, apart in UV: each shows its own half, and nothing is painted in between."""
    left = rectangle([-0.0125, 0.15, -0.15], [1, 0, 0], [0, 1, 0], 0.025, 0.05)
    right = rectangle([0.0125, 0.15, -0.15], [1, 0, 0], [0, 1, 0], 0.025, 0.05)
    uv = np.concatenate([QUAD_UV * [0.4, 1], QUAD_UV * [0.4, 1] + [0.6, 0]])
    mesh = Mesh(np.concatenate([left.vertices, right.vertices]), np.concatenate([QUAD, QUAD + 4]), uv=uv)
    assert len(np.unique(uv_islands(mesh))) == 2
    a_rig = with_display(
        rig(box([0.3, 0.02, 0.3]), pixels=128, image=np.ones((4, 4, 4), np.float32), picture=0.06), mesh
    )
    solution = solve(a_rig)
    lit = solution.display_coverage > 0.5
    columns = np.flatnonzero(lit.any(axis=0))
    assert not lit[:, 206:306].any()  # UV 0.4 to 0.6 belongs to no panel
    assert lit[:, 5:200].mean() > 0.95
    assert lit[:, 312:507].mean() > 0.95
    assert columns.min() <= 1
    assert columns.max() >= 510


def test_only_a_whole_flat_rectangle_counts_as_one():
    """Its plane gives the pixels of its corners; half an image, a bent or a split one has no plane."""
    whole = rig(box([0.01] * 3)).display
    plane = display_plane(whole, make_surface(whole.mesh))
    corners = whole.mesh.corners.reshape(-1, 3)
    expected = np.stack([whole.mesh.uv[..., 0] * 512, (1 - whole.mesh.uv[..., 1]) * 512], axis=2).reshape(-1, 2)
    np.testing.assert_allclose((corners - plane.corner) @ plane.pixels.T + plane.origin, expected, atol=1e-9)
    half = replace(whole.mesh, uv=whole.mesh.uv * 0.5)
    bent = replace(
        whole.mesh, vertices=whole.mesh.vertices + np.array([[0, 0, 0.001], [0, 0, 0], [0, 0, 0], [0, 0, 0]])
    )
    for mesh in (half, bent, cylinder(8)):
        display = replace(whole, mesh=mesh)
        assert display_plane(display, make_surface(mesh)) is None
