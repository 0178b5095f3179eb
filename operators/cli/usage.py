"""Values of the command line, and combinations it refuses."""

import argparse
from pathlib import Path

from ...core.base.errors import KirikoError
from ...core.blender.data.paths import absolute

VALUES = "--values"
AS_IS = "\0"  # prefix of a word that only looks like an option


class UsageError(KirikoError):
    """The command line cannot be understood."""


# By verb: options, and the option they depend on.
NEEDED = {
    "solve": {
        "--name": "--frames",
        "--placeholders": "--frames",
        "--log": "--frames",
        "--movie": "--frames",
        "--test-card": "--movie",
        "--samples": "--preview",
    },
    "calibrate": {"--samples": "--preview"},
    "atlas": {"--zip": "--job"},
    "job": {"--name": "--frames", "--chunk": "--frames"},
    "join": {"--name": "--frames"},
}


def as_is(text: str) -> str:
    """A word that may look like an option."""
    return text.removeprefix(AS_IS)


def path(text: str) -> Path:
    """A path, relative to the open .blend if it begins with //, otherwise to the working
    directory.
    """
    if not text:
        raise argparse.ArgumentTypeError("a file or folder needs a name")
    return absolute(text)


def count(text: str) -> int:
    """A whole number of 1 or more."""
    try:
        number = int(text)
    except ValueError:
        number = 0
    if number < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is no whole number of 1 or more")
    return number


def check(arguments: argparse.Namespace) -> None:
    """Raise UsageError if a given option would do nothing."""

    def is_given(option: str) -> bool:
        value = getattr(arguments, option.removeprefix("--").replace("-", "_"))
        return not any(value is absent for absent in (None, False)) and value != []

    for option, needed in NEEDED.get(arguments.verb, {}).items():
        if is_given(option) and not is_given(needed):
            raise UsageError(
                "{option} would do nothing without {needed}: add {needed}, or leave out {option}.",
                option=option,
                needed=needed,
            )
