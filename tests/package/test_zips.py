import re
import tomllib
from pathlib import Path
from zipfile import ZipFile

import pytest

ROOT = Path(__file__).resolve().parent.parent.parent
MANIFEST = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
# Platform of a zip -> how its wheels' names end.
WHEEL_ENDS = {
    "linux_x64": "manylinux_2_28_x86_64",
    "windows_x64": "win_amd64",
    "macos_x64": "macosx_13_0_x86_64",
    "macos_arm64": "macosx_13_0_arm64",
}
WITHOUT_WHEELS = {"windows_arm64"}
ZIPS = [*WHEEL_ENDS, *WITHOUT_WHEELS]


def test_one_zip_for_each_platform(contents: dict[str, list[str]]) -> None:
    """There is a zip for each platform of the manifest and no other."""
    assert set(contents) == {name.replace("-", "_") for name in MANIFEST["platforms"]} == set(ZIPS)


@pytest.mark.parametrize("platform", WHEEL_ENDS)
def test_zip_has_its_own_wheels(contents: dict[str, list[str]], platform: str) -> None:
    """A zip bundles embreex for its own platform, once for each Python of Blender 4.2 - 5.2 and distributions."""
    wheels = [name for name in contents[platform] if name.endswith(".whl")]
    assert all(name.endswith(f"{WHEEL_ENDS[platform]}.whl") for name in wheels)
    assert sorted(Path(name).name.split("-")[2] for name in wheels) == ["cp311", "cp313", "cp314"]


@pytest.mark.parametrize("platform", WITHOUT_WHEELS)
def test_zip_without_wheels_is_like_the_others(
    zips: dict[str, Path], contents: dict[str, list[str]], platform: str
) -> None:
    """A zip for a platform without embreex differs from the others in its wheels alone, and lists none to Blender."""
    others = [name for name in contents["linux_x64"] if not name.endswith(".whl")]
    assert sorted(contents[platform]) == sorted(others)
    with ZipFile(zips[platform]) as archive:
        generated = tomllib.loads(archive.read("blender_manifest.toml").decode())["build"]["generated"]
    assert generated == {"platforms": [platform.replace("_", "-")], "wheels": []}


@pytest.mark.parametrize("platform", ZIPS)
def test_zip_has_the_package_and_nothing_else(contents: dict[str, list[str]], platform: str) -> None:
    """A zip has the whole package, and nothing that only development needs."""
    names = set(contents[platform])
    code = [
        ROOT / "__init__.py",
        *(p for room in ("core", "operators", "panels") for p in ROOT.glob(f"{room}/**/*.py")),
        *(ROOT / "assets" / name for name in ("kiriko_plate.blend", "blender_assets.cats.txt")),
    ]
    assert {path.relative_to(ROOT).as_posix() for path in code} <= names
    rooms = {"core", "operators", "panels", "assets", "wheels"}
    files = {"__init__.py", "blender_manifest.toml", "LICENSE", "README.md"}
    assert {name for name in names if name.partition("/")[0] not in rooms} <= files
    assert {"LICENSE", "blender_manifest.toml"} <= names
    assert not [name for name in names if "__pycache__" in name or "/." in name]


def test_bundled_embreex_is_the_tested_one() -> None:
    """The bundled wheels are of the same version of embreex as the one the tests run with."""
    pins = (ROOT / "scripts" / "requirements-test.txt").read_text(encoding="utf-8")
    tested = re.search(r"^embreex==(\S+)$", pins, re.MULTILINE)[1]
    assert {Path(wheel).name.split("-")[1] for wheel in MANIFEST["wheels"]} == {tested}


def test_changelog_has_the_version() -> None:
    """The version in the manifest has its section in the changelog."""
    assert f"## {MANIFEST['version']}\n" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
