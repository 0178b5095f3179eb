import re
import sys
from pathlib import Path

import pytest

import environments

RUNNING = Path(sys.executable)


def test_every_package_has_its_hashes():
    """Each line of a requirements file is a comment, an include, or a pin with its hashes."""
    files = sorted((environments.ROOT / "scripts").glob("requirements-*.txt"))
    assert files
    for path in files:
        whole = path.read_text(encoding="utf-8").replace("\\\n", " ")
        for line in whole.splitlines():
            assert re.fullmatch(r"#.*|-r \S+|[\w.-]+==\S+( +--hash=sha256:[0-9a-f]{64})+", line), (
                f"{path.name}: {line[:80]}"
            )


@pytest.fixture
def checkout(tmp_path, monkeypatch) -> Path:
    """A checkout whose environment `tiny` needs no package."""
    monkeypatch.setattr(environments, "ROOT", tmp_path)
    monkeypatch.setattr(environments, "DEV", tmp_path / ".dev")
    (tmp_path / "scripts").mkdir()
    (tmp_path / "scripts" / "requirements-tiny.txt").write_text("# nothing\n")
    return tmp_path


def test_set_up_makes_unfinished_environments_anew_and_leaves_finished_ones_alone(checkout):
    """An environment without its stamp is made anew.

    One with the stamp of its pins is not touched.
    """
    interpreter = environments.set_up("tiny", RUNNING)
    stamp = checkout / ".dev" / "tiny" / "kiriko.stamp"
    trace = checkout / ".dev" / "tiny" / "trace of an old install"
    trace.touch()
    assert environments.set_up("tiny", RUNNING) == interpreter
    assert trace.exists()
    stamp.unlink()
    environments.set_up("tiny", RUNNING)
    assert stamp.exists()
    assert not trace.exists()


def test_set_up_stamps_nothing_that_failed(checkout):
    """When pip fails there is one sentence, and no stamp says that the environment is ready."""
    (checkout / "scripts" / "requirements-tiny.txt").write_text("-r requirements-broken.txt\n")
    (checkout / "scripts" / "requirements-broken.txt").write_text("./no-such-folder\n")
    with pytest.raises(environments.ToolError, match="pip install"):
        environments.set_up("tiny", RUNNING)
    assert not (checkout / ".dev" / "tiny" / "kiriko.stamp").exists()


def test_pins_include_those_of_included_files(checkout):
    """A changed pin in an included file changes the pins of the one that includes it."""
    (checkout / "scripts" / "requirements-tiny.txt").write_text(
        "-r requirements-more.txt\nnumpy==2.0\n"
    )
    (checkout / "scripts" / "requirements-more.txt").write_text("pytest==9.0\n")
    assert "pytest==9.0" in environments.pins(checkout / "scripts" / "requirements-tiny.txt")


def test_a_machine_without_python_is_told_what_to_install(monkeypatch):
    """Where no Python fits there is one sentence that names the packages to install."""
    monkeypatch.setattr(environments, "BLENDERS", {"bpy-9.9": "9.9"})
    with pytest.raises(
        environments.ToolError, match=r"^[^.]+ 3\.13 or 3\.11 .* install one, .*\.$"
    ):
        environments.newest_blender()


def test_the_running_python_comes_first():
    """A Python of the wanted version that is already running is the one that is taken."""
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    assert environments.find_python(version) == RUNNING
