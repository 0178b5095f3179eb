import ast
import json
import re
import sys
from pathlib import Path

import pytest

from mutants import run as mutants
from mutants.mutations import COMPARISONS, draw, mutants_of

SOURCE = '''"""A file."""

LIMIT = 0.5  # é: a letter of two bytes before a node


def clamp(x: int = 3) -> int:
    """No mutant of a docstring."""
    if x < LIMIT and not done(x):
        raise ValueError(f"{x + 1} is too small")
    table[x] = -min(x, 2 * x)
    note(x)
    return table
'''
KINDS = {
    "constant": {"0.5 -> 1.0", "3 -> 4", "2 -> 3"},
    "comparison": {"x < LIMIT -> x <= LIMIT", "x < LIMIT -> x >= LIMIT"},
    "boolean": {
        "x < LIMIT and (not done(x)) -> x < LIMIT or not done(x)",
        "not done(x) -> done(x)",
    },
    "sign": {"-min(x, 2 * x) -> min(x, 2 * x)"},
    "swap": {"min -> max"},
    "arithmetic": {"2 * x -> 2 / x"},
    "removed": {
        "table[x] = -min(x, 2 * x) -> pass",
        "note(x) -> pass",
        "raise ValueError(f'{x + 1} is too small') -> pass",
    },
}


def core() -> dict[str, str]:
    return mutants.read_core()


def test_each_kind_of_mutant_is_made_and_no_other() -> None:
    """Comparison, arithmetic, constant, sign, boolean, removed statement, swapped pair.

    Words stay as they are.
    """
    found: dict[str, set[str]] = {}
    for mutant in mutants_of("file.py", SOURCE):
        found.setdefault(mutant.kind, set()).add(mutant.name.partition(": ")[2])
    assert found == KINDS


def test_a_mutant_changes_its_node_and_nothing_else() -> None:
    """One line becomes another, by one occurrence of the text in the name.

    Brackets, spaces and quotes do not count.
    """

    def plain(text: str) -> str:
        return re.sub(r"[\s()]", "", text).replace('"', "'")

    for mutant in mutants_of("file.py", SOURCE):
        lines = SOURCE.splitlines(), mutant.put_into(SOURCE).splitlines()
        ((before, after),) = ((plain(a), plain(b)) for a, b in zip(*lines, strict=True) if a != b)
        old, new = map(plain, mutant.name.partition(": ")[2].split(" -> "))
        places = [place.start() for place in re.finditer(re.escape(old), before)]
        assert after in [before[:k] + new + before[k + len(old) :] for k in places]


def test_all_mutants_of_core_are_python_and_are_told_apart() -> None:
    """Each can be compiled, differs from the file, and has a name of its own."""
    for file, source in core().items():
        made = mutants_of(file, source)
        assert len({mutant.name for mutant in made}) == len(made)
        unchanged = ast.dump(ast.parse(source))
        for mutant in made[::60]:
            assert ast.dump(ast.parse(mutant.put_into(source))) != unchanged, mutant.name


def test_the_draw_goes_by_lines_and_kinds_and_stays_when_other_files_change() -> None:
    """As many as asked for, in each file within one of its
    share; another file's edit moves none; seeds differ.
    """
    sources = core()
    lines = {file: len(text.splitlines()) for file, text in sources.items()}
    made = {file: mutants_of(file, text) for file, text in sources.items()}
    drawn = draw(made, lines, 200, seed=0)

    assert abs(len(drawn) - 200) < 15
    for file in sources:
        assert (
            abs(
                sum(mutant.file == file for mutant in drawn)
                - 200 * lines[file] / sum(lines.values())
            )
            < 1
        )

    assert len({mutant.kind for mutant in drawn}) == len(KINDS)
    names = {mutant.name for mutant in drawn}
    assert {mutant.name for mutant in draw(made, lines, 200, seed=0)} == names
    assert len({mutant.name for mutant in draw(made, lines, 200, seed=1)} & names) < 60

    changed = sources["light/trace.py"].replace("events", "happenings")
    others = made | {"light/trace.py": mutants_of("light/trace.py", changed)}
    again = {
        mutant.name
        for mutant in draw(others, lines, 200, seed=0)
        if mutant.file != "light/trace.py"
    }

    assert again == {mutant.name for mutant in drawn if mutant.file != "light/trace.py"}


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A checkout whose core is one function, of which one test tells half."""
    for name in ("core", "tests/core", "tests/known", "scripts", "docs"):
        (tmp_path / name).mkdir(parents=True)
    for name in mutants.TOP:
        (tmp_path / name).touch()
    (tmp_path / "core" / "part.py").write_text(
        "def larger(a, b):\n    return a + 1 if a < b else b\n"
    )
    (tmp_path / "tests" / "core" / "test_part.py").write_text(
        "import importlib.util\nfrom pathlib import Path\n\n\ndef test_larger():\n"
        "    path = Path(__file__).parents[2] / 'core' / 'part.py'\n"
        "    spec = importlib.util.spec_from_file_location('part', path)\n"
        "    part = importlib.util.module_from_spec(spec)\n    spec.loader.exec_module(part)\n"
        "    assert part.larger(1, 5) == 2\n"
    )
    (tmp_path / "tests" / "mutants.toml").write_text("# none\n")
    monkeypatch.setattr(mutants, "ROOT", tmp_path)
    monkeypatch.setattr(mutants, "OUT", tmp_path / "out" / "mutants")
    monkeypatch.setattr(mutants, "ACCEPTED", tmp_path / "tests" / "mutants.toml")
    reach = mutants.Reach(
        {"tests/core/test_part.py::test_larger": 0.1},
        {"part.py": {2: ["tests/core/test_part.py::test_larger"]}},
    )
    monkeypatch.setattr(mutants, "find_reach", lambda tree, everything: reach)

    return tmp_path


def tried(monkeypatch: pytest.MonkeyPatch, *options: str) -> int:
    """Exit code of the command."""
    monkeypatch.setattr(sys, "argv", ["mutants.py", *options])
    with pytest.raises(SystemExit) as ended:
        mutants.main()
    return int(ended.value.code)


def test_survivors_are_listed_unless_there_is_a_reason(
    checkout: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A mutant that the test tells is killed, one that it does not is named;
    the checkout stays as it was; a reason quiets it.
    """
    before = (checkout / "core" / "part.py").read_bytes()
    assert tried(monkeypatch, "--number", "5") == 1
    verdicts = {
        name.partition(": ")[2]: verdict.verdict
        for name, verdict in mutants.read_verdicts().items()
    }

    assert verdicts == {
        "a < b -> a <= b": "survived",
        "a < b -> a >= b": "killed",
        "a + 1 -> a - 1": "killed",
        "1 -> 2": "killed",
    }
    assert (checkout / "core" / "part.py").read_bytes() == before
    assert "return a + 1 if a < b else b" in capsys.readouterr().out

    survivor = next(
        name for name, verdict in mutants.read_verdicts().items() if verdict.verdict == "survived"
    )
    reason = "at a = b both are right"
    text = f"[[accepted]]\nmutant = {json.dumps(survivor)}\nreason = {json.dumps(reason)}\n"
    (checkout / "tests" / "mutants.toml").write_text(text)

    assert tried(monkeypatch, "--number", "5") == 0
    assert reason in capsys.readouterr().out


