"""Builds the packages that pip installs: `kiriko-kernel`, the compiled kernel, and `kiriko-optics`,
core without Blender.

Each is copied into a folder as its source distribution has it, and hatch packs it there.
"""

from __future__ import annotations

import shutil
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from build_kernel import MODULE, SOURCES, TARGETS, Target, compiler
from environments import DEV, ROOT, run
from packages.kernel.compile_kernel import check_version

PACKAGES = ROOT / "scripts" / "packages"
WHEELS = ROOT / "wheels"
EPOCH = "315532800"  # 1980, the earliest date in a zip: wheels of the same sources are identical
# parts of core that need Blender or belong to the other package
UNPACKED = shutil.ignore_patterns("__pycache__", "mkdocs.yml", "tables.py")
NOT_IN_OPTICS = shutil.ignore_patterns("__pycache__", "blender", "*.c", "*.h")


@contextmanager
def staged(name: str) -> Iterator[Path]:
    """Folder of a package: its source distribution, unpacked."""
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made, name)
        shutil.copytree(PACKAGES / name, folder, ignore=UNPACKED)
        shutil.copy(ROOT / "LICENSE", folder)
        if name == "kernel":
            check_version(SOURCES)
            (folder / "native").mkdir()
            for path in sorted(SOURCES.glob("*.[ch]")):
                shutil.copy(path, folder / "native")
        else:
            shutil.copytree(ROOT / "core", folder / "kiriko_optics" / "_core", ignore=NOT_IN_OPTICS)
            shutil.copytree(ROOT / "examples", folder / "examples")
        yield folder


def make(name: str, *kinds: str, into: Path = WHEELS, target: Target | None = None) -> None:
    """Build files of a package: `--wheel`, `--sdist`, or both."""
    into.mkdir(parents=True, exist_ok=True)
    variables = {name: str(DEV / "zig") for name in ("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR")}
    if target is not None:
        variables["KIRIKO_KERNEL_PLATFORM"] = target.platform
    with staged(name) as folder:
        command = [compiler(), "-m", "build", "--no-isolation", *kinds, "--outdir", into, folder]
        run(command, SOURCE_DATE_EPOCH=EPOCH, **variables)


def make_kernels(targets: Sequence[Target] = TARGETS, into: Path = WHEELS) -> None:
    """Build the kernel's wheel for each of some platforms."""
    for old in into.glob(f"{MODULE}-*.whl"):
        old.unlink()
    for target in targets:
        make("kernel", "--wheel", into=into, target=target)


def kernel_wheel(target: Target) -> str:
    """File name of the kernel's wheel for a platform."""
    project = tomllib.loads((PACKAGES / "kernel" / "pyproject.toml").read_text(encoding="utf-8"))
    return f"{MODULE}-{project['project']['version']}-py3-none-{target.tag}.whl"
