"""The packages that pip installs, in an environment with nothing else."""

import re
import subprocess
import venv
from collections.abc import Callable
from pathlib import Path

import pytest

import wheels
from build_kernel import this_target
from environments import ROOT, WINDOWS, clean_environment

EXAMPLE = ROOT / "examples" / "ball.py"
BENCHMARK = ROOT / "benchmark"
RIGS = "reference_ball", "reference_cube", "ellipsoid"
Pip = Callable[..., Path]


@pytest.fixture
def pip(tmp_path) -> Pip:
    """Installs files into a new environment; its Python."""
    venv.create(tmp_path / "venv", with_pip=True)
    python = tmp_path / "venv" / ("Scripts/python.exe" if WINDOWS else "bin/python")

    def install(*files: Path) -> Path:
        command = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *files]
        subprocess.run(command, check=True, env=clean_environment())
        return python

    return install


def printed(python: Path, folder: Path) -> str:
    """The line printed by the example."""
    command = [python, "-P", EXAMPLE]
    done = subprocess.run(
        command, cwd=folder, env=clean_environment(), capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def kernel_in(python: Path) -> str:
    """Whether the installed package finds its kernel."""
    code = "from kiriko_optics._core.native.loading import loaded; print(loaded() is not None)"
    return subprocess.run(
        [python, "-P", "-c", code], env=clean_environment(), capture_output=True, text=True
    ).stdout.strip()


def test_the_example_runs_from_the_wheels(pip, tmp_path):
    """Installed wheels compute the ball to a thousandth of white, with the kernel, and rigs of
    kiriko-bench to half a hundredth.
    """
    wheels.make("optics", "--wheel", into=tmp_path)
    (optics,) = tmp_path.glob("*.whl")
    python = pip(optics, wheels.WHEELS / wheels.kernel_wheel(this_target()))
    assert kernel_in(python) == "True"
    assert float(re.search(r"seen image ([\d.]+)", printed(python, tmp_path))[1]) < 1e-3
    assert (tmp_path / "source.png").exists()

    def run(*words: str | Path) -> str:
        command = [python, *words]
        return subprocess.run(
            command, check=True, capture_output=True, text=True, env=clean_environment()
        ).stdout

    run(BENCHMARK / "solve.py", tmp_path, *RIGS)
    scores = run(BENCHMARK / "score.py", tmp_path)
    assert len(scores.splitlines()) == len(RIGS)
    assert all(float(rmse) < 0.005 for rmse in re.findall(r"rmse ([\d.]+)", scores))


@pytest.mark.long(reason="zig is fetched and compiles with an empty cache")
def test_the_sources_build_elsewhere(pip, tmp_path):
    """The source distributions build with what pip fetches, and compute the same."""
    wheels.make("optics", "--sdist", into=tmp_path)
    wheels.make("kernel", "--sdist", into=tmp_path)
    python = pip(*tmp_path.glob("*.tar.gz"))
    assert kernel_in(python) == "True"
    assert float(re.search(r"seen image ([\d.]+)", printed(python, tmp_path))[1]) < 1e-3
