"""The example of plain arrays, which is also the README's."""

import inspect
import json
import re
import runpy
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kiriko_optics import solve
from kiriko_optics._core.files.png import is_whole
from kiriko_optics._core.rig.settings import Settings
from kiriko_optics._core.solve.solution import without_glass

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "examples" / "ball.py"


def test_the_example_shows_its_rings_in_the_ball(tmp_path, monkeypatch, capsys) -> None:
    """The seen image is the picture to a thousandth of white; without Kiriko it is 50 times worse.

    It prints this error, and writes the source image.
    """
    monkeypatch.chdir(tmp_path)
    example = runpy.run_path(str(EXAMPLE))
    assert is_whole(tmp_path / "source.png")

    solution = example["solution"]
    assert solution.notes == ()
    assert example["error"] < 1e-3
    printed = re.search(r"seen image ([\d.]+)", capsys.readouterr().out)[1]
    assert float(printed) == pytest.approx(example["error"], abs=1e-5)

    plain = solve(without_glass(example["rig"])).source
    difference = solution.seen(plain) - solution.ideal()
    assert np.sqrt(np.mean(difference**2)) > 50 * example["error"]


@pytest.mark.parametrize("readme", ["README.md", "README.ja.md"])
def test_the_readme_has_the_example(readme: str) -> None:
    """The README's Python is the file, word for word."""
    text = (ROOT / readme).read_text(encoding="utf-8")
    assert f"```python\n{EXAMPLE.read_text(encoding='utf-8')}```\n" in text


def test_the_notebook_keeps_its_tolerances(tmp_path, monkeypatch, capsys) -> None:
    """Its cells run in order, and no error of the landings is above its tolerance."""
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    shutil.copytree(EXAMPLE.parent, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    notebook = json.loads((tmp_path / "ball.ipynb").read_text(encoding="utf-8"))
    names: dict[str, Any] = {}
    for cell in notebook["cells"]:
        assert not cell.get("outputs")
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)
    assert (names["errors"] < names["tolerances"]).all()
    assert len(capsys.readouterr().out.splitlines()) == 1 + len(names["tolerances"])


def test_solve_has_all_settings() -> None:
    """The keywords of `solve` are the fields of Settings, with the same defaults."""
    _, *keywords = inspect.signature(solve).parameters.values()
    assert {one.name: one.default for one in keywords} == vars(Settings())
