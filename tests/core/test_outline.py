"""Cells cut along the picture's outline: the light at the outline is right to rounding."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.image.flat_picture import outline_in_view, view_of_picture
from kiriko.core.image.outline import cut_along_outline
from kiriko.core.map.pieces import Piece
from kiriko.core.rig.rig import Picture
from known.polygons import area_and_centroid, clipped
from known.reference_rigs import ball_rig, box, cube_rig, rectangle, rig
from known.work import solve

CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def turned(width, height, degrees, centre=(0.002, 0.0, -0.001)):
    """A picture turned in its plane, across the viewer's line of sight."""
    a = np.radians(degrees)
    right = [np.cos(a), 0, np.sin(a)]
    up = [-np.sin(a), 0, np.cos(a)]
    return rectangle(np.array(centre), right, up, width, height)


def white(a_rig, mesh):
    """The rig with a white picture of another shape."""
    return replace(a_rig, pictures=(Picture("white", np.ones((8, 8, 4), np.float32), mesh),))


def area(polygon):
    return abs(area_and_centroid([tuple(point) for point in polygon])[0])


@pytest.mark.parametrize("degrees", [0, 3, 20, 45])
@pytest.mark.parametrize(("pixels", "display_pixels"), [(64, 64), (50, 150), (160, 48)])
def test_a_white_picture_shows_how_much_of_each_pixel_it_covers(degrees, pixels, display_pixels):
    """Index 1, no perspective: a display pixel is as bright as
    the part of it in the outline, by a polygon clipper.
    """
    a_rig = rig(
        box([0.3, 0.01, 0.3]),
        ior=1.0,
        pixels=pixels,
        display_pixels=display_pixels,
        projection="orthographic",
    )
    a_rig = white(a_rig, turned(0.021, 0.013, degrees))
    solution = solve(a_rig)
    corners = view_of_picture(a_rig.picture_place, a_rig.viewer, CORNERS)
    outline = solution.first.view_map.display_from_view(corners)
    expected = np.zeros(display_pixels**2)
    for pixel, (part, _, _) in clipped(outline, display_pixels, display_pixels).items():
        expected[pixel] = part

    assert expected.max() == pytest.approx(1)
    np.testing.assert_allclose(solution.source[..., 0].ravel(), expected, atol=1e-6)


@pytest.mark.parametrize(
    "a_rig", [ball_rig(4, pixels=128), cube_rig(pixels=128)], ids=["ball", "cube"]
)
def test_no_light_is_lost_or_won_at_the_outline(a_rig):
    """The weighted sum of a white picture's source image is the
    area on which it is seen: single precision, 1e-6.
    """
    a_rig = white(a_rig, turned(0.017, 0.011, 25))
    solution = solve(a_rig)
    assert solution.picture_coverage > 1 - 1e-9
    seen = area(view_of_picture(a_rig.picture_place, a_rig.viewer, CORNERS))
    assert (solution.source[..., 0] * solution.weight).sum() == pytest.approx(seen, rel=1e-6)


@pytest.mark.numpy_alone
@pytest.mark.parametrize("k", [3, 4])
def test_pieces_lie_on_one_side_and_make_up_the_whole(k):
    """Cut pieces have the area of the whole on both images and
    its throughput, and lie in the outline or beside it.

    A part that was cut has no image any more.
    """
    a_rig = ball_rig(2, pixels=32)
    place = replace(a_rig.picture_place, mesh=turned(0.021, 0.013, 20))
    random = np.random.default_rng(3)
    n = 3000
    view = random.uniform(0, 32, (n, 1, 2)) + random.uniform(0.2, 4, (n, 1, 1)) * (
        CORNERS[:k] - 0.5
    )
    view[:50] = np.round(view[:50])  # corners and edges on top of each other
    display = view @ np.array([[1.5, 0.3], [-0.2, 0.8]]) + 3
    throughput = random.random(n)
    branch = random.integers(0, 1 << 60, n).astype(np.uint64)
    branch_of = dict(zip(throughput.tolist(), branch.tolist(), strict=True))
    pieces = iter([Piece(view, display.copy(), throughput, branch)])
    found = [
        piece.at(np.isfinite(piece.display).all(axis=(1, 2)))
        for piece in cut_along_outline(pieces, place, a_rig.viewer)
    ]

    assert len(found[0].view) < n
    lines = outline_in_view(place, a_rig.viewer)
    for images, whole in ((0, view), (1, display)):
        areas = [
            (area(polygon), t)
            for piece in found
            for polygon, t in zip(piece[images], piece[2], strict=True)
        ]
        expected = [(area(polygon), t) for polygon, t in zip(whole, throughput, strict=True)]
        for moment in (0, 1, 2):
            sums = [sum(a * t**moment for a, t in some) for some in (areas, expected)]
            assert sums[0] == pytest.approx(sums[1], rel=1e-12)

    for piece, _, t, b, _ in found:
        assert [branch_of[number] for number in t.tolist()] == b.tolist()
        side = piece @ lines[:, :2].T + lines[:, 2]
        is_within = (side >= -1e-6).all(axis=(1, 2))
        is_beside = (side <= 1e-6).all(axis=1).any(axis=1)
        assert (is_within | is_beside).all()

    assert sum(len(piece[0]) for piece in found) > n


def test_what_has_no_straight_outline_is_not_cut():
    """The pieces of a picture in the viewer's own pixels, and
    of a bent one, are handed on as they are.
    """
    a_rig = ball_rig(2, pixels=32)
    bent = a_rig.picture.mesh
    bent = replace(bent, vertices=bent.vertices + np.array([[0, 0.001, 0]] + 3 * [[0, 0, 0]]))
    pieces = [Piece(CORNERS[None] + 8, CORNERS[None], np.ones(1), np.ones(1, np.uint64))]
    for mesh in (None, bent):
        found = list(
            cut_along_outline(iter(pieces), replace(a_rig.picture_place, mesh=mesh), a_rig.viewer)
        )
        assert found == pieces
