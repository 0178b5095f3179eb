"""The developer's command: `python3 scripts/dev.py VERB`. Needs only Python.

It sets up everything else in .dev/.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from typing import NamedTuple

if sys.version_info < (3, 11):  # noqa: UP036, for Pythons that cannot run the rest
    sys.exit(
        "This is Python {}.{}, and Kiriko's scripts need 3.11 or newer: install Python 3.13 and run"
        " 'python3.13 scripts/dev.py'.".format(*sys.version_info)
    )

import build_kernel
from environments import (
    BENCH,
    FARM,
    MANUAL,
    ONE_THREAD,
    PYTHONS,
    ROOT,
    ToolError,
    as_module,
    clean_environment,
    find_python,
    newest_blender,
    python_path,
    run_in_newest_blender,
    set_up,
)
from script_help import show_options
from suite import run_suite

BLENDER = "blender"
PLAIN = "plain"  # this Python alone


class Script(NamedTuple):
    """A verb implemented by a module of scripts/, and its Python.

    place : the newest Blender, this Python, or an environment; with `FARM`, it runs in Blender, and
        the module gets the Python of this environment
    """

    module: str
    about: str
    place: str = BLENDER
    is_single: bool = False  # numpy on one thread


SCRIPTS = {
    "demo": Script("demo", "solve, render and measure the reference rigs, into out/"),
    "bench": Script("bench.solve", "seconds and memory of solves and of their stages"),
    "marks": Script("bench.marks", "time and error next to Mitsuba and the splat", BENCH),
    "benchmark": Script("bench.benchmark", "kiriko-bench, made, solved and scored", BENCH),
    "live": Script("bench.live", "updates a second of Live"),
    "extremes": Script("bench.extremes", "stiff and extreme cases: right, or refused"),
    "hashes": Script("bench.hashes", "hashes of landings, maps and source images"),
    "judge": Script("bench.judge", "optics at fifty digits, and rays at vertices and edges"),
    "irregular": Script("bench.irregular", "error of regular, uneven and noisy meshes"),
    "meant": Script("bench.meant", "error against the intended surface"),
    "ablation": Script("bench.ablation", "effect of each heuristic, switched off", is_single=True),
    "benches": Script("bench.benches", "the systems of Add Rig > More, solved and judged"),
    "light": Script("bench.light", "displays with views, pupil and colour, judged"),
    "cycles": Script("bench.cycles", "landings compared with Cycles"),
    "farm": Script("bench.farm", "warp maps, jobs and movies in other programs", FARM),
    "kernel": Script("check_kernel", "the kernel for Windows and Arm: the same bits"),
    "fuzz": Script("fuzz.run", "random rigs, broken and wild ones among them"),
    "paper": Script("paper.results", "the paper's results next to Kiriko's, into out/paper/"),
    "pictures": Script("pictures", "render the gallery and the pictures of README and docs"),
    "film": Script("film.make", "record the film of the README in the real Blender", MANUAL),
    "manual": Script("manual.run", "the manual's site, and its screenshots", MANUAL),
    "clicks": Script("manual.clicks", "count the clicks to a picture in Blender", MANUAL),
    "shown": Script("manual.shown", "Show Window compared with the exported file", MANUAL),
    "build": Script("package", "the extension's zips, one for each platform, into dist/"),
    "release": Script("release", "the files of a release and its web site, into out/release/"),
    "messages": Script("messages", "every text of the interface", PLAIN),
    "languages": Script("languages", "missing and unused translations"),
    "house": Script("house", "figures of code and words; --files: what is where", PLAIN),
}


def run_script(name: str, rest: list[str]) -> int:
    """Run the script of a verb; its exit code."""
    script = SCRIPTS[name]
    if {"-h", "--help"} & set(rest):  # answered by its parser, before anything is set up
        show_options(script.module)
    if script.place == PLAIN:
        path = ROOT / "scripts" / f"{script.module}.py"
        return subprocess.run([sys.executable, path, *rest]).returncode
    build_kernel.provide()
    variables = ONE_THREAD if script.is_single else {}
    if script.place in (BLENDER, FARM):
        if script.place == FARM:
            rest = ["--readers", str(set_up(FARM, newest_blender()[1])), *rest]
        return run_in_newest_blender(script.module, *rest, **variables)
    interpreter = set_up(script.place, newest_blender()[1])
    variables = clean_environment(PYTHONPATH=python_path(), **variables)
    command = [interpreter, *as_module(script.module), *rest]
    return subprocess.run(command, env=variables).returncode


def test(arguments: argparse.Namespace) -> None:
    """Lint, run all tests in the newest Blender and the `every_blender` tests in the older ones,
    build, install and solve from the zip.
    """
    sys.exit(
        not run_suite(
            tools=newest_blender()[0],
            prefixes=arguments.only,
            need_all=arguments.all,
            everywhere=arguments.everywhere,
        )
    )


def lint(arguments: argparse.Namespace) -> None:
    """Check the style of the code and of its words."""
    steps = ["lint", "format", "words"]
    sys.exit(not run_suite(tools=newest_blender()[0], prefixes=steps, need_all=True))


def setup(arguments: argparse.Namespace) -> None:
    """Set up every environment whose Python is found."""
    newest_blender()  # it says which Python to install when none is found
    for name, version in PYTHONS.items():
        python = find_python(version)
        print(f"{name}: {set_up(name, python) if python else f'no Python {version} was found'}")
    build_kernel.provide()


OWN = {verb.__name__: verb for verb in (test, lint, setup)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    for name, script in SCRIPTS.items():
        verbs.add_parser(name, help=script.about, add_help=False)
    for name, verb in OWN.items():
        verbs.add_parser(name, help=verb.__doc__, description=verb.__doc__)

    options = verbs.choices["test"]
    options.add_argument(
        "--all", action="store_true", help="fail when a Blender's Python is missing"
    )
    options.add_argument(
        "--everywhere",
        action="store_true",
        help="run all tests in each Blender and with each numpy, the sanitisers, and the kernels"
        " and zips of all platforms",
    )
    options.add_argument(
        "--only", nargs="+", default=[], metavar="NAME", help="steps whose names begin so"
    )
    arguments, rest = parser.parse_known_args()

    try:
        if arguments.verb in SCRIPTS:
            sys.exit(run_script(arguments.verb, rest))
        if rest:
            parser.error(f"unknown: {' '.join(rest)}")
        OWN[arguments.verb](arguments)
    except ToolError as error:
        sys.exit(str(error))
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
