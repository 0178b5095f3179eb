import re

import house


def test_files_and_functions_of_core_stay_small_and_no_import_goes_up():
    """No file of core is over 600 lines, no function over 60, and no room asks a higher one."""
    core = house.measured(house.ROOT, "core")
    assert [n for n, lines in core.file_lines.items() if lines > house.MOST_FILE_LINES] == []
    assert [n for n, lines in core.body_lines.items() if lines > house.MOST_BODY_LINES] == []

    place = {room: number for number, room in enumerate(house.ROOMS)}
    assert [(a, b) for a, b in house.arrows(house.ROOT) if place[b] > place[a]] == []


def test_what_is_counted_is_there(tmp_path):
    """Lines, tokens, blank lines and words of a file written for it are counted as by hand."""
    (tmp_path / "core").mkdir()
    source = (
        '"""What and why."""\n\n\ndef f(a):\n    """What it is."""\n    b = a\n\n    return b\n'
    )
    (tmp_path / "core" / "one.py").write_text(source, encoding="utf-8")
    found = house.measured(tmp_path, "core")
    assert found.file_lines == {"core/one.py": 8}
    assert found.body_lines == {"core/one.py f 4": 3}
    # two docstrings; def f ( a ) :; b = a; return b
    assert (found.n_tokens, found.n_code_lines, found.n_blank_lines) == (2 + 6 + 3 + 2, 5, 1)
    assert " ".join(found.prose).lower().count("what") == 2


def test_nothing_is_set_by_the_context_s_window():
    """Blender 4.2 would tag a scene of before for it, perhaps a freed one: see `show_scene`."""
    files = [
        path
        for folder in ("core", "operators", "panels", "scripts", "tests")
        for path in sorted((house.ROOT / folder).rglob("*.py"))
    ]
    assert len(files) > 100
    setting = re.compile(r"context\.window\.\w+(\.\w+)* = ")
    assert [path.name for path in files if setting.search(path.read_text("utf-8"))] == []
