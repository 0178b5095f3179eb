"""Workers of a farm: a Blender with factory settings that runs Kiriko from the zip."""

import importlib.util
import json
import os
import shutil
import signal
import subprocess
import sys
import tomllib
from pathlib import Path
from types import ModuleType
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile

import bpy
import pytest

ROOT = Path(__file__).resolve().parent.parent.parent
AS_BLENDER = ROOT / "tests" / "known" / "as_blender.py"


@pytest.fixture
def job(own_zip, tmp_path) -> Path:
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
        env={
            **kept,
            "BLENDER_USER_RESOURCES": str(job.parent / "profile"),
        },
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


def test_worker_solves_with_nothing_installed(installed, job):
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


def test_version_without_a_number(job):
    assert "No version follows --version" in refusal(work(job, "--version"))


def test_worker_without_its_file(job):
    """A file that is missing is Kiriko's own sentence, and nothing is written."""
    done = work(job, "solve", "--out", job / "out", file=job / "missing.blend")
    assert "No .blend file was loaded" in refusal(done)
    assert not (job / "out").exists()


@pytest.fixture
def bootstrap(tmp_path) -> ModuleType:
    """The script as a module, in a folder without a zip."""
    script = shutil.copy(ROOT / "farm" / "kiriko_bootstrap.py", tmp_path)
    spec = importlib.util.spec_from_file_location("bootstrap", script)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def reported(
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


def write_zip(path: Path, *change: str, packing: int = ZIP_STORED) -> None:
    """Write a zip with Kiriko's manifest, in which one text is changed for another."""
    manifest = (ROOT / "blender_manifest.toml").read_text("utf-8")
    if change:
        assert change[0] in manifest
        manifest = manifest.replace(*change)
    with ZipFile(path, "w", packing) as archive:
        archive.writestr("blender_manifest.toml", manifest)


def test_worker_without_kiriko(bootstrap, monkeypatch, capsys):
    """Without a zip the sentence names the platform whose zip belongs there."""
    said = reported(bootstrap, monkeypatch, capsys)
    assert "There is no zip of Kiriko" in said
    assert bootstrap.this_platform() in said


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("platforms = [", 'platforms = ["vax-vms"]\nothers = ['), "is for vax-vms"),
        (("-cp31", "-cp32"), "is for another Python"),
        (('version = "0', 'version = "9'), "and the job was made with 0"),
        (('blender_version_min = "4', 'blender_version_min = "94'), "needs Blender 94"),
        (('schema_version = "1.0.0"', 'schema_version = "1.0.0"\nid ='), "cannot be read"),
    ],
)
def test_zips_that_do_not_fit(bootstrap, tmp_path, monkeypatch, capsys, change, said):
    """Another platform, another version, a newer Blender and a broken zip each have a sentence."""
    write_zip(tmp_path / "kiriko.zip", *change)
    version = tomllib.loads((ROOT / "blender_manifest.toml").read_text("utf-8"))["version"]
    assert said in reported(bootstrap, monkeypatch, capsys, "--version", version)


def encrypted(path: Path) -> None:
    """Mark the manifest in a zip as encrypted, in both of its headers."""
    write_zip(path)
    data = bytearray(path.read_bytes())
    for magic, flags in ((b"PK\3\4", 6), (b"PK\1\2", 8)):
        data[data.index(magic) + flags] |= 1
    path.write_bytes(data)


def packed_oddly(path: Path) -> None:
    """Name a packing that Python does not know."""
    write_zip(path)
    data = bytearray(path.read_bytes())
    for magic, method in ((b"PK\3\4", 8), (b"PK\1\2", 10)):
        data[data.index(magic) + method] = 97
    path.write_bytes(data)


def damaged(path: Path) -> None:
    """Change bytes within the packed manifest."""
    write_zip(path, packing=ZIP_DEFLATED)
    data = bytearray(path.read_bytes())
    data[80:120] = b"\xff" * 40
    path.write_bytes(data)


ODD = (
    *(encrypted, packed_oddly, damaged),
    lambda path: path.write_bytes(b""),
    lambda path: path.write_bytes(b"PK\3\4" + b"x" * 100),
    lambda path: path.mkdir(),
    lambda path: write_zip(path, 'blender_version_min = "4', 'blender_version_min = "four'),
    lambda path: write_zip(path, 'blender_version_min = "', 'oldest = "'),
    lambda path: write_zip(path, "platforms = [", "platforms = 7\nothers = ["),
    lambda path: write_zip(path, "[build]", "[others]\n[[build]]"),
    lambda path: write_zip(path, 'version = "0', 'number = "0'),
    lambda path: write_zip(path, 'id = "kiriko"', 'id = "other"'),
)


@pytest.mark.parametrize("make", ODD)
def test_an_odd_zip_does_not_block_a_good_one(bootstrap, tmp_path, monkeypatch, capsys, make):
    """Alone, a zip that cannot be used gets one sentence; beside a good one it is passed over."""
    make(tmp_path / "kiriko-a.zip")
    reported(bootstrap, monkeypatch, capsys)
    write_zip(tmp_path / "kiriko-good.zip")
    assert bootstrap.fitting_zip(tmp_path, None) == tmp_path / "kiriko-good.zip"


def test_the_newest_zip_that_this_blender_takes_is_used(bootstrap, tmp_path):
    """By its numbers, not its name; a zip for a newer Blender, or of something else, is left."""
    for name, *change in (
        ("a.zip", 'version = "0.', 'version = "10.'),
        ("b.zip", 'version = "0.', 'version = "9.'),
        ("c.zip", 'blender_version_min = "4', 'blender_version_min = "94'),
        ("d.zip", "-cp31", "-cp32"),
    ):
        write_zip(tmp_path / name, *change)
    with ZipFile(tmp_path / "textures.zip", "w") as archive:
        archive.writestr("wood.png", b"")
    assert bootstrap.fitting_zip(tmp_path, None) == tmp_path / "a.zip"


STANDSTILL = """
import runpy, sys, time
import bpy
script = runpy.run_path(sys.argv[1])
variables = script["main"].__globals__
variables["fitting_zip"] = lambda folder, version: folder
variables["enable"] = lambda zip, home: (print(home, flush=True), time.sleep(60))
script["main"]()
"""


def test_a_task_that_is_terminated_leaves_nothing(bootstrap, tmp_path):
    """SIGTERM, as farms end a task, removes the temporary folder and gives the signal's code."""
    process = subprocess.Popen(
        [sys.executable, "-c", STANDSTILL, bootstrap.__file__],
        env={**os.environ, "TMPDIR": str(tmp_path)},
        stdout=subprocess.PIPE,
        text=True,
    )
    home = Path(process.stdout.readline().strip())
    assert home.parent == tmp_path
    process.send_signal(signal.SIGTERM)
    assert process.wait(60) == 128 + signal.SIGTERM
    assert not home.exists()
