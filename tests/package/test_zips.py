import re
import tomllib
from collections.abc import Iterable
from pathlib import Path
from shutil import copytree
from zipfile import ZipFile

import pytest

import build_kernel
import wheels
from packages.kernel import compile_kernel

ROOT = Path(__file__).resolve().parent.parent.parent
MANIFEST = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
# Platform of a zip -> how the names of its wheels of embreex end.
WHEEL_ENDS = {
    "linux_x64": "manylinux_2_28_x86_64",
    "windows_x64": "win_amd64",
    "macos_x64": "macosx_13_0_x86_64",
    "macos_arm64": "macosx_13_0_arm64",
}
WITHOUT_EMBREE = {"windows_arm64", "linux_arm64"}
ZIPS = [*WHEEL_ENDS, *WITHOUT_EMBREE]
LONG = pytest.mark.long(reason="the gate builds the zip of this machine's platform alone")
ROOMS = ("core", "operators", "panels", "languages")
KERNELS = {target.platform.replace("-", "_"): target for target in build_kernel.TARGETS}


def each_of(platforms: Iterable[str]) -> pytest.MarkDecorator:
    """Each platform as a parameter, and that of this machine as one of the gate."""
    here = build_kernel.this_target()
    own = here.platform.replace("-", "_") if here else ""
    cases = [pytest.param(name, marks=() if name == own else LONG) for name in platforms]
    return pytest.mark.parametrize("platform", cases)


@LONG
def test_one_zip_for_each_platform(contents):
    """There is a zip for each platform of the manifest and no other."""
    assert set(contents) == {name.replace("-", "_") for name in MANIFEST["platforms"]} == set(ZIPS)


@each_of(WHEEL_ENDS)
def test_zip_has_its_own_wheels(contents, platform):
    """A zip bundles embreex for its own platform, once for each Python of Blender 4.2 - 5.2; for
    Macs with Intel processors there is none after 4.5.
    """
    wheels = [name for name in contents[platform] if Path(name).name.startswith("embreex")]
    assert all(name.endswith(f"{WHEEL_ENDS[platform]}.whl") for name in wheels)
    pythons = ["cp311"] if platform == "macos_x64" else ["cp311", "cp313"]
    assert sorted(Path(name).name.split("-")[2] for name in wheels) == pythons


@LONG
def test_one_zip_is_for_the_python_of_distributions():
    """Its wheels are those of Linux for Python 3.14, so a repository offers it to those alone."""
    (path,) = ROOT.glob("dist/kiriko-*-linux_x64-cp314.zip")
    found = [Path(name).name for name in ZipFile(path).namelist() if name.endswith(".whl")]
    assert sorted(name.split("-")[2] for name in found) == ["cp314", "py3"]


@each_of(ZIPS)
def test_zip_has_its_own_kernel(contents, kernels, platform):
    """A zip bundles the kernel of its own platform, of the
    sources' version. What is in it: `test_libraries.py`.
    """
    (wheel,) = (
        name for name in contents[platform] if Path(name).name.startswith(build_kernel.MODULE)
    )
    assert Path(wheel).name == wheels.kernel_wheel(KERNELS[platform])
    assert len(kernels[platform]) < 200_000


@pytest.mark.long(reason="each platform takes a compiler with an empty cache")
# For Windows the compiler's cache takes more than a minute to fill.
@pytest.mark.parametrize("platform", [name for name in ZIPS if not name.startswith("windows")])
def test_the_kernel_is_built_the_same_anywhere(kernels, platform, tmp_path, monkeypatch):
    """Byte by byte, in another folder and with an empty cache."""
    target = KERNELS[platform]
    monkeypatch.setattr(
        build_kernel, "SOURCES", copytree(build_kernel.SOURCES, tmp_path / "sources")
    )
    monkeypatch.setattr(build_kernel, "DEV", tmp_path / "caches")
    build_kernel.make_package(target, tmp_path / "made")
    made = tmp_path / "made" / f"kernel.{target.ending}"
    assert made.read_bytes() == kernels[platform]


