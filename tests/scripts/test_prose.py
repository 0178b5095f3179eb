"""The check of words finds odd ones, and tells where."""

import pytest

import prose

SOURCE = '''"""A ball.

It stands in air, beside a plate.
"""

# what is asked

TEXT = Message("The glass is no ball: mend it.")
Button(text="Told")
raise ImageError("The file is no picture.")
bl_description = "Tells the size"
add(name, help=f"of {n} balls, by which it is asked")
'''


def test_odd_words_are_found_with_their_lines():
    """In all kinds of texts; the lines are those of an editor."""
    every = list(prose.texts_of(SOURCE, "a.py"))
    found = [line for text in every for line in prose.odd_words(text)]
    assert sorted(found) == [
        "a.py:10: is no",
        "a.py:11: Tells",
        "a.py:12: asked",
        "a.py:12: by which",
        "a.py:3: beside",
        "a.py:3: stands",
        "a.py:6: asked",
        "a.py:8: is no",
        "a.py:8: mend",
        "a.py:9: Told",
    ]
    assert {text.kind for text in every} == {"code", "messages", "others"}


def test_pages_are_read_and_names_of_code_are_allowed(tmp_path):
    """An English page counts, a Japanese one does not, nor does a word that is a name."""
    (tmp_path / "docs" / "ja").mkdir(parents=True)
    page = "There is no plate.\n`telling.py` tells it.\n"
    (tmp_path / "page.md").write_text(page, encoding="utf-8")
    (tmp_path / "docs" / "ja" / "page.md").write_text(page, encoding="utf-8")
    assert [line for text in prose.texts(tmp_path) for line in prose.odd_words(text)] == [
        "page.md:2: tells"
    ]


def test_the_check_fails_on_an_odd_word(tmp_path, monkeypatch, capsys):
    """And passes without one."""
    monkeypatch.setattr(prose, "ROOT", tmp_path)
    prose.main()
    (tmp_path / "page.md").write_text("It tells.", encoding="utf-8")
    with pytest.raises(SystemExit):
        prose.main()
    assert "page.md:1: tells" in capsys.readouterr().out


def test_figures_count_words_in_a_thousand(tmp_path):
    """Two of four words are odd, one is `that`."""
    (tmp_path / "page.md").write_text("That tells beside rays", encoding="utf-8")
    *_, docs = prose.figures(tmp_path)
    assert "words 4" in docs
    assert "odd 500.0" in docs
    assert docs.endswith("250.0")


def test_first_sentences_of_files(tmp_path):
    """`dev.py house --files` reads docstrings and comments, to their first full stop."""
    import house

    room = tmp_path / "core" / "map"
    room.mkdir(parents=True)
    (room / "fold.py").write_text('"""Folds of\na map. Not this."""\n', encoding="utf-8")
    (room / "more.c").write_text("/* A caustic. */\n", encoding="utf-8")
    lines = [" ".join(line.split()) for line in house.first_lines(tmp_path, ["caustic", "fold"])]
    assert lines == ["core/map", "fold.py Folds of a map", "more.c A caustic"]
