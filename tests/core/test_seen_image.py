"""The seen image, against pictures computed from closed forms."""

import numpy as np
import pytest

from kiriko.core.image.seen_image import dot_centroids, lattice_shift
from kiriko.core.solve.solution import without_glass
from known import closed_forms
from known.reference_rigs import ball_rig, box, lattice_image, rig
from known.work import solve

CASES = {
    "ball": (lambda **o: ball_rig(5, **o), closed_forms.through_ball, {"radius": 0.025, "n": 1.49}),
    "slab": (
        lambda **o: rig(box([0.3, 0.03, 0.3], degrees_about_z=25.0), **o),
        closed_forms.through_slab,
        {
            "normal": (a := np.array([-np.sin(np.radians(25)), np.cos(np.radians(25)), 0])),
            "near": -0.015 * a,
            "thickness": 0.03,
            "n": 1.49,
        },
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_the_lattice_moves_as_the_closed_form_says_and_returns(name):
    """Uncompensated dots stand where the closed form puts them, to the mesh's own error.

    Compensated ones as wanted.
    """
    make, through, shape = CASES[name]
    a_rig = make(pixels=400, field=0.044, display_pixels=512, image=lattice_image(512))
    solution = solve(a_rig, tolerance=0.05)
    plain = solve(without_glass(a_rig), only_through_glass=False).source
    ideal = solution.ideal()
    exact = dot_centroids(closed_forms.seen_image(a_rig, plain, through, **shape))
    before = dot_centroids(solution.seen(plain))

    assert np.isfinite(before).all()
    assert np.abs(before - exact).max() < 0.1  # facets of 1 mm; the slab is the judge of the rest
    if name == "slab":
        assert np.abs(before - exact).max() < 0.05  # 16 points a pixel of the judge
    moved = lattice_shift(solution.seen(plain), ideal)
    after = lattice_shift(solution.seen(), ideal)

    assert moved.mean > 3
    assert after.n_seen == 49
    assert after.mean < 0.02
    assert after.largest < 0.08

    # and the source image undoes the closed form's warp too, not only Kiriko's own
    undone = dot_centroids(
        closed_forms.seen_image(a_rig, solution.source, through, **shape)
    ) - dot_centroids(ideal)

    assert np.linalg.norm(undone, axis=2).mean() < 0.03


def test_dots_are_told_apart_wherever_they_stand():
    """Dots moved by hand are found where they were put, to 0.02 px; a missing one is NaN."""
    size, n = 350, 7
    random = np.random.default_rng(5)
    image = np.zeros((size, size, 3))
    y, x = np.mgrid[:size, :size] + 0.5
    centres = np.zeros((n, n, 2))

    for k, place in enumerate(random.permutation(49)):
        j, i = divmod(k, n)
        centres[j, i] = 25 + 50 * np.array([place % n, place // n]) + random.uniform(-8, 8, 2)
        cover = np.clip(10.5 - np.hypot(x - centres[j, i, 0], y - centres[j, i, 1]), 0, 1)
        image += cover[..., None] * np.array([1, (i + 1) / 8, (j + 1) / 8])

    assert np.abs(dot_centroids(image) - centres).max() < 0.02
    image[:, :, :][np.abs(image[..., 1] * 8 - image[..., 0]) < 1e-6] = 0  # all dots of column 0
    assert np.isnan(dot_centroids(image)[:, 0]).all()
    assert np.isfinite(dot_centroids(image)[:, 1:]).all()


def test_a_dot_seen_twice_counts_where_most_of_it_is():
    """A small second image of a dot does not pull its centroid."""
    y, x = np.mgrid[:200, :200] + 0.5
    cover = np.clip(10.5 - np.hypot(x - 50, y - 60), 0, 1) + np.clip(
        4.5 - np.hypot(x - 150, y - 20), 0, 1
    )
    image = cover[..., None] * np.array([1, 1 / 8, 1 / 8])
    assert np.abs(dot_centroids(image)[0, 0] - [50, 60]).max() < 0.01
