"""The steps of `dev.py test`: runs them two at a time and adds up their results.

A step is stopped only if it hangs, not because it takes long on a busy machine. It hangs if it
slept for `ASLEEP_MINUTES` or used `BUSY_MINUTES` of CPU since its last output. Tests print a dot
each, and their stack when one takes longer than `STACK_AFTER_S`, so the log of a stopped step shows
where it was.
"""

from __future__ import annotations

import heapq
import os
import signal
import subprocess
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

import build_kernel
from environments import (
    BLENDERS,
    ONE_THREAD,
    PYTHONS,
    ROOT,
    ToolError,
    clean_environment,
    find_python,
    set_up,
)

LOGS = ROOT / "out" / "test"
AT_ONCE = 2
# the slowest test takes a tenth of either
ASLEEP_MINUTES = 15.0
BUSY_MINUTES = 60.0
ASLEEP = "SZX"  # states in /proc of a thread that needs no CPU: it waits for an event, or has ended
TICK_S = 0.01  # of CPU times in /proc
STACK_AFTER_S = 300
LOOK_EVERY_S = 1.0
SLOWEST = 25  # slowest tests listed in each log
SLOWEST_OF_ALL = 8  # tests named at the end
# Number of processes for the tests of core and for those in a Blender. With few files each, two
# processes are busy to the end, and a fault that stays in memory affects few others.
CORE_PARTS = 2
BLENDER_PARTS = 4
WITHOUT_KERNEL = 1  # the part run by the oldest Blender with numpy alone
NOT_LONG = ("-m", "not long")


@dataclass(frozen=True)
class Step:
    """A command of the suite: arguments for an environment's Python, with or without the kernel."""

    name: str
    environment: str
    arguments: Sequence[str]
    after: str | None = None
    without_kernel: bool = False


@dataclass(frozen=True)
class Result:
    """The result of a step: tests of pytest, or of its one command."""

    passed: int = 0
    failed: int = 0
    skipped: int = 0
    remark: str = ""


@dataclass(frozen=True, order=True)
class Timed:
    """How long a test took in a step."""

    seconds: float
    step: str
    test: str


def steps(tools: str, newest: str, everywhere: bool = False) -> list[Step]:
    """All steps, in the order in which they start, the longest first.

    The gate runs each test once, in the newest Blender or with the newest numpy; the older versions
    run the tests marked `numpy_alone` and `every_blender`. `everywhere` runs all tests in all
    versions, and the tests marked `long` in the newest.

    tools : environment of the steps for which any Blender will do
    newest : environment of the newest Blender
    """
    slow = f"--durations={SLOWEST}", "-o", f"faulthandler_timeout={STACK_AFTER_S}"
    pytest = ("-m", "pytest", "-q", "--color=no", *slow)
    once = pytest if everywhere else (*pytest, *NOT_LONG)
    alone = NOT_LONG if everywhere else ("-m", "numpy_alone")
    package = ("scripts/package.py", *([] if everywhere else ["--here"]))
    found = [
        Step("lint", tools, ("-m", "ruff", "check", "--output-format=concise", ".")),
        Step("format", tools, ("-m", "ruff", "format", "--check", ".")),
        Step("words", tools, ("scripts/prose.py",)),
        Step("package", tools, package),
        *in_parts("core-newest-numpy", newest, once, "core", CORE_PARTS),
        *in_parts(f"blender-{short(newest)}", newest, once, "blender", BLENDER_PARTS),
        Step("core-numpy-alone", "core", (*pytest, *alone, "tests/core"), without_kernel=True),
        Step("scripts", tools, (*once, "tests/scripts")),
        Step(f"install-{short(newest)}", newest, (*once, "tests/package"), "package"),
    ]
    older = [name for name in BLENDERS if name != newest]
    return found + (more_steps(newest, older, pytest) if everywhere else smoke(older, pytest))


def smoke(blenders: Sequence[str], pytest: Sequence[str]) -> list[Step]:
    """The steps of the gate in older Blenders."""
    smoke = (*pytest, "-m", "every_blender", "tests/blender")
    return [Step(f"smoke-{short(name)}", name, smoke) for name in blenders]


