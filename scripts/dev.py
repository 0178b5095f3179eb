"""For whoever develops Kiriko: `python3 scripts/dev.py VERB`. Needs only Python.

The rest it sets up in .dev/.
"""

from __future__ import annotations

import argparse
import subprocess
import sys

if sys.version_info < (3, 11):  # noqa: UP036, for the Pythons that cannot run the rest
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
    run,
    run_in_newest_blender,
    set_up,
)
from script_help import show_options
from suite import run_suite


def setup(arguments: argparse.Namespace) -> None:
    """Set up every environment whose Python is found."""
    newest_blender()  # it says which Python to install when none is found
    for name, version in PYTHONS.items():
        python = find_python(version)
        print(f"{name}: {set_up(name, python) if python else f'no Python {version} was found'}")
    build_kernel.provide()


def demo(arguments: argparse.Namespace) -> None:
    """Run the main job on the reference rigs, into out/ (further options go to scripts/demo.py)."""
    run_in_blender("demo", arguments.rest)


def paper(arguments: argparse.Namespace) -> None:
    """Put the paper's results beside ours, into out/paper/
    (further options go to scripts/paper/results.py).
    """
    run_in_blender("paper.results", arguments.rest)


def pictures(arguments: argparse.Namespace) -> None:
    """Render the README's pictures into docs/pictures/."""
    run_in_blender("pictures", arguments.rest)


def pipeline(arguments: argparse.Namespace) -> None:
    """Draw the pipeline and a cut pixel in it, into docs/pictures/pipeline.svg."""
    run_with_tests("drawing.pipeline", arguments.rest)


def fuzz(arguments: argparse.Namespace) -> None:
    """Try random rigs, broken and wild ones among them
    (further options go to scripts/fuzz/run.py).
    """
    run_in_blender("fuzz.run", arguments.rest)


def run_in_blender(script: str, rest: list[str]) -> None:
    """Run a module of scripts/ in the newest Blender, and leave with its exit code."""
    answer_help(script, rest)
    build_kernel.provide()
    sys.exit(run_in_newest_blender(script, *rest))


def run_plainly(script: str, rest: list[str]) -> None:
    """Run a script beside this one that needs only Python, and leave with its exit code."""
    answer_help(script, rest)
    path = ROOT / "scripts" / f"{script}.py"
    sys.exit(subprocess.run([sys.executable, path, *rest], check=False).returncode)


def bench(arguments: argparse.Namespace) -> None:
    """Measure seconds and memory of solves and of their parts
    (further options go to scripts/bench/solve.py).
    """
    run_with_tests("bench.solve", arguments.rest)


def compare(arguments: argparse.Namespace) -> None:
    """Measure Kiriko beside Mitsuba and the splat (further
    options go to scripts/bench/side_by_side.py).
    """
    run_with_tests("bench.side_by_side", arguments.rest, BENCH, **ONE_THREAD)


def surface(arguments: argparse.Namespace) -> None:
    """Measure the error of meshes against closed forms
    (further options go to scripts/bench/surface.py).
    """
    run_with_tests("bench.surface", arguments.rest)


def irregular(arguments: argparse.Namespace) -> None:
    """Measure what each choice of Surface makes of
    irregular and noisy meshes, against closed forms.
    """
    run_in_blender("bench.irregular", arguments.rest)


def meant(arguments: argparse.Namespace) -> None:
    """Measure what each choice of Surface makes of glass as artists bring it, against the
    surface that was meant.
    """
    run_in_blender("bench.meant", arguments.rest)


def glasses(arguments: argparse.Namespace) -> None:
    """Measure solves through glass as artists bring it
    (further options go to scripts/bench/glasses.py).
    """
    run_in_blender("bench.glasses", arguments.rest)


def placement(arguments: argparse.Namespace) -> None:
    """Tell where Add Rig stands the picture in glass as artists bring it, and how much arrives
    (further options go to scripts/bench/placement.py).
    """
    run_in_blender("bench.placement", arguments.rest)


def marks(arguments: argparse.Namespace) -> None:
    """Measure Kiriko beside Mitsuba on glass as artists bring it
    (further options go to scripts/bench/marks.py).
    """
    run_with_tests("bench.marks", arguments.rest, BENCH)


