"""Shows the `--help` of a script's own parser, without the packages needed by the script.

The script runs in the current Python up to its parser, which prints and exits. Imports other than
Python's own modules and other scripts are replaced, so nothing has to be set up to read the
options.
"""

from __future__ import annotations

import runpy
import sys
from collections.abc import Iterator, Sequence
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import ClassVar

SCRIPTS = Path(__file__).resolve().parent
NUMERIC = ("add", "sub", "mul", "matmul", "truediv", "floordiv", "mod", "pow")
OPERATORS = (*NUMERIC, *(f"r{name}" for name in NUMERIC), "and", "or", "xor", "neg", "invert")


class StandIn(ModuleType):
    """A replacement of a missing module, function, class or number; any use of it returns
    another.
    """

    __path__: Sequence[str] = ()  # it is a package, too
    __dataclass_fields__: ClassVar = {}  # and takes replace()

    def __init__(self, *arguments: object, **named: object) -> None:
        super().__init__("stand-in")

    def __getattr__(self, name: str) -> StandIn:
        if name.startswith("__"):
            raise AttributeError(name)
        return StandIn()

    def __lt__(self, other: object) -> bool:
        return False  # satisfies every bound a script checks on import

    __gt__ = __le__ = __ge__ = __lt__

    def __call__(self, *arguments: object, **named: object) -> StandIn:
        return StandIn()

    def __getitem__(self, key: object) -> StandIn:
        return StandIn()

    def __iter__(self) -> Iterator[StandIn]:
        return iter(())


for _name in OPERATORS:
    setattr(StandIn, f"__{_name}__", StandIn.__call__)


class StandInFinder:
    """Import finder and loader of replacements for modules of other packages."""

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find a replacement, or leave the module to the next finders."""
        first = name.partition(".")[0]
        here = SCRIPTS / f"{first}.py", SCRIPTS / first / "__init__.py"
        if first in sys.stdlib_module_names or any(path.exists() for path in here):
            return None
        return ModuleSpec(name, self, is_package=True)

    def create_module(self, spec: ModuleSpec) -> StandIn:
        """Make the replacement of a module."""
        return StandIn()

    def exec_module(self, module: ModuleType) -> None:
        """Run nothing: there is nothing in it."""


def show_options(script: str) -> None:
    """Print the options of a module of scripts/, by its own parser, and leave."""
    sys.meta_path.insert(0, StandInFinder())
    sys.argv = [f"{script.replace('.', '/')}.py", "--help"]
    runpy.run_module(script, run_name="__main__")
