"""Workers of a farm: a Blender with factory settings that runs Kiriko from the zip."""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from types import ModuleType
from zipfile import ZipFile

import bpy
import pytest

ROOT = Path(__file__).resolve().parent.parent.parent
AS_BLENDER = ROOT / "tests" / "known" / "as_blender.py"


@pytest.fixture
def job(own_zip: Path, tmp_path: Path) -> Path:
    """A folder with a script and the zip for this machine, with a space and Japanese in its name;
    a profile that must stay empty beside it.
    """
    folder = tmp_path / "金魚 job"
    folder.mkdir()
    shutil.copyfile(ROOT / "farm" / "kiriko_bootstrap.py", folder / "kiriko_bootstrap.py")
    shutil.copy(own_zip, folder)
    (tmp_path / "profile").mkdir()
    return folder


def work(job: Path, *words: object, file: Path | None = None) -> subprocess.CompletedProcess:
    """Run a worker's Blender as a farm does."""
    options = ["--background", *([file] if file else []), "--factory-startup"]
    script = ["--python-exit-code", "1", "--python", job / "kiriko_bootstrap.py", "--"]
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run(
        [sys.executable, "-P", AS_BLENDER, *options, *script, *map(str, words)],
        env={**kept, "BLENDER_USER_RESOURCES": str(job.parent / "profile")},
        capture_output=True,
        text=True,
        encoding="utf-8",
    )


def refusal(done: subprocess.CompletedProcess) -> str:
    """Kiriko's one sentence on stderr, of a worker that failed."""
    assert done.returncode == 1, done.stdout + done.stderr
    (line,) = (line for line in done.stderr.splitlines() if line.startswith("kiriko: "))
    assert line.endswith(".")
    assert "Traceback" not in done.stderr
    return line


def test_worker_solves_with_nothing_installed(installed: str, job: Path) -> None:
    """From factory settings, by the kernel of the zip; the user's profile stays empty, and so does
    the temporary folder.
    """
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.kiriko.add_rig(viewer_resolution=64, display_resolution=(64, 64))
    bpy.context.scene.kiriko.tolerance = 1.0
    file = job / "rig 一.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(file), copy=True)

    version = tomllib.loads((ROOT / "blender_manifest.toml").read_text("utf-8"))["version"]
    out = job / "out"
    done = work(job, "--version", version, "solve", "--out", out, file=file)
    assert done.returncode == 0, done.stdout + done.stderr
    report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    assert "compiled kernel" in report["used"]
    extensions = job.parent / "profile" / "extensions"
    assert not [path for path in extensions.rglob("*") if "kiriko" in path.name.lower()]


def test_version_without_a_number(job: Path) -> None:
    assert "No version follows --version" in refusal(work(job, "--version"))


def test_worker_without_its_file(job: Path) -> None:
    """A file that is missing is Kiriko's own sentence, and nothing is written."""
    done = work(job, "solve", "--out", job / "out", file=job / "missing.blend")
    assert "No .blend file was loaded" in refusal(done)
    assert not (job / "out").exists()


@pytest.fixture
def bootstrap(job: Path) -> ModuleType:
    """The script as a module."""
    spec = importlib.util.spec_from_file_location("bootstrap", job / "kiriko_bootstrap.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def told(
    bootstrap: ModuleType,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture,
    *words: str,
) -> str:
    """The one sentence of a script that ends with 1."""
    monkeypatch.setattr(sys, "argv", ["blender", "--", *words, "solve"])
    with pytest.raises(SystemExit) as end:
        bootstrap.main()
    assert end.value.code == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("kiriko: ")
    assert line.endswith(".")
    return line


def test_worker_without_kiriko(
    bootstrap: ModuleType,
    job: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture,
) -> None:
    """Without the zip the sentence names the platform whose zip is wanted; so is a broken one."""
    for path in job.glob("*.zip"):
        path.unlink()
    assert "There is no zip of Kiriko" in told(bootstrap, monkeypatch, capsys)
    (job / "other.zip").write_bytes(b"")
    assert "cannot be read" in told(bootstrap, monkeypatch, capsys)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (('platforms = ["', 'platforms = ["vax-vms", "pdp11-'), "is for vax-vms"),
        (('version = "0', 'version = "9'), "and the job was made with 0"),
        (('blender_version_min = "4', 'blender_version_min = "94'), "needs Blender 94"),
        (('schema_version = "1.0.0"', 'schema_version = "1.0.0"\nid ='), "cannot be read"),
    ],
)
def test_zips_that_do_not_fit(
    bootstrap: ModuleType,
    job: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture,
    change: tuple[str, str],
    said: str,
) -> None:
    """Of another platform, another version, for a newer Blender, broken: each has its sentence."""
    (path,) = job.glob("*.zip")
    with ZipFile(path) as archive:
        manifest = archive.read("blender_manifest.toml").decode()
    assert change[0] in manifest
    with ZipFile(path, "w") as archive:
        archive.writestr("blender_manifest.toml", manifest.replace(*change))
    version = tomllib.loads((ROOT / "blender_manifest.toml").read_text("utf-8"))["version"]
    assert said in told(bootstrap, monkeypatch, capsys, "--version", version)
