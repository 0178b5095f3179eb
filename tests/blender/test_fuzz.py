"""Random rigs end in a result or in one sentence; and one that does not is found."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest

from environments import as_module
from extension import loaded

SEED = 11  # of the rigs tried here; `dev.py fuzz` tries more
RIGS = (0, 1, 2, 14, 28, 36, 40)  # that take little time
SOLVED = 0  # one of them, tame, that is solved in little time
ROOT = Path(__file__).resolve().parent.parent.parent
# the inventory that tells a rig's changes reads everything;
# the same rigs are solved in the newer versions
pytestmark = pytest.mark.skipif(
    bpy.app.version < (4, 5), reason="reading every property there is crashes Blender 4.2"
)


@pytest.fixture
def fuzz(scene):
    from fuzz import run as fuzz

    return fuzz


def test_random_rigs_end_in_a_result_or_in_one_sentence(fuzz):
    """Of random rigs, broken and wild ones among them, each is solved or refused.

    The scene stays as it was.
    """
    outcomes = [fuzz.try_rig(SEED, k) for k in RIGS]
    assert [(o.k, o.text) for o in outcomes if o.verdict == "failed"] == []
    assert {o.verdict for o in outcomes} == {"solved", "refused"}


def test_eye_box_and_pictures_of_random_rigs_end_so_too(fuzz, monkeypatch):
    """On a rig that has an eye box, and on one whose picture is not flat."""
    monkeypatch.setattr(fuzz, "ON_RESULT", {})
    monkeypatch.setattr(fuzz, "ANYWAY", {fuzz.eye_box: 1.0, fuzz.render_pictures: 1.0})
    outcomes = [fuzz.try_rig(SEED, k) for k in (13, 11)]
    assert [(o.k, o.text) for o in outcomes if o.verdict == "failed"] == []
    assert [bool(o.also["eye_box"]) for o in outcomes] == [False, True]
    assert [o.also["render_pictures"] for o in outcomes] == ["", ""]


def move_something():
    bpy.data.objects["Glass"].location.x += 1e-3


def source_with(number):
    """A solution whose source image holds this number."""

    def spoilt(kiriko, solution):
        pixels = solution.source.copy()
        pixels[0, 0, 0] = number
        return replace(solution, source=pixels)

    return spoilt


def crash(kiriko, solution):
    raise IndexError("index 3 is out of bounds")


def bend_the_scene(kiriko, solution):
    move_something()
    return solution


def refuse_late(kiriko, solution):
    move_something()
    raise kiriko.core.base.errors.RigError("The rig is not to be solved today: try tomorrow.")


def refuse_with(text):
    def refuse(kiriko, solution):
        raise kiriko.core.base.errors.RigError(text)

    return refuse


def lose_a_share(kiriko, solution):
    channel = replace(solution.first, misses={"blocked": float("nan")})
    return replace(solution, channels=(channel,))


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        (crash, "IndexError"),
        (source_with(np.nan), "not finite"),
        (source_with(-1.0), "negative"),
        (bend_the_scene, "changed objects Glass"),
        (refuse_late, "but changed objects Glass"),
        (refuse_with("It went wrong. Sorry"), "full stop"),
        (refuse_with("It went wrong. We are sorry. So are they. Try again."), "too many sentences"),
        (refuse_with("The display is nan mm wide: enlarge it."), "not a number"),
        (lose_a_share, "NaN"),
    ],
    ids=lambda value: getattr(value, "__qualname__", "").split(".")[0] or value,
)
def test_a_broken_solver_is_found(kiriko, fuzz, monkeypatch, fault, told):
    """A solve that crashes, returns no image, changes the
    scene or does not say why it refuses, fails.
    """
    solve = loaded("operators.solve")
    loaded("core.base.errors")
    right = solve.write_solution
    monkeypatch.setattr(
        solve,
        "write_solution",
        lambda scene, reading, found: right(scene, reading, fault(kiriko, found)),
    )
    outcome = fuzz.try_rig(SEED, SOLVED)

    assert outcome.verdict == "failed"
    assert told in outcome.text


def test_a_rig_that_takes_too_long_is_named(tmp_path):
    """A rig that takes longer than it may is ended and told of,
    with the command that repeats it, and the next one is tried.
    """
    command = [
        sys.executable,
        *as_module("fuzz.run"),
        "--seed",
        str(SEED),
        "--rigs",
        "2",
        "--seconds",
        "0.001",
    ]
    path = os.pathsep.join(str(ROOT / folder) for folder in (".dev/link", "scripts", "tests"))
    variables = {**os.environ, "PYTHONPATH": path, "BLENDER_USER_RESOURCES": str(tmp_path)}
    run = subprocess.run(command, env=variables, capture_output=True, text=True)

    assert run.returncode == 1
    for k in range(2):
        assert f"--seed {SEED} --only {k}" in run.stdout
    assert "Timeout" in run.stdout
    assert "2 failed" in run.stdout
