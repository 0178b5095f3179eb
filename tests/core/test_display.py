"""Displays that are no single rectangle: a curved screen, a
box of panels, a plane with part of the image.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from kiriko.core.base.errors import RigError
from kiriko.core.base.fingerprint import fingerprint
from kiriko.core.glass.surfaces import make_surface
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.display import display_plane, uv_islands
from kiriko.core.light.mesh_cache import MeshCache
from kiriko.core.light.trace import trace_all
from kiriko.core.rig.joined_display import sections_of
from kiriko.core.rig.rig import Mesh
from kiriko.core.rig.settings import Settings
from known import closed_forms
from known.reference_rigs import QUAD, QUAD_UV, ball_rig, box, rectangle, rig
from known.work import solve


def with_display(a_rig, mesh):
    return replace(a_rig, displays=(replace(a_rig.display, mesh=mesh),))


def traced(a_rig, n=65):
    x, y = np.meshgrid(np.linspace(0, 512, n), np.linspace(0, 512, n))
    o, d = a_rig.viewer.rays(np.stack([x.ravel(), y.ravel()], axis=1))
    return o, d, trace_all(compile_plan(a_rig, Settings()), o, d)


def cylinder(columns, radius=0.04, half_angle=0.7, height=0.06):
    """A screen curved about the x axis of its own, hollow
    towards +z, standing in the display's place.
    """
    angle = np.linspace(-half_angle, half_angle, columns + 1)
    middle = np.array([0, 0.15, -0.15 + radius])
    across = np.stack(
        [radius * np.sin(angle), np.zeros_like(angle), -radius * np.cos(angle)], axis=1
    )
    low = middle + across - [0, height / 2, 0]
    high = middle + across + [0, height / 2, 0]
    k = np.arange(columns)
    quads = np.stack([k, k + 1, k + 1 + columns + 1, k + columns + 1], axis=1)
    u = (angle / half_angle + 1) / 2
    uv = np.concatenate([np.stack([u, 0 * u], axis=1), np.stack([u, 0 * u + 1], axis=1)])
    triangles = quads[:, QUAD].reshape(-1, 3)

    return Mesh(np.concatenate([low, high]), triangles, uv=uv[triangles])


def test_landings_on_a_curved_screen_are_those_on_the_cylinder():
    """A cylinder of 2000 strips: display pixels equal the analytic cylinder's to the
    strips' sag.
    """
    radius = 0.04
    half_angle = 0.7
    height = 0.06
    base = rig(box([0.3, 0.02, 0.3]))
    o, d, landings = traced(with_display(base, cylinder(2000, radius, half_angle, height)))
    p, i = closed_forms.through_slab(
        o, d, np.array([0, 1.0, 0]), np.array([0, -0.01, 0]), 0.02, 1.49
    )
    n = np.array([0, 1, -1]) / 2**0.5
    p = p + ((np.array([0, 0.15, 0]) - p) @ n / (i @ n))[:, None] * i
    i = -i + 2 * (i @ n)[:, None] * n
    at = (p - [0, 0.15, -0.15 + radius])[:, [0, 2]]
    to = i[:, [0, 2]]
    a = (to * to).sum(1)
    b = (at * to).sum(1)
    c = (at * at).sum(1) - radius**2
    t = (-b + np.sqrt(b * b - a * c)) / a  # the far side: the screen is hollow towards the light
    q = p + t[:, None] * i - [0, 0.15, -0.15 + radius]
    u = (np.arctan2(q[:, 0], -q[:, 2]) / half_angle + 1) / 2
    v = q[:, 1] / height + 0.5

    assert landings.has_arrived.mean() > 0.9
    found = landings.has_arrived
    expected = np.stack([u * 512, (1 - v) * 512], axis=1)[found]
    assert np.abs(landings.xy[found] - expected).max() < 1e-3


def test_a_box_of_panels_is_two_islands_and_no_cell_joins_them():
    """Two panels side by side in space, apart in UV: each shows
    its own half, and nothing is painted in between.
    """
    left = rectangle([-0.0125, 0.15, -0.15], [1, 0, 0], [0, 1, 0], 0.025, 0.05)
    right = rectangle([0.0125, 0.15, -0.15], [1, 0, 0], [0, 1, 0], 0.025, 0.05)
    uv = np.concatenate([QUAD_UV * [0.4, 1], QUAD_UV * [0.4, 1] + [0.6, 0]])
    mesh = Mesh(
        np.concatenate([left.vertices, right.vertices]), np.concatenate([QUAD, QUAD + 4]), uv=uv
    )

    assert len(np.unique(uv_islands(mesh))) == 2
    a_rig = with_display(
        rig(box([0.3, 0.02, 0.3]), pixels=128, image=np.ones((4, 4, 4), np.float32), picture=0.06),
        mesh,
    )
    solution = solve(a_rig)
    lit = solution.display_coverage > 0.5
    columns = np.flatnonzero(lit.any(axis=0))

    assert not lit[:, 206:306].any()  # UV 0.4 to 0.6 belongs to no panel
    assert lit[:, 5:200].mean() > 0.95
    assert lit[:, 312:507].mean() > 0.95
    assert columns.min() <= 1
    assert columns.max() >= 510


def l_display(bend):
    """Two panels that share the edge at x = 0, the right one
    raised by `bend`; UV 0 to 0.4 and 0.6 to 1.
    """
    middle = np.array([0, 0.15, -0.15])
    width = 0.025
    height = 0.05
    right = np.array([np.cos(bend), 0, np.sin(bend)])
    edges = middle + np.array([[-width, 0, 0], [0, 0, 0], width * right])
    up = np.array([0, height / 2, 0])
    vertices = np.concatenate(
        [edges - up, edges + up]
    )  # 0 1 2 along y = -h / 2, 3 4 5 along y = h / 2
    quads = np.array([[0, 1, 4, 3], [1, 2, 5, 4]])
    uv = np.concatenate([QUAD_UV * [0.4, 1], QUAD_UV * [0.4, 1] + [0.6, 0]])
    return Mesh(vertices, quads[:, QUAD].reshape(-1, 3), uv=uv)


def test_a_seam_on_an_edge_that_panels_share_is_a_border():
    """Each viewer pixel's light lies on the panels, by the
    closed form of both planes, and none in the gap in UV.

    A cell across the seam would draw the light of a pixel's width
    through all of the gap between the panels.
    """
    bend = np.radians(30)
    size = 512
    mesh = l_display(bend)
    assert len(np.unique(uv_islands(mesh))) == 2

    base = rig(
        box([0.3, 0.02, 0.3]), pixels=128, image=np.ones((4, 4, 4), np.float32), picture=0.06
    )
    solution = solve(with_display(base, mesh))

    gap = slice(int(np.ceil(0.4 * size)), int(0.6 * size))
    assert solution.display_coverage[:, gap].max() == 0
    assert solution.display_coverage[:, 5:200].mean() > 0.95

    # on which panel the light of each pixel's middle lands, and how far along it
    x, y = np.meshgrid(np.arange(128) + 0.5, np.arange(128) + 0.5)
    o, d = base.viewer.rays(np.stack([x.ravel(), y.ravel()], axis=1))
    p, i = closed_forms.through_slab(
        o, d, np.array([0, 1.0, 0]), np.array([0, -0.01, 0]), 0.02, 1.49
    )
    n = np.array([0, 1, -1]) / 2**0.5
    p = p + ((np.array([0, 0.15, 0]) - p) @ n / (i @ n))[:, None] * i
    i = -i + 2 * (i @ n)[:, None] * n
    expected = np.full((len(o), 2), np.nan)

    for first, along in (
        (0.0, np.array([1.0, 0, 0])),
        (0.6, np.array([np.cos(bend), 0, np.sin(bend)])),
    ):
        normal = np.cross(along, [0, 1.0, 0])
        q = (
            p
            + ((np.array([0, 0.15, -0.15]) - p) @ normal / (i @ normal))[:, None] * i
            - [0, 0.15, -0.15]
        )
        u = q @ along / 0.025 + (first == 0)
        v = q[:, 1] / 0.05 + 0.5
        on = (np.abs(u - 0.5) < 0.5) & (np.abs(v - 0.5) < 0.5)
        expected[on] = np.stack([(first + 0.4 * u) * size, (1 - v) * size], axis=1)[on]

    landings = trace_all(compile_plan(with_display(base, mesh), Settings()), o, d)
    np.testing.assert_array_equal(landings.has_arrived, np.isfinite(expected[:, 0]))
    np.testing.assert_allclose(
        landings.xy[landings.has_arrived], expected[landings.has_arrived], atol=1e-9
    )


def test_only_a_whole_flat_rectangle_counts_as_one():
    """Its plane gives the pixels of its corners.

    Half an image, a bent or a split one has no plane.
    """
    whole = rig(box([0.01] * 3)).display
    plane = display_plane(whole, make_surface(whole.mesh))
    corners = whole.mesh.corners.reshape(-1, 3)
    expected = np.stack(
        [whole.mesh.uv[..., 0] * 512, (1 - whole.mesh.uv[..., 1]) * 512], axis=2
    ).reshape(-1, 2)
    np.testing.assert_allclose(
        (corners - plane.corner) @ plane.pixels.T + plane.origin, expected, atol=1e-9
    )
    half = replace(whole.mesh, uv=whole.mesh.uv * 0.5)
    bent = replace(
        whole.mesh,
        vertices=whole.mesh.vertices + np.array([[0, 0, 0.001], [0, 0, 0], [0, 0, 0], [0, 0, 0]]),
    )
    for mesh in (half, bent, cylinder(8)):
        display = replace(whole, mesh=mesh)
        assert display_plane(display, make_surface(mesh)) is None


def test_what_a_plan_keeps_is_of_the_same_display_and_plate():
    """Of more pixels, turned, on another UV map, or behind a plate elsewhere: the plan is that of a
    rig nothing was kept of; one that stayed is not made again.
    """
    a_rig = ball_rig(2, pixels=32, display_pixels=32)
    display, plate = a_rig.display, a_rig.plates[0]
    turned = replace(display.mesh, vertices=display.mesh.vertices[:, [1, 0, 2]])
    halved = replace(display.mesh, uv=0.5 * display.mesh.uv)
    moved = replace(plate.mesh, vertices=plate.mesh.vertices + np.array([0, 1e-3, 2e-3]))
    kept = MeshCache()
    first = compile_plan(a_rig, Settings(), kept)
    for changed in (
        replace(a_rig, displays=(replace(display, width=48),)),
        replace(a_rig, displays=(replace(display, height=48),)),
        replace(a_rig, displays=(replace(display, mesh=turned),)),
        replace(a_rig, displays=(replace(display, mesh=halved),)),
        replace(a_rig, plates=(replace(plate, mesh=moved),)),
        a_rig,
    ):
        found, new = compile_plan(changed, Settings(), kept), compile_plan(changed, Settings())
        assert fingerprint(found.display) == fingerprint(new.display)
        assert fingerprint(found.triangles) == fingerprint(new.triangles)
    assert compile_plan(a_rig, Settings(), kept).display.plane is found.display.plane
    assert fingerprint(found.display) == fingerprint(first.display)


def halves_of(whole):
    """The rig with its display cut into two, side by side."""
    mesh, display = whole.display.mesh, whole.display
    corners = mesh.corners.reshape(-1, 3)
    origin, right, up = (
        corners[mesh.uv.reshape(-1, 2).tolist().index(at)] for at in ([0, 0], [1, 0], [0, 1])
    )
    places = [origin + k / 2 * (right - origin) for k in range(3)]
    halves = tuple(
        replace(
            display,
            name=f"half {k}",
            width=display.width // 2,
            mesh=Mesh(np.stack([a, b, b + up - origin, a + up - origin]), QUAD, uv=QUAD_UV),
        )
        for k, (a, b) in enumerate(pairwise(places))
    )
    return replace(whole, displays=halves)


def test_two_displays_have_each_their_own_landings_and_source_image():
    """Halves of a display, side by side, show what the whole one does, and all of the picture."""
    whole = rig(box([0.3, 0.02, 0.3]), pixels=48, display_pixels=64)
    both = halves_of(whole)

    o, d = whole.viewer.rays(np.random.default_rng(0).uniform(0, 48, (500, 2)))
    expected = trace_all(compile_plan(whole, Settings()), o, d)
    found = trace_all(compile_plan(both, Settings()), o, d)
    is_right = (expected.xy[:, 0] > 32)[expected.has_arrived]
    _, second = sections_of(both.lit)
    np.testing.assert_array_equal(found.has_arrived, expected.has_arrived)
    moved = expected.xy[expected.has_arrived] + np.where(is_right, [[-32], [second.top]], 0).T
    np.testing.assert_allclose(found.xy[found.has_arrived], moved, atol=1e-9)

    solution, one = solve(both), solve(whole)
    source = np.concatenate([section.of(solution.source) for section in solution.sections], axis=1)
    inner = [*range(30), *range(34, 64)]
    assert np.abs(source - one.source)[:, inner].max() < 1e-5
    assert solution.picture_coverage == pytest.approx(one.picture_coverage, abs=1e-3)
    assert sum(solution.by_display) == pytest.approx(solution.picture_coverage, abs=1e-3)


def test_a_display_without_light_is_dark_and_named():
    """The others show the same as without it, each over its own black level."""
    both = halves_of(rig(box([0.3, 0.02, 0.3]), pixels=48, display_pixels=64))
    far = rectangle([1.0, 1, 1], np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), 0.1, 0.1)
    dim = replace(both.displays[0], name="far", mesh=far, black_level=0.1)
    solution, without = solve(replace(both, displays=(dim, *both.displays))), solve(both)
    first, *others = (section.of(solution.source) for section in solution.sections)
    assert not first.any()
    for one, section in zip(others, without.sections, strict=True):
        np.testing.assert_allclose(one, section.of(without.source), atol=1e-6)
    assert any(note.startswith("'far' stays dark") for note in solution.notes)

    light = solution.rig.display.light_of(solution.source)
    assert solution.sections[0].of(light).max() == pytest.approx(0.1)
    assert solution.sections[1].of(light).min() == 0


def test_displays_that_overlap_are_refused():
    """Displays that share an edge, or part of a plane apart from each other, are not."""
    both = halves_of(rig(box([0.3, 0.02, 0.3]), pixels=48, display_pixels=64))
    one, other = both.displays
    both.check()
    step = 0.5 * (one.mesh.vertices[1] - one.mesh.vertices[0])
    over = replace(other, mesh=replace(other.mesh, vertices=other.mesh.vertices - step))
    for displays in ((one, replace(one, name="again")), (one, over)):
        with pytest.raises(RigError, match="overlap: move them apart"):
            replace(both, displays=displays).check()
    large = replace(other, mesh=replace(other.mesh, uv=1.2 * other.mesh.uv))
    with pytest.raises(RigError, match="The UV map of 'half 1' is larger than its image"):
        replace(both, displays=(one, large)).check()
