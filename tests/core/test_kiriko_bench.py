"""kiriko-bench's scorer, which runs without Kiriko."""

import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

SCORE = Path(__file__).resolve().parents[2] / "benchmark" / "score.py"


def scored(folder: Path) -> subprocess.CompletedProcess:
    """The scorer's end for a folder."""
    return subprocess.run([sys.executable, SCORE, folder], capture_output=True, text=True)


IMAGE = np.zeros((512, 512, 3), np.float32)


@pytest.mark.parametrize(
    ("name", "values", "said"),
    [
        ("cube.npy", IMAGE.astype(np.uint8), "type uint8"),
        ("cube.npy", IMAGE[:256], "write (512, 512, 3)"),
        ("cube.npy", IMAGE[..., 0], "write (512, 512, 3)"),
        ("cube.npy", np.full_like(IMAGE, np.nan), "not finite"),
        ("cube.map.npy", IMAGE, "write (h, w, 2)"),
        ("cube.map.npy", IMAGE[:1, :, :2], "write (h, w, 2)"),
        ("prism.npy", IMAGE, "no folder with a file named after a rig"),
    ],
)
def test_a_file_that_is_no_answer_ends_with_one_sentence(tmp_path, name, values, said) -> None:
    """Its fault, and what to write instead."""
    np.save(tmp_path / name, values)
    done = scored(tmp_path)
    assert done.returncode == 1
    assert said in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_text_and_no_folder_end_with_one_sentence(tmp_path) -> None:
    """Neither a text file nor a missing folder ends in a traceback."""
    (tmp_path / "cube.npy").write_text("a picture")
    for place in (tmp_path, tmp_path / "missing"):
        done = scored(place)
        assert done.returncode == 1
        assert len(done.stderr.splitlines()) == 1


def test_a_map_of_the_ball_in_closed_form_has_no_error() -> None:
    """The exact sphere's landings at pixel centres, read between them, are the reference's to a
    hundredth of a pixel; an empty map misses everything.
    """
    from known.closed_forms import landing, through_ball
    from known.reference_rigs import ball_rig

    score = runpy.run_path(str(SCORE))
    rig, landings = score["load"]("reference_ball")
    y, x = np.mgrid[:512, :512] + 0.5
    a_rig = ball_rig(2)
    rays = a_rig.viewer.rays(np.stack([x.ravel(), y.ravel()], axis=1))
    exact = landing(a_rig, *through_ball(*rays, 0.025, 1.49)).reshape(512, 512, 2)
    row = score["score_map"](rig, landings, exact)
    assert row["95 % px"] < 0.01
    assert row["missed %"] < 1  # at the rim, where a neighbouring pixel has no landing
    assert score["score_map"](rig, landings, np.full_like(exact, np.nan))["missed %"] == 100


def test_similarity_is_that_of_the_definition() -> None:
    """By a window at a time, on noise."""
    score = runpy.run_path(str(SCORE))
    dice = np.random.default_rng(5)
    one, other = dice.random((2, 20, 15, 3))
    found = []
    for i in range(14):
        for j in range(9):
            a, b = one[i : i + 7, j : j + 7], other[i : i + 7, j : j + 7]
            for c in range(3):
                cov = np.cov(a[..., c].ravel(), b[..., c].ravel(), ddof=0)
                m, n = a[..., c].mean(), b[..., c].mean()
                found.append(
                    (2 * m * n + 1e-4) * (2 * cov[0, 1] + 9e-4)
                    / ((m * m + n * n + 1e-4) * (cov[0, 0] + cov[1, 1] + 9e-4))
                )  # fmt: skip
    assert score["ssim"](one, other) == pytest.approx(np.mean(found), abs=1e-9)
