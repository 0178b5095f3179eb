"""`dev.py messages` prints all that people read."""

import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "messages.py"


def test_all_sentences_are_printed_with_values():
    """Every template is found and filled in, and no place of a value is left open."""
    command = [sys.executable, str(SCRIPT)]
    text = subprocess.run(command, check=True, capture_output=True, encoding="utf-8").stdout
    told = [line for line in text.splitlines() if line.startswith("    ")]
    assert len(told) > 500
    open_places = [line for line in told if "{" in line]
    assert len(open_places) == 1  # the command line's own, which its user types
    assert "a path with {viewer}" in open_places[0]
    assert any("leaks through gaps in 'Ball' (3 open edges). Close them." in t for t in told)