def ablation(arguments: argparse.Namespace) -> None:
    """Measure the effect of each heuristic and option, switched off one at a time
    (further options go to scripts/bench/ablation.py).
    """
    run_with_tests("bench.ablation", arguments.rest, **ONE_THREAD)


def cycles(arguments: argparse.Namespace) -> None:
    """Measure landings beside Cycles on glass as artists bring it
    (further options go to scripts/bench/cycles.py).
    """
    run_in_blender("bench.cycles", arguments.rest)


def curved(arguments: argparse.Namespace) -> None:
    """Measure what curved faces cost a ray."""
    run_with_tests("bench.curved", arguments.rest)


def growth(arguments: argparse.Namespace) -> None:
    """Measure how time and rays grow with pixels, triangles and viewers
    (further options go to scripts/bench/growth.py).
    """
    run_with_tests("bench.growth", arguments.rest)


def eyes(arguments: argparse.Namespace) -> None:
    """Measure what several viewers of one display see, and cost
    (further options go to scripts/bench/eyes.py).
    """
    run_with_tests("bench.eyes", arguments.rest)


def rules(arguments: argparse.Namespace) -> None:
    """Measure what is saved by what the plan leaves out."""
    run_with_tests("bench.rules", arguments.rest)


def plate(arguments: argparse.Namespace) -> None:
    """Measure the closed form of the mirror array against a
    mesh (further options go to scripts/bench/plate.py).
    """
    run_with_tests("bench.plate", arguments.rest, **ONE_THREAD)


def misalignment(arguments: argparse.Namespace) -> None:
    """Measure what a bench that is off does to the picture
    (further options go to scripts/bench/misalignment.py).
    """
    run_with_tests("bench.misalignment", arguments.rest)


def extremes(arguments: argparse.Namespace) -> None:
    """Check stiff and extreme cases: right, or refused with a
    reason (further options go to scripts/bench/extremes.py).
    """
    run_in_blender("bench.extremes", arguments.rest)


def hashes(arguments: argparse.Namespace) -> None:
    """Print hashes of landings, maps and source images, to compare before and after a change."""
    run_in_blender("bench.hashes", arguments.rest)


def judge(arguments: argparse.Namespace) -> None:
    """Judge optics and tracer at fifty digits, and look for leaks
    (further options go to scripts/bench/judge.py).
    """
    run_with_tests("bench.judge", arguments.rest)


def live(arguments: argparse.Namespace) -> None:
    """Measure updates a second of Live (further options go to scripts/bench/live.py)."""
    run_in_blender("bench.live", arguments.rest)


def frames(arguments: argparse.Namespace) -> None:
    """Measure frames a second of a picture that moves (further options go to
    scripts/bench/frames.py).
    """
    run_in_blender("bench.frames", arguments.rest)


def lab(arguments: argparse.Namespace) -> None:
    """Measure the plate as a lab would: image distance, sharpness,
    brightness (options go to scripts/bench/lab.py).
    """
    run_in_blender("bench.lab", arguments.rest)


def manual(arguments: argparse.Namespace) -> None:
    """Build the manual's site into manual/; with --screenshots take
    its pictures anew (further options go to scripts/manual/run.py).
    """
    run_with_tests("manual.run", arguments.rest, MANUAL)


def clicks(arguments: argparse.Namespace) -> None:
    """Count clicks from glass to a picture seen and exported, in the real
    Blender (further options go to scripts/manual/clicks.py).
    """
    run_with_tests("manual.clicks", arguments.rest, MANUAL)


def shown(arguments: argparse.Namespace) -> None:
    """Compare Show Window with the source image's file, pixel for pixel, in the
    real Blender (further options go to scripts/manual/shown.py).
    """
    run_with_tests("manual.shown", arguments.rest, MANUAL)


def farm(arguments: argparse.Namespace) -> None:
    """Prove that other programs make of the files for shows what
    Kiriko means (further options go to scripts/bench/farm.py).
    """
    run_beside("bench.farm", FARM, arguments.rest)