@LONG
@pytest.mark.parametrize("platform", WITHOUT_EMBREE)
def test_zip_without_embreex_is_like_the_others(zips, contents, platform):
    """A zip for a platform without embreex differs from the
    others in its wheels alone, and lists only its kernel.
    """
    others, own = (
        [name for name in contents[which] if not name.endswith(".whl")]
        for which in ("linux_x64", platform)
    )

    assert sorted(own) == sorted(others)
    with ZipFile(zips[platform]) as archive:
        generated = tomllib.loads(archive.read("blender_manifest.toml").decode())["build"][
            "generated"
        ]

    assert generated["platforms"] == [platform.replace("_", "-")]
    assert [Path(wheel).name for wheel in generated["wheels"]] == [
        wheels.kernel_wheel(KERNELS[platform])
    ]


@each_of(ZIPS)
def test_zip_has_the_package_and_nothing_else(contents, platform):
    """A zip has the whole package, and nothing that only development needs."""
    names = set(contents[platform])
    code = [
        ROOT / "__init__.py",
        *(p for room in ROOMS for p in ROOT.glob(f"{room}/**/*.py")),
        *ROOT.glob("languages/*.po"),
        *(ROOT / "farm" / name for name in ("kiriko_bootstrap.py", "kiriko_frames.js")),
        *(ROOT / "assets" / name for name in ("kiriko_plate.blend", "blender_assets.cats.txt")),
    ]
    assert {path.relative_to(ROOT).as_posix() for path in code} <= names
    rooms = {*ROOMS, "assets", "farm", "manual", "wheels"}
    files = {"__init__.py", "blender_manifest.toml", "LICENSE"}
    assert {name for name in names if name.partition("/")[0] not in rooms} <= files
    assert {"LICENSE", "blender_manifest.toml"} <= names
    assert not [name for name in names if "__pycache__" in name or "/." in name]


@each_of(ZIPS)
def test_zip_has_the_manual(zips, platform):
    """A zip has the manual's site in each language, and it makes the zip larger by less than
    four megabytes.
    """
    with ZipFile(zips[platform]) as archive:
        own = [info for info in archive.infolist() if info.filename.startswith("manual/")]
    names = {info.filename for info in own}
    pages = [path.stem for path in (ROOT / "docs" / "manual" / "ja").glob("*.md")]
    for language in ("manual", "manual/ja"):
        assert {f"{language}/{page}.html" for page in pages} <= names
    assert sum(info.compress_size for info in own) < 4_000_000
    assert not [name for name in names if name.endswith((".map", ".md", ".gz"))]


def test_a_changed_kernel_needs_a_new_version(monkeypatch, tmp_path):
    """Blender keeps an installed wheel of the same name and version, so an update with changed
    sources would go on with the old library: the build refuses them.
    """
    compile_kernel.check_version(build_kernel.SOURCES)
    copytree(build_kernel.SOURCES, tmp_path / "sources")
    with (tmp_path / "sources" / "kiriko.h").open("a") as header:
        header.write("\n")
    with pytest.raises(SystemExit, match=r"raise the version in .*kernel/pyproject\.toml"):
        compile_kernel.check_version(tmp_path / "sources")


def test_packages_have_one_version():
    """The extension, the kernel's compiler and the packages agree on versions."""
    kernel = compile_kernel.configuration()
    optics = tomllib.loads((wheels.PACKAGES / "optics" / "pyproject.toml").read_text("utf-8"))
    extras = optics["project"]["optional-dependencies"]
    assert extras["kernel"] == [f"kiriko-kernel=={kernel['project']['version']}"]
    assert optics["project"]["version"] == MANIFEST["version"]
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {MANIFEST['version']}\n" in citation
    pins = (ROOT / "scripts" / "requirements-kernel.txt").read_text(encoding="utf-8")
    for one in (*kernel["build-system"]["requires"], *optics["build-system"]["requires"]):
        assert f"{one} " in pins


def test_bundled_embreex_is_the_tested_one():
    """The bundled wheels are of the same version of embreex as the one the tests run with."""
    pins = (ROOT / "scripts" / "requirements-test.txt").read_text(encoding="utf-8")
    tested = re.search(r"^embreex==(\S+)", pins, re.MULTILINE)[1]
    bundled = [Path(wheel).name for wheel in MANIFEST["wheels"] if "embreex" in wheel]
    assert {name.split("-")[1] for name in bundled} == {tested}


def test_changelog_has_the_version():
    """The version in the manifest has its section in the changelog."""
    assert f"## {MANIFEST['version']}\n" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
