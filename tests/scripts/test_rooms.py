"""Files of scripts/ and tests/known import each other in one direction."""

import ast

import pytest

import environments

FOLDERS = environments.ROOT / "scripts", environments.ROOT / "tests"
PATHS = {
    path.relative_to(folder).with_suffix("").parts: path
    for folder, files in zip(FOLDERS, ("**/*.py", "known/**/*.py"), strict=True)
    for path in folder.glob(files)
}


def asked(name: tuple[str, ...]) -> set[tuple[str, ...]]:
    """Files that a file imports from, in its functions, too."""
    found = set()
    for node in ast.walk(ast.parse(PATHS[name].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {tuple(alias.name.split(".")) for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            room = name[: -node.level] if node.level else ()
            base = (*room, *(node.module or "").split(".")) if node.module else room
            found |= {base} | {(*base, alias.name) for alias in node.names}
    return {(*one, "__init__") if (*one, "__init__") in PATHS else one for one in found} & {*PATHS}


@pytest.mark.parametrize("name", sorted(PATHS), ids="/".join)
def test_no_script_asks_for_itself(name):
    """Imports do not go round in circles, whoever follows them."""
    found = set()
    todo = {name}
    while todo:
        todo = {other for one in todo for other in asked(one)} - found
        found |= todo
    assert name not in found
