"""What a command line means, and what it cannot mean."""

import argparse
from pathlib import Path

from ...core.base.errors import KirikoError
from ...core.blender.data.paths import absolute

VALUES = "--values"
AS_IS = "\0"  # before a word that is no option, whatever it begins with: no command line has it


class UsageError(KirikoError):
    """The command line cannot be understood."""


# by verb: options, and the one without which they would do nothing
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
    """A file or folder, relative to the open .blend if it begins with //, as everywhere in Blender,
    else to where the command runs.
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
    """Raise UsageError where an option that was given would do nothing."""

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
