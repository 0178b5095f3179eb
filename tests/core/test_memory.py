"""What a solve takes is told before it is taken."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from reference_rigs import ball_rig

from environments import link_package
from kiriko.core import memory
from kiriko.core.errors import RigError
from kiriko.core.session import Session, finish

MEASURE = """
import json
from pathlib import Path
from reference_rigs import ball_rig
from kiriko.core.memory import estimated
from kiriko.core.session import Session, finish
rig = ball_rig(3, pixels={viewer}, display_pixels={display})
def peak():  # what getrusage tells begins with what the process had that started this one
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    return 1024 * int(status["VmHWM"].split()[0])
before = peak()
finish(Session().solve(rig))
print(json.dumps([peak() - before, sum(estimated(rig).values())]))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="the peak is read from /proc")
@pytest.mark.parametrize(("viewer", "display"), [(1024, 256), (128, 2048)])
def test_the_estimate_is_what_is_taken(viewer, display):
    """Within a factor of 2, in a process of its own."""
    code = MEASURE.format(viewer=viewer, display=display)
    path = os.pathsep.join(map(str, (link_package(), Path(__file__).parent)))
    process = subprocess.run(
        [sys.executable, "-c", code], env={"PYTHONPATH": path}, check=True, stdout=subprocess.PIPE, text=True
    )
    taken, told = json.loads(process.stdout)
    assert 0.5 * taken < told < 2 * taken


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"display": 3000}, "about 1.1 GB .* 0.1 GB are free: lower the resolution of the display"),
        ({"viewer": 4000}, "lower the resolution of the scene's render"),
        ({}, "close other programs"),
    ],
)
def test_what_would_not_fit_is_refused(monkeypatch, change, words):
    """Before anything is made, by what takes most of it; the session stays."""
    session = Session()
    small = ball_rig(2, pixels=32, display_pixels=32)
    first = finish(session.solve(small))
    free = 10e6 if not change else 100e6
    monkeypatch.setattr(memory, "available", lambda: free)
    large = ball_rig(2, pixels=change.get("viewer", 33), display_pixels=change.get("display", 32))
    with pytest.raises(RigError, match=words):
        finish(session.solve(large))
    again = finish(session.solve(replace(small)))
    assert again.n_rays == 0  # nothing was lost of what was solved
    assert (again.source == first.source).all()


def test_what_is_free_is_known_here():
    free = memory.available()
    assert free is None or 1e7 < free < 1e14
