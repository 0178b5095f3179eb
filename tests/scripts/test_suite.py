import re
import sys
import time
from concurrent.futures import Future
from itertools import pairwise
from pathlib import Path

import pytest

import suite
from environments import ToolError

ASLEEP_S = 1.0
BUSY_S = 3.0
SLEEPS = "import os, time\nprint('begun', os.getpid(), flush=True)\ntime.sleep(600)\n"
CHILD_SLEEPS = f"import subprocess, sys\nsubprocess.run([sys.executable, '-c', {SLEEPS!r}])\n"
POLLS = "import time\nwhile True:\n    time.sleep(0.05)\n"
LOOPS = "while True:\n    pass\n"
WORKS = "import time\nwhile time.process_time() < 1.5:\n    pass\n"
CHILD_WORKS = f"import subprocess, sys\nsubprocess.run([sys.executable, '-c', {WORKS!r}])\n"
TALKS = "import time\nfor k in range(5):\n    print(k, flush=True)\n    time.sleep(0.5)\n"
# it stops itself, as Ctrl Z does, and a child that sleeps wakes it up
STOPPED = """
import os, signal, subprocess, sys
wake = "import os, signal, time; time.sleep(2); os.kill(os.getppid(), signal.SIGCONT)"
subprocess.Popen([sys.executable, "-c", wake])
os.kill(os.getpid(), signal.SIGSTOP)
"""
HAS_PROC = pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs Linux's /proc")


@pytest.fixture(autouse=True)
def logs(tmp_path, monkeypatch) -> Path:
    """Logs apart from the suite's own, which may be under way, and hangs of seconds."""
    monkeypatch.setattr(suite, "LOGS", tmp_path)
    monkeypatch.setattr(suite, "ASLEEP_MINUTES", ASLEEP_S / 60)
    monkeypatch.setattr(suite, "BUSY_MINUTES", BUSY_S / 60)
    monkeypatch.setattr(suite, "LOOK_EVERY_S", 0.1)
    return tmp_path


def run(code: str, name: str = "step") -> suite.Result:
    return suite.run_step(suite.Step(name, "any", ("-c", code)), Path(sys.executable), None)


@pytest.mark.parametrize(
    "code",
    [
        TALKS,
        pytest.param(WORKS, marks=HAS_PROC),
        pytest.param(CHILD_WORKS, marks=HAS_PROC),
        pytest.param(STOPPED, marks=HAS_PROC),
    ],
    ids=["talks", "works", "child works", "stopped"],
)
def test_a_step_that_works_or_is_held_up_is_no_hang(code):
    """More than the time of a hang may pass if a step prints, computes in silence, itself or in a
    child, or is suspended.
    """
    started = time.monotonic()
    assert run(code) == suite.Result(passed=1)
    assert time.monotonic() - started > ASLEEP_S


@pytest.mark.parametrize(
    "code",
    [SLEEPS, CHILD_SLEEPS, POLLS, pytest.param(LOOPS, marks=HAS_PROC)],
    ids=["sleeps", "child sleeps", "polls", "loops"],
)
def test_a_step_that_hangs_is_stopped_and_says_so(code, capsys):
    """A step that sleeps, looks again and again for what never comes, or loops without end is
    stopped with all that it started, fails and shows its output.
    """
    result = run(code)
    assert result.failed == 1
    assert "stopped: since it last printed" in result.remark
    begun = re.search(r"begun (\d+)", capsys.readouterr().out)
    assert bool(begun) == ("begun" in code)
    ended = time.monotonic() + 60
    while begun and Path("/proc", begun[1]).exists():  # until its parent has heard of its end
        assert time.monotonic() < ended


def test_a_test_that_hangs_is_named_by_its_stack(logs, monkeypatch):
    """The log of a step of pytest that was stopped shows the function in which it stood."""
    monkeypatch.setattr(suite, "STACK_AFTER_S", 0.5)
    hanging = logs / "test_hanging.py"
    hanging.write_text("import time\n\n\ndef test_that_hangs():\n    time.sleep(600)\n")
    step = next(step for step in suite.steps("any", "any") if step.name == "scripts")
    suite.run_step(
        suite.Step("step", "any", (*step.arguments[:-1], str(hanging))), Path(sys.executable), None
    )
    assert "in test_that_hangs" in (logs / "step.log").read_text()


def test_steps_wait_for_their_own_environment_alone(monkeypatch):
    """An environment is installed while steps of the one before run: here until one has run."""
    first_ran: Future[None] = Future()
    told = []

    def set_up(name: str, python: Path) -> Path:
        if name == "slow":
            first_ran.result(timeout=60)
        told.append(f"{name} is there")
        return python

    def run_step(step: suite.Step, interpreter: Path, before: Future | None) -> suite.Result:
        told.append(f"{step.name} by {interpreter}")
        if step.name == "first":
            first_ran.set_result(None)
        return suite.Result(passed=1)

    monkeypatch.setattr(suite, "set_up", set_up)
    monkeypatch.setattr(suite, "run_step", run_step)
    steps = [suite.Step("first", "quick", ()), suite.Step("second", "slow", ())]
    results = suite.run_steps(steps, {"quick": Path("one"), "slow": Path("two")})
    assert results == dict.fromkeys(("first", "second"), suite.Result(passed=1))
    assert told == ["quick is there", "first by one", "slow is there", "second by two"]