def more_steps(newest: str, blenders: Sequence[str], pytest: Sequence[str]) -> list[Step]:
    """The steps outside of the gate: all tests in older versions, and checks of the kernel and the
    files on other platforms and in other programs.
    """
    older = (*pytest, *NOT_LONG)
    kernel = ("scripts/sanitise_kernel.py", *pytest, "tests/core/test_kernel.py")
    found = [
        Step("farm", newest, ("scripts/dev.py", "farm", "--only", "maps", "jobs"), "package"),
        Step("core-oldest-numpy", "core", (*older, "tests/core")),
    ]
    for name in blenders:
        parts = in_parts(f"blender-{short(name)}", name, older, "blender", BLENDER_PARTS)
        if name == blenders[-1]:
            parts[WITHOUT_KERNEL] = replace(parts[WITHOUT_KERNEL], without_kernel=True)
        found += [
            *parts,
            Step(f"install-{short(name)}", name, (*older, "tests/package"), "package"),
        ]
    return [
        *found,
        Step("kernel-elsewhere", newest, ("scripts/dev.py", "kernel")),
        Step("kernel-sanitised", newest, kernel),
    ]


def short(blender: str) -> str:
    """The version of an environment's Blender."""
    return blender.removeprefix("bpy-")


def in_parts(
    name: str, environment: str, pytest: Sequence[str], folder: str, parts: int
) -> list[Step]:
    """Steps that each run a part of the files in a folder of tests."""
    files = sorted((ROOT / "tests" / folder).glob("test_*.py"))
    names = [file.relative_to(ROOT).as_posix() for file in files]
    return [
        Step(f"{name}-{part + 1}", environment, (*pytest, *names[part::parts]))
        for part in range(parts)
    ]


def chosen(everything: Sequence[Step], prefixes: Sequence[str]) -> list[Step]:
    """Steps whose names begin with one of the prefixes (all without prefixes), with their
    prerequisites.
    """
    for prefix in prefixes:
        if not any(step.name.startswith(prefix) for step in everything):
            raise ToolError(
                f"There is no step '{prefix}': choose among"
                f" {', '.join(step.name for step in everything)}."
            )
    wanted = {
        step.name for step in everything if not prefixes or step.name.startswith(tuple(prefixes))
    }
    wanted |= {step.after for step in everything if step.name in wanted and step.after}
    return [step for step in everything if step.name in wanted]


def run_suite(
    *, tools: str, prefixes: Sequence[str], need_all: bool, everywhere: bool = False
) -> bool:
    """Set up the steps' environments, run them, print the results; whether all is well."""
    newest = next(name for name, version in BLENDERS.items() if find_python(version))
    build_kernel.provide()
    todo = chosen(steps(tools, newest, everywhere), prefixes)
    pythons: dict[str, Path] = {}
    for name in dict.fromkeys(step.environment for step in todo):
        if python := find_python(PYTHONS[name]):
            pythons[name] = python

    started = time.monotonic()
    results = run_steps([step for step in todo if step.environment in pythons], pythons)
    print_slowest([step.name for step in todo], time.monotonic() - started)
    for step in todo:
        if step.environment not in pythons:
            remark = f"no Python {PYTHONS[step.environment]} was found"
            results[step.name] = (
                Result(failed=1, remark=remark) if need_all else Result(skipped=1, remark=remark)
            )

    return print_results(results)


def run_steps(todo: Sequence[Step], pythons: dict[str, Path]) -> dict[str, Result]:
    """Results of steps by name.

    Their environments are set up one after another, in the order of the Pythons that they are made
    with. A step waits for its own alone: the first ones run while the others are installed.
    """
    LOGS.mkdir(parents=True, exist_ok=True)
    installer = ThreadPoolExecutor(1)
    pool = ThreadPoolExecutor(AT_ONCE)
    futures: dict[str, Future[Result]] = {}
    try:
        ready = {name: installer.submit(set_up, name, python) for name, python in pythons.items()}
        for step in todo:
            # The step it comes after was handed in earlier, so waiting for it always ends.
            futures[step.name] = pool.submit(
                run_when_ready, step, ready[step.environment], futures.get(step.after)
            )
        return {name: future.result() for name, future in futures.items()}
    finally:
        installer.shutdown(cancel_futures=True)
        pool.shutdown(cancel_futures=True)


def run_when_ready(step: Step, ready: Future[Path], before: Future[Result] | None) -> Result:
    """Run a step as soon as its environment is there."""
    return run_step(step, ready.result(), before)