def atlas(arguments: argparse.Namespace) -> None:
    """Compare heads at random places of an atlas with direct solves
    (further options go to scripts/bench/atlas.py).
    """
    run_in_blender("bench.atlas", arguments.rest)


def run_beside(script: str, environment: str, rest: list[str]) -> None:
    """Run a module of scripts/ in the newest Blender, told of another environment's Python."""
    answer_help(script, rest)
    build_kernel.provide()
    readers = set_up(environment, newest_blender()[1])
    sys.exit(run_in_newest_blender(script, "--readers", readers, *rest))


def run_with_tests(
    script: str, rest: list[str], environment: str | None = None, **extra: str
) -> None:
    """Run a module of scripts/ in an environment, and leave with its exit code."""
    answer_help(script, rest)
    build_kernel.provide()
    newest, python = newest_blender()
    interpreter = set_up(environment or newest, python)
    variables = clean_environment(PYTHONPATH=python_path(), **extra)
    sys.exit(subprocess.run([interpreter, *as_module(script), *rest], env=variables).returncode)


def kernel(arguments: argparse.Namespace) -> None:
    """Run the kernel's libraries for Windows and Arm here: the
    same bits (options go to scripts/check_kernel.py).
    """
    run_with_tests("check_kernel", arguments.rest)


def answer_help(script: str, rest: list[str]) -> None:
    """Let the script's own parser answer, where help is asked for, before anything is set up."""
    if {"-h", "--help"} & set(rest):
        show_options(script)


def test(arguments: argparse.Namespace) -> None:
    """Lint, run each test in the newest Blender and a smoke file in the older
    ones, build, install and solve from the zip.
    """
    sys.exit(
        not run_suite(
            tools=newest_blender()[0],
            prefixes=arguments.only,
            need_all=arguments.all,
            everywhere=arguments.everywhere,
        )
    )


def messages(arguments: argparse.Namespace) -> None:
    """Print every sentence that people read, with sample values
    (further options go to scripts/messages.py).
    """
    run_plainly("messages", arguments.rest)


def languages(arguments: argparse.Namespace) -> None:
    """Print the texts that languages of the interface lack
    (further options go to scripts/languages.py).
    """
    run_in_blender("languages", arguments.rest)


def lint(arguments: argparse.Namespace) -> None:
    """Check the code's style."""
    sys.exit(not run_suite(tools=newest_blender()[0], prefixes=["lint", "format"], need_all=True))


def house(arguments: argparse.Namespace) -> None:
    """Measure how the house is kept (further options go to scripts/house.py)."""
    run_alone("house", arguments.rest)


def run_alone(script: str, rest: list[str]) -> None:
    """Run a module of scripts/ that needs only Python, and leave with its exit code."""
    answer_help(script, rest)
    sys.exit(subprocess.run([sys.executable, ROOT / "scripts" / f"{script}.py", *rest]).returncode)


def build(arguments: argparse.Namespace) -> None:
    """Build the extension's zips, one for each platform, into dist/."""
    run([set_up(*newest_blender()), ROOT / "scripts" / "package.py"])


# verbs whose options are read here; the others hand theirs on to a script
OWN = test, lint, build, setup


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    for verb in (
        demo,
        test,
        bench,
        compare,
        curved,
        growth,
        eyes,
        rules,
        plate,
        misalignment,
        extremes,
        hashes,
        judge,
        live,
        frames,
        lab,
        surface,
        irregular,
        meant,
        glasses,
        placement,
        marks,
        ablation,
        cycles,
        farm,
        atlas,
        kernel,
        fuzz,
        paper,
        pictures,
        pipeline,
        manual,
        clicks,
        shown,
        messages,
        languages,
        lint,
        house,
        build,
        setup,
    ):
        is_own = verb in OWN
        said = verb.__doc__ if is_own else None
        verbs.add_parser(
            verb.__name__, help=verb.__doc__, description=said, add_help=is_own
        ).set_defaults(call=verb)

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
    if rest and arguments.call in OWN:
        parser.error(f"unknown: {' '.join(rest)}")
    arguments.rest = rest

    try:
        arguments.call(arguments)
    except ToolError as error:
        sys.exit(str(error))
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
