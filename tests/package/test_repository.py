"""The extension from a repository on a web server: installed, updated, solved with, removed."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from zipfile import ZIP_STORED, ZipFile

import pytest

import package

ROOT = Path(__file__).resolve().parents[2]
USER = ROOT / "tests" / "known" / "repository_user.py"


def with_version(own: Path, version: str, folder: Path) -> Path:
    """A copy of a zip with another version."""
    path = folder / f"kiriko-{version}-{own.stem.split('-')[-1]}.zip"
    with ZipFile(own) as old, ZipFile(path, "w", ZIP_STORED) as new:
        for info in old.infolist():
            data = old.read(info)
            if info.filename == "blender_manifest.toml":
                text = re.sub(r'(?m)^version = ".*"', f'version = "{version}"', data.decode())
                data = text.encode()
            new.writestr(info.filename, data)
    return path


@pytest.fixture
def served(tmp_path) -> Iterator[tuple[Path, str]]:
    """A folder and its address on a web server of this machine."""
    folder = tmp_path / "served"
    folder.mkdir()
    command = [sys.executable, "-u", "-m", "http.server", "0", "--bind", "127.0.0.1"]
    server = subprocess.Popen(
        [*command, "--directory", str(folder)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    port = re.search(r"port (\d+)", server.stdout.readline())[1]
    yield folder, f"http://127.0.0.1:{port}"
    server.terminate()
    server.wait(30)


def test_install_update_solve_and_remove(own_zip, served, tmp_path):
    """Blender adds the repository, installs 0.1.9, updates to this version, solves with it, and
    leaves nothing behind.
    """
    folder, address = served
    with_version(own_zip, "0.1.9", folder)
    version = own_zip.stem.split("-")[1]
    package.extension_tool("server-generate", "--repo-dir", folder, "--html")
    done = subprocess.run(
        [sys.executable, USER, folder, address, own_zip],
        env={
            **os.environ,
            "BLENDER_USER_RESOURCES": str(tmp_path / "profile"),
            "PYTHONPATH": str(ROOT / "scripts"),
        },
        capture_output=True,
        text=True,
    )
    said = [line[5:] for line in done.stdout.splitlines() if line.startswith("USER ")]
    expected = ["installed 0.1.9", f"updated to {version}", "solved {'FINISHED'}", "removed True"]
    assert said == expected, done.stdout[-2000:] + done.stderr
