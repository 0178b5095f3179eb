import sys
import time
from concurrent.futures import Future
from pathlib import Path

import pytest

import suite
from environments import ToolError

ASLEEP_S = 1.0
BUSY_S = 3.0
SLEEPS = "import time\nprint('begun', flush=True)\ntime.sleep(600)\n"
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
def logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
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
def test_a_step_that_works_or_is_held_up_is_no_hang(code: str) -> None:
    """More than the time of a hang may pass if a step prints, computes in silence, itself or in a
    child, or is suspended.
    """
    started = time.monotonic()
    assert run(code) == suite.Result(passed=1)
    assert time.monotonic() - started > ASLEEP_S


def test_a_step_that_gets_no_cpu_is_no_hang(logs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A thread that wants a CPU and gets none, and one that waits for the disk, do not sleep."""
    for state in "RDT":
        monkeypatch.setattr(
            suite, "threads", lambda _, state=state: [("1", "S", 7), ("2", state, 7)]
        )
        assert run("import time; time.sleep(1.5)") == suite.Result(passed=1)


@pytest.mark.parametrize(
    "code",
    [SLEEPS, CHILD_SLEEPS, POLLS, pytest.param(LOOPS, marks=HAS_PROC)],
    ids=["sleeps", "child sleeps", "polls", "loops"],
)
def test_a_step_that_hangs_is_stopped_and_says_so(
    code: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """A step that sleeps, looks again and again for what never comes, or loops without end is
    stopped, fails and shows its output.
    """
    result = run(code)
    assert result.failed == 1
    assert "stopped: since it last printed" in result.remark
    assert ("begun" in capsys.readouterr().out) == ("begun" in code)


def test_without_proc_a_silent_step_is_a_hang(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the system does not list threads, a step is stopped after the silence alone."""
    monkeypatch.setattr(suite, "threads", lambda _: [])
    assert run(TALKS) == suite.Result(passed=1)
    assert run(LOOPS).failed == 1


def test_a_test_that_hangs_is_named_by_its_stack(
    logs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The log of a step of pytest that was stopped shows the function in which it stood."""
    monkeypatch.setattr(suite, "STACK_AFTER_S", 0.5)
    hanging = logs / "test_hanging.py"
    hanging.write_text("import time\n\n\ndef test_that_hangs():\n    time.sleep(600)\n")
    step = next(step for step in suite.steps("any", "any") if step.name == "scripts")
    suite.run_step(
        suite.Step("step", "any", (*step.arguments[:-1], str(hanging))), Path(sys.executable), None
    )
    assert "in test_that_hangs" in (logs / "step.log").read_text()


def test_steps_wait_for_their_own_environment_alone(monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_an_environment_that_cannot_be_set_up_ends_the_suite(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With its own sentence, and without the steps that were not begun."""

    def set_up(name: str, python: Path) -> Path:
        raise ToolError("There is no network.")

    monkeypatch.setattr(suite, "set_up", set_up)
    with pytest.raises(ToolError, match="no network"):
        suite.run_steps([suite.Step("step", "any", ())], {"any": Path("one")})


def files_of(environment: str, kind: str, everywhere: bool) -> list[str]:
    """The files of tests that an environment's steps of a kind run."""
    steps = suite.steps("any", "any", everywhere)
    of_kind = [s for s in steps if s.environment == environment and s.name.startswith(kind)]
    words = [word for step in of_kind for word in step.arguments if word.startswith("tests/")]
    return sorted(words)


def test_each_blender_runs_each_file_of_its_tests_once() -> None:
    """The parts of a Blender's tests have all files, none of them twice. The newest leaves out
    none, an older one those over many cases, unless all is asked for.
    """
    files = sorted(
        file.relative_to(suite.ROOT).as_posix()
        for file in (suite.ROOT / "tests" / "blender").rglob("test_*.py")
    )
    newest, *between, oldest = suite.BLENDERS
    both_ends = [file for file in files if Path(file).name not in suite.AT_NEWEST]
    assert len(files) - len(both_ends) == len(suite.AT_NEWEST)
    everywhere = [file for file in both_ends if Path(file).name not in suite.AT_BOTH_ENDS]
    assert len(both_ends) - len(everywhere) == len(suite.AT_BOTH_ENDS)

    assert files_of(newest, "blender-", everywhere=False) == files
    assert files_of(oldest, "blender-", everywhere=False) == both_ends
    for name in between:
        assert files_of(name, "blender-", everywhere=False) == everywhere
    for name in suite.BLENDERS:
        assert files_of(name, "blender-", everywhere=True) == files


def test_what_a_numpy_leaves_out_is_there() -> None:
    """Files that are left out by name are files; those left to numpy alone are run by it, and where
    all is asked for each file of core is run with the kernel and without.
    """
    for file in (*suite.NUMPY_ALONE, *suite.AT_NEWEST_NUMPY):
        assert (suite.ROOT / file).is_file()
    assert not set(suite.NUMPY_ALONE) & set(suite.AT_NEWEST_NUMPY)
    assert files_of("core", "core-numpy-alone", everywhere=False) == sorted(suite.NUMPY_ALONE)

    for name in ("core-oldest-numpy", "core-numpy-alone"):
        assert files_of("core", name, everywhere=True) == ["tests/core"]

    n = len(suite.NUMPY_ALONE) + len(suite.AT_NEWEST_NUMPY)
    for everywhere, n_left_out in ((False, n), (True, 0)):
        steps = suite.steps("any", "any", everywhere)
        (step,) = [step for step in steps if step.name == "core-oldest-numpy"]
        left_out = [word for word in step.arguments if word.startswith("--ignore=")]
        assert len(left_out) == n_left_out


def test_steps_have_one_thread_for_linear_algebra(logs: Path) -> None:
    """Two steps run at once, so neither gives numpy's BLAS a second thread."""
    run("import os; print(os.environ['OPENBLAS_NUM_THREADS'], os.environ['OMP_NUM_THREADS'])")
    assert (logs / "step.log").read_text().split() == ["1", "1"]


def test_the_slowest_tests_of_all_steps_are_named(
    logs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
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
