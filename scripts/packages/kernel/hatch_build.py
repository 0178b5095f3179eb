"""Hatch's hook for `kiriko-kernel`: compiles the library and puts it into the wheel."""

import os
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

sys.path.insert(0, str(Path(__file__).parent))  # noqa: TID251 - a build has nothing else to import
from compile_kernel import TARGETS, check_version, compile_library, this_target

PLATFORM = "KIRIKO_KERNEL_PLATFORM"  # environment variable: the platform of the wheel, or this one


class KernelHook(BuildHookInterface):
    """Adds the library of one platform, and names the wheel after it."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile the library."""
        sources = Path(self.root, "native")
        check_version(sources)
        name = os.environ.get(PLATFORM)
        target = next((one for one in TARGETS if one.platform == name), None)
        target = target if name else this_target()
        if target is None:
            raise SystemExit("The kernel cannot be compiled for this platform: use embreex.")
        self._folder = tempfile.TemporaryDirectory()
        library = Path(self._folder.name, f"kernel.{target.ending}")
        compile_library(target, library, sources)
        build_data["force_include"][str(library)] = f"kiriko_kernel/{library.name}"
        build_data["tag"] = f"py3-none-{target.tag}"
        build_data["pure_python"] = False

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the library."""
        self._folder.cleanup()