def run_step(step: Step, interpreter: Path, before: Future[Result] | None) -> Result:
    """Run a step; its output goes to a log, which is shown when the step fails."""
    log = LOGS / f"{step.name}.log"
    report = LOGS / f"{step.name}.xml"
    report.unlink(missing_ok=True)
    if before and before.result().failed:
        return Result(failed=1, remark=f"not run, since {step.after} failed")
    counted = [f"--junit-xml={report}"] if "pytest" in step.arguments else []
    started = time.monotonic()

    with log.open("w", encoding="utf-8") as output:
        process = subprocess.Popen(
            [interpreter, *step.arguments, *counted],
            cwd=ROOT,
            env=clean_environment(
                PYTHONDONTWRITEBYTECODE="",  # two dozen steps compile the same files
                **ONE_THREAD,  # parallel steps need no second thread each
                **({"KIRIKO_KERNEL": "off"} if step.without_kernel else {}),
            ),
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
        )
        code = wait_while_it_works(process, log)

    result = count(report) if report.exists() else Result(passed=int(code == 0))
    if code is None:
        hung = (
            f"stopped: since it last printed, it slept {ASLEEP_MINUTES:g} minutes or used"
            f" {BUSY_MINUTES:g} minutes of CPU"
        )
        result = Result(result.passed, max(result.failed, 1), result.skipped, hung)
    elif code and not result.failed:
        # Blender may crash after the last test.
        result = Result(result.passed, 1, result.skipped, f"exit code {code}")

    text = log.read_text(encoding="utf-8", errors="replace")
    shown = f"{text}\n(this was {step.name})\n" if result.failed else ""
    verdict = "failed" if result.failed else "passed"
    print(f"{shown}{step.name:<20} {verdict}  {time.monotonic() - started:6.1f} s", flush=True)
    return result


def wait_while_it_works(process: subprocess.Popen[bytes], log: Path) -> int | None:
    """Exit code of a process that prints into a log; None if it hung and was stopped.

    A thread that is stopped, or waits for a CPU, does not count as asleep.
    """
    size, asleep_s, busy_s = 0, 0.0, 0.0
    before: dict[str, int] = {}
    while True:
        try:
            return process.wait(timeout=LOOK_EVERY_S)
        except subprocess.TimeoutExpired:
            now = list(threads(process.pid))

        ran_s = TICK_S * sum(ticks - before.get(thread, 0) for thread, _, ticks in now)
        before = {thread: ticks for thread, _, ticks in now}
        if log.stat().st_size != size:
            size, asleep_s, busy_s = log.stat().st_size, 0.0, 0.0
            continue
        busy_s += ran_s
        if not ran_s and all(state in ASLEEP for _, state, _ in now):
            asleep_s += LOOK_EVERY_S  # counted, since this process may be suspended, too
        if asleep_s > 60 * ASLEEP_MINUTES or busy_s > 60 * BUSY_MINUTES:
            for thread, _, _ in now:  # also its child processes
                with suppress(ProcessLookupError):
                    os.kill(int(thread), signal.SIGKILL)
            process.kill()
            process.wait()
            return None


def threads(process: int) -> Iterator[tuple[str, str, int]]:
    """The threads of a process and of its children: id, state, and CPU time in ticks. None without
    /proc.
    """
    for thread in Path(f"/proc/{process}/task").glob("*"):
        try:
            fields = (thread / "stat").read_text().rpartition(") ")[2].split()
            children = (thread / "children").read_text().split()
        except OSError:
            continue  # it ended meanwhile
        yield thread.name, fields[0], int(fields[11]) + int(fields[12])
        for child in children:
            yield from threads(int(child))


def count(report: Path) -> Result:
    """Numbers of tests in a report of pytest."""
    total = dict.fromkeys(("tests", "failures", "errors", "skipped"), 0)
    for suite in ElementTree.parse(report).iter("testsuite"):
        total = {name: number + int(suite.get(name, 0)) for name, number in total.items()}
    failed = total["failures"] + total["errors"]
    return Result(total["tests"] - failed - total["skipped"], failed, total["skipped"])


def timed(step: str) -> Iterator[Timed]:
    """The tests in a step's report of pytest, if it wrote one."""
    report = LOGS / f"{step}.xml"
    if report.exists():
        for test in ElementTree.parse(report).iter("testcase"):
            name = f"{test.get('classname', '').rpartition('.')[2]}::{test.get('name')}"
            yield Timed(float(test.get("time", 0)), step, name)


def print_slowest(names: Sequence[str], seconds: float) -> None:
    """Print the slowest tests of these steps, which took so many seconds together."""
    slowest = heapq.nlargest(SLOWEST_OF_ALL, (test for name in names for test in timed(name)))
    print(f"{seconds / 60:.1f} minutes" + (", the slowest tests:" if slowest else ""))
    for test in slowest:
        print(f"{test.seconds:8.1f} s  {test.step:<20} {test.test}")


def print_results(results: dict[str, Result]) -> bool:
    """Print the steps that were not run, and a line with the sums; returns whether nothing
    failed.
    """
    for name, result in results.items():
        if result.remark:
            print(f"{name}: {'failed' if result.failed else 'skipped'}, {result.remark}")
    passed, failed, skipped = (
        sum(getattr(r, kind) for r in results.values()) for kind in ("passed", "failed", "skipped")
    )
    print(f"{passed} passed, {failed} failed" + (f", {skipped} skipped" if skipped else ""))
    return failed == 0