def test_a_run_goes_on_where_it_was_stopped(
    checkout: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No time: nothing is tried. Then all is.

    Then nothing again, until the file, or for survivors a test, changes.
    """
    counted = []
    run = mutants.run
    monkeypatch.setattr(
        mutants, "run", lambda *arguments: counted.append(arguments) or run(*arguments)
    )
    tried(monkeypatch, "--number", "5", "--minutes", "0")

    assert len(counted) == 0
    tried(monkeypatch, "--number", "5")
    assert len(counted) == 4
    tried(monkeypatch, "--number", "5")

    assert len(counted) == 4
    with (checkout / "tests" / "core" / "test_part.py").open("a") as file:
        file.write("    assert part.larger(5, 5) == 5\n")
    assert tried(monkeypatch, "--number", "5") == 0
    assert len(counted) == 5


def test_a_mutant_that_never_ends_is_stopped(
    checkout: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A test that waits for ever is no survivor."""
    monkeypatch.setattr(mutants, "AT_LEAST_S", 2.0)
    path = checkout / "core" / "part.py"
    path.write_text("def larger(a, b):\n    while a >= b:\n        pass\n    return a + 1\n")
    (mutant,) = (
        m for m in mutants_of("part.py", path.read_text()) if m.name.endswith("a >= b -> a < b")
    )
    with mutants.copied() as tree:
        mutants.OUT.mkdir(parents=True)
        tests = ["tests/core/test_part.py::test_larger"]
        assert mutants.try_mutant(tree, mutant, path.read_text(), tests, 2.0)[0] == mutants.HUNG
        assert (tree / "core" / "part.py").read_text() == path.read_text()


def test_constants_are_shown_to_the_tests_that_run_their_uses() -> None:
    """A name that is assigned when core is imported is run,
    as far as tests can tell, where it stands.
    """
    sources = {
        "one.py": "LIMIT = 3\n\n\ndef f(x):\n    return x\n",
        "two.py": "from .one import LIMIT\n\n\ndef g():\n    return LIMIT\n",
    }
    reach = mutants.Reach({"f": 1.0, "g": 2.0}, {"one.py": {5: ["f"]}, "two.py": {5: ["g"]}})
    (mutant,) = mutants_of("one.py", sources["one.py"])
    assert reach.of(mutant, sources) == ["g"]


@pytest.mark.parametrize(
    ("budget", "n"), [(0.5, 1), (1.0, 1), (2.9, 1), (3.0, 2), (9.0, 3), (1e9, 4)]
)
def test_a_mutant_is_shown_to_as_many_tests_as_the_budget_has_time_for(
    budget: float, n: int
) -> None:
    """In their order, and to one at the least."""
    reach = mutants.Reach({"a": 1.0, "b": 2.0, "c": 4.0, "d": 99.0}, {})
    assert reach.within(list("abcd"), budget) == list("abcd")[:n]


def test_every_comparison_has_other_forms() -> None:
    """None of Python's comparison operators is left out."""
    assert set(COMPARISONS) == {
        kind
        for kind in vars(ast).values()
        if isinstance(kind, type) and issubclass(kind, ast.cmpop)
    } - {ast.cmpop}