def test_an_environment_that_cannot_be_set_up_ends_the_suite(monkeypatch):
    """With its own sentence, and without the steps that were not begun."""

    def set_up(name: str, python: Path) -> Path:
        raise ToolError("There is no network.")

    monkeypatch.setattr(suite, "set_up", set_up)
    with pytest.raises(ToolError, match="no network"):
        suite.run_steps([suite.Step("step", "any", ())], {"any": Path("one")})


def files_of(folder: str, everywhere: bool) -> dict[tuple[str, bool, str], list[str]]:
    """The files in a folder of tests that steps run, by environment, kernel or none, and marks."""
    found: dict[tuple[str, bool, str], list[str]] = {}
    for step in suite.steps("any", next(iter(suite.BLENDERS)), everywhere):
        words = [word for word in step.arguments if word.startswith(f"tests/{folder}")]
        if "scripts/sanitise_kernel.py" not in step.arguments and words:
            marks = [m for m, after in pairwise(step.arguments[::-1]) if after == "-m"]
            key = step.environment, step.without_kernel, next(iter(marks), "")
            found.setdefault(key, []).extend(words)
    return {key: sorted(words) for key, words in found.items()}


def all_files(folder: str) -> list[str]:
    found = (suite.ROOT / "tests" / folder).rglob("test_*.py")
    return sorted(file.relative_to(suite.ROOT).as_posix() for file in found)


def test_the_gate_runs_each_test_once_in_the_newest_versions():
    """All files in the newest Blender, with its numpy and the kernel. Older ones, and numpy alone,
    run the cases that are marked for them.
    """
    newest, *older = suite.BLENDERS
    assert files_of("core", everywhere=False) == {
        (newest, False, "not long"): all_files("core"),
        ("core", True, "numpy_alone"): ["tests/core"],
    }
    assert files_of("blender", everywhere=False) == {
        (newest, False, "not long"): all_files("blender"),
        **{(name, False, "every_blender"): ["tests/blender"] for name in older},
    }
    assert files_of("package", everywhere=False) == {(newest, False, "not long"): ["tests/package"]}


def test_everywhere_runs_all_tests_in_all_versions():
    """Each Blender runs each file once, the oldest one part of them without the kernel; both numpys
    run all of core, the oldest with the kernel and without. Tests marked `long` run once.
    """
    newest, between, oldest = suite.BLENDERS
    found = files_of("blender", everywhere=True)
    assert found[newest, False, "pytest"] == all_files("blender")
    assert found[between, False, "not long"] == all_files("blender")
    alone = found[oldest, True, "not long"]
    assert sorted(found[oldest, False, "not long"] + alone) == all_files("blender")
    assert alone
    assert files_of("core", everywhere=True) == {
        (newest, False, "pytest"): all_files("core"),
        ("core", False, "not long"): ["tests/core"],
        ("core", True, "not long"): ["tests/core"],
    }
    names = {step.name for step in suite.steps("any", newest, everywhere=True)}
    assert names >= {"farm", "kernel-elsewhere", "kernel-sanitised", "install-4.2.23"}


def test_steps_have_one_thread_for_linear_algebra(logs):
    """Two steps run at once, so neither gives numpy's BLAS a second thread."""
    run("import os; print(os.environ['OPENBLAS_NUM_THREADS'], os.environ['OMP_NUM_THREADS'])")
    assert (logs / "step.log").read_text().split() == ["1", "1"]


def test_the_slowest_tests_of_all_steps_are_named(logs, capsys):
    """The tests that took longest are printed with their
    steps, the slowest first, whatever step they are of.
    """
    cases = '<testcase classname="tests.core.test_{0}" name="test_{0}" time="{1}"/>'
    for name, seconds in (("quick", (1, 3)), ("slow", (2, 4))):
        inside = "".join(cases.format(f"{name}_{s}", s) for s in seconds)
        (logs / f"{name}.xml").write_text(
            f"<testsuites><testsuite>{inside}</testsuite></testsuites>"
        )

    suite.print_slowest(["quick", "slow", "not run"], 90.0)
    heading, *lines = capsys.readouterr().out.splitlines()
    assert heading == "1.5 minutes, the slowest tests:"
    assert [line.split()[-2:] for line in lines] == [
        ["slow", "test_slow_4::test_slow_4"],
        ["quick", "test_quick_3::test_quick_3"],
        ["slow", "test_slow_2::test_slow_2"],
        ["quick", "test_quick_1::test_quick_1"],
    ]
