import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import environments
from dev import OWN, SCRIPTS

DEV = Path(environments.__file__).with_name("dev.py")


def reported(verb: str) -> str:
    """The answer of dev.py to --help after a verb, in a Python that has no package but its own."""
    command = [sys.executable, "-S", "-E", str(DEV), verb, "--help"]
    answer = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert answer.returncode == 0, answer.stderr
    return answer.stdout


def test_every_verb_has_its_row_in_contributing():
    """The table of CONTRIBUTING.md lists all verbs of dev.py, and none that it has not."""
    table = (environments.ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `python3 scripts/dev\.py (\w+)", table, re.MULTILINE)
    assert set(rows) == {*SCRIPTS, *OWN}


@pytest.mark.parametrize("verb", SCRIPTS)
def test_help_after_a_verb_shows_the_options_of_its_script(verb):
    """All that the script's parser adds is in the answer, without
    numpy, Blender or anything that were to be set up.
    """
    script = DEV.parent / f"{SCRIPTS[verb].module.replace('.', '/')}.py"
    added = re.findall(
        r'(?:add_argument|option)\(\s*"([\w-]+)"(?![^)]*SUPPRESS)', script.read_text()
    )
    answer = reported(verb)
    assert "usage" in answer
    assert all(option in answer for option in added)


@pytest.mark.parametrize("verb", OWN)
def test_help_after_a_verb_of_dev_itself_is_its_own(verb):
    """The verbs that hand nothing on say their work."""
    assert f"dev.py {verb}" in reported(verb)


@pytest.mark.parametrize("version", ["3.7", "3.9", "3.10"])
def test_an_old_python_is_told_which_one_is_needed(version):
    """A Python without `tomllib` ends with one sentence that names the Python to run."""
    pyenv = Path.home().glob(f".pyenv/versions/{version}.*/bin/python")
    found = [shutil.which(f"python{version}") or "", *pyenv]
    python = next((path for path in found if environments.ask([path, "-c", "print(1)"])), None)
    if python is None:
        pytest.skip(f"no Python {version} was found")
    answer = subprocess.run([python, DEV, "lint"], stderr=subprocess.PIPE, check=False)
    assert answer.returncode == 1
    (line,) = answer.stderr.decode().splitlines()
    assert f"This is Python {version}" in line
    assert "python3.13 scripts/dev.py" in line
