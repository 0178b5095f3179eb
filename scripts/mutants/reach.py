"""Plugin of pytest for `dev.py mutants`: tells coverage which
test is under way, and notes how long each took.
"""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import coverage
import pytest

SECONDS: Counter[str] = Counter()


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Count lines to a test from its setup to its teardown."""
    now = coverage.Coverage.current()
    now.switch_context(item.nodeid)
    result = yield
    now.switch_context("")
    return result


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Add up a test's seconds."""
    SECONDS[report.nodeid] += report.duration


def pytest_sessionfinish() -> None:
    """Leave the notes where run.py looks for them."""
    path = Path(os.environ["KIRIKO_REACH"], "tests.json")
    path.write_text(json.dumps({"seconds": SECONDS}), encoding="utf-8")
