"""Which small mutants of core does no test notice? `python3
scripts/dev.py mutants [--number 100] [--minutes 60]`.

Mutants are drawn over the files of core (without blender) by their lines, and tried in a copy of
the checkout: the checkout itself is never changed. A first run of the tests tells which of them run
which line; a mutant is shown to the tests that run its line, the likeliest and quickest first,
until one fails or --budget seconds of them have passed. All verdicts are kept in out/mutants, so
that a run that was stopped goes on where it was. Survivors that are meant to survive stand in
tests/mutants.toml with a reason. Exits with 1 when there are others.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import json
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from itertools import accumulate
from pathlib import Path
from time import monotonic

from environments import ONE_THREAD, ROOT, ToolError, clean_environment

from .mutations import Mutant, draw, mutants_of

OUT = ROOT / "out" / "mutants"
ACCEPTED = ROOT / "tests" / "mutants.toml"
TESTS = "tests/core"
KNOWN = "tests/known"
TOP = "tests/conftest.py", "pyproject.toml", "__init__.py", "blender_manifest.toml"
NEEDED = "core", "scripts", "docs", TESTS, KNOWN, *TOP
PYTEST = ("-m", "pytest", "-q", "--color=no", "-p", "no:cacheprovider")
KILLED = "killed"
SURVIVED = "survived"
HUNG = "hung"
PATIENCE = 5.0  # times the seconds of the tests without a mutant: longer is a hang
AT_LEAST_S = 60.0


@dataclass(frozen=True)
class Verdict:
    """The fate of a mutant: killed by a test, hung in it, or survived.

    Core and tests as they were, as digests.
    """

    name: str
    verdict: str
    by: str
    seconds: float
    source: str
    everything: str


@dataclass(frozen=True)
class Reach:
    """Which tests run which lines: seconds by test, tests by file of core and line."""

    seconds: dict[str, float]
    tests: dict[str, dict[int, list[str]]]

    def of(self, mutant: Mutant, sources: dict[str, str]) -> list[str]:
        """Tests that run a mutant's line: those in the file of its name first, then the
        quickest.
        """
        lines = self.tests.get(mutant.file, {})
        found = set(lines.get(mutant.line, ()))
        if not found:
            # it is run when core is imported: those are asked that
            # run a line in which the name is used
            for file, line in uses(assigned(sources[mutant.file], mutant.line), sources):
                found |= set(self.tests.get(file, {}).get(line, ()))
        if not found:
            found = {test for some in lines.values() for test in some}
        own = f"{TESTS}/test_{Path(mutant.file).name}::"
        return sorted(found, key=lambda test: (not test.startswith(own), self.seconds[test], test))

    def within(self, tests: list[str], budget: float) -> list[str]:
        """The first of some tests, at least one, that together take no longer than a budget, s."""
        ends = accumulate(self.seconds[test] for test in tests)
        return tests[: max(1, sum(end <= budget for end in ends))]

    def seconds_of(self, tests: list[str]) -> float:
        """How long some tests take."""
        return sum(self.seconds[test] for test in tests)


def assigned(source: str, line: int) -> set[str]:
    """Names that the statement on a line assigns."""
    stores = (ast.Name, ast.Attribute)
    return {
        getattr(node, "id", None) or getattr(node, "attr", "")
        for statement in ast.walk(ast.parse(source))
        if isinstance(statement, ast.Assign | ast.AnnAssign) and statement.lineno == line
        for node in ast.walk(statement)
        if isinstance(node, stores) and isinstance(node.ctx, ast.Store)
    }


def uses(names: set[str], sources: dict[str, str]) -> Iterator[tuple[str, int]]:
    """File and line of each statement in which one of the names stands."""
    for file, source in sources.items():
        for statement in ast.walk(ast.parse(source)):
            if isinstance(statement, ast.stmt) and not isinstance(
                statement, ast.FunctionDef | ast.ClassDef
            ):
                inside = {
                    getattr(node, "id", None) or getattr(node, "attr", None)
                    for node in ast.walk(statement)
                }
                if names & inside:
                    yield file, statement.lineno


def digest(folder: Path, patterns: Sequence[str]) -> str:
    """Of the names and contents of files."""
    total = hashlib.sha256()
    for path in sorted(path for pattern in patterns for path in folder.glob(pattern)):
        total.update(
            f"{path.relative_to(folder)} {hashlib.sha256(path.read_bytes()).hexdigest()}\n".encode()
        )
    return total.hexdigest()


def read_core() -> dict[str, str]:
    """Texts of the files of core that need no Blender, by their place in core."""
    core = ROOT / "core"
    files = sorted(
        path
        for path in core.rglob("*.py")
        if path.relative_to(core).parts[0] not in {"blender", "kernel"}
    )
    return {path.relative_to(core).as_posix(): path.read_text(encoding="utf-8") for path in files}


@contextmanager
def copied() -> Iterator[Path]:
    """A copy of the checkout, as far as tests of core need it."""
    with tempfile.TemporaryDirectory(prefix="kiriko-mutants-") as folder:
        for name in NEEDED:
            source = ROOT / name
            target = Path(folder, name)
            target.parent.mkdir(parents=True, exist_ok=True)
            if source.is_dir():
                shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy2(source, target)
        yield Path(folder)


def run(tree: Path, command: Sequence[str], log: Path, seconds: float | None = None) -> int | None:
    """Exit code of this Python with arguments, in a copy; None where it takes longer."""
    # bytecode is found by a file's second and size, and a
    # mutant may have both of the file it stands for
    variables = clean_environment(
        PYTHONDONTWRITEBYTECODE="1", KIRIKO_REACH=str(OUT), KIRIKO_KERNEL="off", **ONE_THREAD
    )
    with log.open("w", encoding="utf-8") as output:
        try:
            return subprocess.run(
                [sys.executable, *command],
                cwd=tree,
                env=variables,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                timeout=seconds,
            ).returncode
        except subprocess.TimeoutExpired:
            return None


def find_reach(tree: Path, everything: str) -> Reach:
    """Which tests run which lines: from out/mutants where it is
    of this core and these tests, else from a run.
    """
    path = OUT / "reach.json"
    data = OUT / "coverage.sqlite"
    if path.exists():
        kept = json.loads(path.read_text(encoding="utf-8"))
        if kept["everything"] == everything:
            tests = {
                file: {int(line): t for line, t in lines.items()}
                for file, lines in kept["tests"].items()
            }
            return Reach(kept["seconds"], tests)

    print(
        "Which test runs which line: the tests of core once, which takes some minutes ...",
        flush=True,
    )
    coverage = (
        "-m",
        "coverage",
        "run",
        f"--data-file={data}",
        f"--include={tree.resolve()}/core/*,*/kiriko/core/*",
    )
    data.unlink(missing_ok=True)
    log = OUT / "reach.log"
    if run(tree, (*coverage, *PYTEST, "-p", "mutants.reach", TESTS), log):
        raise ToolError(f"The tests fail without any mutant: see {log}.")
    noted = json.loads((OUT / "tests.json").read_text(encoding="utf-8"))
    reach = Reach(noted["seconds"], read_coverage(data))
    text = json.dumps({"everything": everything, "seconds": reach.seconds, "tests": reach.tests})
    path.write_text(text, encoding="utf-8")

    return reach


def read_coverage(path: Path) -> dict[str, dict[int, list[str]]]:
    """Tests by file and line."""
    from coverage import CoverageData  # only where mutants are tried

    data = CoverageData(str(path))
    data.read()
    found = {}
    for file in data.measured_files():
        lines = data.contexts_by_lineno(file).items()
        found[file.rpartition("/core/")[2]] = {
            line: tests for line, some in lines if (tests := [test for test in some if test])
        }
    return found


def try_mutant(
    tree: Path, mutant: Mutant, source: str, tests: list[str], seconds: float
) -> tuple[str, str]:
    """Verdict on a mutant, and the test that killed it."""
    if not tests:
        return SURVIVED, "no test runs it"
    path = tree / "core" / mutant.file
    log = OUT / "mutant.log"
    path.write_text(mutant.put_into(source), encoding="utf-8")

    try:
        code = run(tree, (*PYTEST, "-x", *tests), log, seconds)
    finally:
        path.write_text(source, encoding="utf-8")

    if code is None:
        return HUNG, f"after {seconds:.0f} s"
    failed = re.search(
        r"^(?:FAILED|ERROR) (.+?)(?: -"
        r" |$)",
        log.read_text(encoding="utf-8"),
        re.MULTILINE,
    )

    return (KILLED, failed[1] if failed else f"exit code {code}") if code else (SURVIVED, "")


def read_verdicts() -> dict[str, Verdict]:
    """The last verdict on each mutant that was tried, by name."""
    path = OUT / "verdicts.jsonl"
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return {entry["name"]: Verdict(**entry) for entry in map(json.loads, lines)}


def still_holds(kept: Verdict | None, source: str, everything: str) -> bool:
    """Need a mutant not be tried again? One that was
    killed holds as long as its file stays the same.
    """
    if kept is None:
        return False
    return kept.source == source if kept.verdict != SURVIVED else kept.everything == everything


def accepted() -> dict[str, str]:
    """Reasons of mutants that may survive, by name."""
    entries = tomllib.loads(ACCEPTED.read_text(encoding="utf-8")).get("accepted", [])
    return {entry["mutant"]: entry["reason"] for entry in entries}


def report(drawn: Sequence[Mutant], verdicts: dict[str, Verdict], sources: dict[str, str]) -> bool:
    """Print the fates of the mutants; whether each that was tried was killed or may survive."""
    reasons = accepted()
    tried = [mutant for mutant in drawn if mutant.name in verdicts]
    survivors = [mutant for mutant in tried if verdicts[mutant.name].verdict == SURVIVED]
    unknown = [mutant for mutant in survivors if mutant.name not in reasons]

    for mutant in survivors:
        line = sources[mutant.file].splitlines()[mutant.line - 1].strip()
        print(f"\ncore/{mutant.file}:{mutant.line}  {line}\n  {mutant.name}")
        print(f"  {reasons.get(mutant.name) or verdicts[mutant.name].by or 'SURVIVED'}")

    counts = {
        word: sum(verdicts[m.name].verdict == word for m in tried)
        for word in (KILLED, HUNG, SURVIVED)
    }
    counted = ", ".join(f"{count} {word}" for word, count in counts.items())
    print(
        f"\n{len(tried)} of {len(drawn)} mutants tried: {counted}, {len(unknown)} of these"
        f" without a reason"
    )

    return not unknown


def try_all(
    drawn: Sequence[Mutant],
    sources: dict[str, str],
    verdicts: dict[str, Verdict],
    minutes: float,
    budget: float,
) -> None:
    """Try the mutants on which there is no verdict that holds, as long as there is time.

    Verdicts are added.
    """
    ends = monotonic() + 60 * minutes
    known = f"{TESTS}/*.py", f"{KNOWN}/**/*.py", "tests/conftest.py"
    everything = digest(ROOT, ("core/**/*.py", *known, "scripts/**/*.py"))
    with copied() as tree:
        reach = find_reach(tree, everything)
        for k, mutant in enumerate(drawn, 1):
            source = hashlib.sha256(sources[mutant.file].encode()).hexdigest()
            if still_holds(verdicts.get(mutant.name), source, everything):
                continue

            asked = reach.of(mutant, sources)
            begun = monotonic()
            tests = reach.within(asked, budget)
            hangs_after = AT_LEAST_S + PATIENCE * reach.seconds_of(tests)
            left = ends - begun
            seconds = min(hangs_after, left)
            found = (
                try_mutant(tree, mutant, sources[mutant.file], tests, seconds)
                if left > 0
                else (HUNG, "")
            )
            if found[0] == HUNG and left < hangs_after:
                print(f"{minutes:g} minutes are over: the same command goes on from here.")
                return

            if found == (SURVIVED, ""):
                found = (
                    SURVIVED,
                    f"SURVIVED {len(tests)} of the {len(asked)} tests that run its line",
                )
            verdict = Verdict(mutant.name, *found, monotonic() - begun, source, everything)
            verdicts[mutant.name] = verdict
            with (OUT / "verdicts.jsonl").open("a", encoding="utf-8") as kept:
                kept.write(json.dumps(asdict(verdict)) + "\n")
            print(
                f"{k:4d} {verdict.verdict:<8} {verdict.seconds:6.1f} s  {mutant.name}", flush=True
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--number", type=int, default=100, help="of mutants (100)")
    parser.add_argument("--seed", type=int, default=0, help="of the draw (0)")
    parser.add_argument(
        "--minutes",
        type=float,
        default=60.0,
        help="to try mutants in; the same command goes on (60)",
    )
    parser.add_argument(
        "--budget", type=float, default=120.0, help="of tests a mutant is shown to, s (120)"
    )
    parser.add_argument(
        "--only", nargs="+", default=[""], metavar="NAME", help="files with this in their names"
    )
    parser.add_argument("--list", action="store_true", help="only say which mutants are drawn")
    options = parser.parse_args()

    sources = read_core()
    chosen = {
        file: text for file, text in sources.items() if any(some in file for some in options.only)
    }
    lines = {file: len(text.splitlines()) for file, text in chosen.items()}
    drawn = draw(
        {file: mutants_of(file, text) for file, text in chosen.items()},
        lines,
        options.number,
        options.seed,
    )
    if options.list:
        print("\n".join(f"{mutant.line:5d} {mutant.name}" for mutant in drawn))
        return

    OUT.mkdir(parents=True, exist_ok=True)
    verdicts = read_verdicts()
    try:
        try_all(drawn, sources, verdicts, options.minutes, options.budget)
    except ToolError as error:
        sys.exit(str(error))

    sys.exit(not report(drawn, verdicts, sources))


if __name__ == "__main__":
    main()
