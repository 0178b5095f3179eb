"""The memory of a solve is told before it is taken."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from environments import link_package
from kiriko.core.base import free_memory
from kiriko.core.base.errors import RigError
from kiriko.core.base.steps import run_steps
from kiriko.core.files import image_io, picture_file
from kiriko.core.native.loading import SWITCH, library
from kiriko.core.rig.settings import Settings
from kiriko.core.solve import memory
from kiriko.core.solve.session import Session
from known.reference_rigs import ball_rig

GB = "1.2 GB" if library() else "1.3 GB"  # numpy takes more
MEASURE = """
import json
from pathlib import Path
import numpy as np
from dataclasses import replace
from known.reference_rigs import ball_rig, bottle, box, icosphere, lathed, rig, uv_ellipsoid
from kiriko.core.solve import memory
from kiriko.core.rig.settings import Settings
from kiriko.core.solve import memory
from kiriko.core.solve.session import Session
from kiriko.core.base.steps import run_steps
from kiriko.core.map.sampling import sample
def status(key):  # what getrusage tells begins with what the process had that started this one
    lines = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    return 1024 * int(lines[key].split()[0])
def lathe(surface="smooth"):
    s = np.linspace(0, 1, 29)
    radius = np.where((s > 0) & (s < 1), 0.014 + 0.007 * np.sin(7 * s + 0.3), 0)
    return replace(lathed(radius, 0.05 * (s - 0.5)), surface=surface)
def picture(side):
    return np.ones((side, side, 4), np.float32)
def seen_by(n, a_rig):
    viewer, step = a_rig.viewer, np.array([1e-3, 0, 0])
    viewers = (replace(viewer, position=viewer.position + k * step, name=str(k)) for k in range(n))
    return replace(a_rig, viewers=tuple(viewers))
a_rig, settings = {rig}, Settings(tolerance={tolerance})
before = status("VmRSS")
view_map = {work}
told = memory.estimated(a_rig, settings, view_map)
print(json.dumps([status("VmHWM") - before, sum(told.values())]))
"""
SOLVE = "run_steps(Session().solve(a_rig, settings)).first.view_map"
TRACE = (
    "run_steps(sample(Session().plan(a_rig, settings)));"
    " memory.BYTES = replace(memory.BYTES, share=0)"
)


LONG = pytest.mark.long(
    reason="by numpy alone these take longest, and of all solves it takes the same amount more"
)


@pytest.mark.skipif(sys.platform != "linux", reason="the peak is read from /proc")
@pytest.mark.parametrize(
    ("rig", "tolerance", "work"),
    [
        ("ball_rig(3, pixels=1024, display_pixels=256)", 0.1, SOLVE),
        ("ball_rig(3, pixels=128, display_pixels=2048)", 0.1, SOLVE),
        (
            "rig(uv_ellipsoid(0.025, 512, 160), pixels=64, display_pixels=64)",
            0.1,
            SOLVE,
        ),  # triangles
        ("ball_rig(3, pixels=64, display_pixels=64, image=picture(3000))", 0.1, SOLVE),
        ("ball_rig(3, pixels=64, display_pixels=64, image=picture(2999))", 0.1, SOLVE),
        pytest.param(
            "ball_rig(3, pixels=256, display_pixels=512)", 1e-3, SOLVE, marks=LONG
        ),  # quads
        pytest.param(
            "seen_by(9, ball_rig(3, pixels=64, display_pixels=768))", 0.1, SOLVE, marks=LONG
        ),
        pytest.param(
            "seen_by(9, ball_rig(3, pixels=512, display_pixels=128))", 0.1, SOLVE, marks=LONG
        ),
        ("ball_rig(2, pixels=64, display_pixels=1024, display=4.0)", 0.1, SOLVE),  # nearly dark
        ("ball_rig(4, pixels=64, display_pixels=64)", 1e-6, SOLVE),  # as many as there may be
        ("ball_rig(4, pixels=512, display_pixels=64)", 1e-6, TRACE),  # rays of pixels
        pytest.param(
            "ball_rig(5, pixels=768, display_pixels=512)", 1e-6, TRACE, marks=LONG
        ),  # of cells
        pytest.param("rig(lathe(), pixels=128)", 0.1, SOLVE, marks=LONG),  # borders
        pytest.param("rig(lathe('facets'), pixels=384)", 0.1, SOLVE, marks=LONG),
        pytest.param("rig(bottle(), pixels=192)", 0.1, SOLVE, marks=LONG),
        ("rig(icosphere(0.025, 3, smooth=False), pixels=192)", 0.1, SOLVE),
        (
            "rig(box([0.3, 0.03, 0.3]), pixels=256, display_pixels=512)",
            1e-6,
            SOLVE,
        ),  # flat: no more for the tolerance
    ],
)
def test_the_estimate_is_what_is_taken(rig, tolerance, work):
    """Within a factor of 2, in a process of its own, where each term is most of it."""
    code = MEASURE.format(rig=rig, tolerance=tolerance, work=work)
    path = os.pathsep.join(map(str, (link_package(), Path(__file__).parents[1])))
    as_here = {SWITCH: os.environ[SWITCH]} if SWITCH in os.environ else {}
    process = subprocess.run(
        [sys.executable, "-c", code],
        env={"PYTHONPATH": path, **as_here},
        check=True,
        stdout=subprocess.PIPE,
        text=True,
    )
    taken, told = json.loads(process.stdout)
    assert 0.5 * taken < told < 2 * taken


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"display": 3000}, f"about {GB} .* 0.1 GB are free: lower the resolution of the display"),
        ({"viewer": 4000}, "lower the resolution of the viewer 'viewer'"),
        ({"picture": 3000}, r"choose a smaller image for the picture 'picture' \(3000 x 3000\)"),
        ({"tolerance": 1e-5, "viewer": 64}, r"raise the tolerance \(1e-05 display pixels\)"),
        ({}, "close other programs"),
    ],
)
def test_what_would_not_fit_is_refused(monkeypatch, change, words):
    """Before anything is made, by the largest part of it; the session stays."""
    session = Session()
    small = ball_rig(2, pixels=32, display_pixels=32)
    first = run_steps(session.solve(small))
    free = 10e6 if not change else 100e6
    monkeypatch.setattr(free_memory, "available", lambda: free)
    side = change.get("picture", 64)
    large = ball_rig(
        2,
        pixels=change.get("viewer", 33),
        display_pixels=change.get("display", 32),
        image=np.zeros((side, side, 4), np.float32),
    )
    with pytest.raises(RigError, match=words):
        run_steps(session.solve(large, Settings(tolerance=change.get("tolerance", 0.1))))
    again = run_steps(session.solve(replace(small)))

    assert again.n_rays == 0  # nothing solved was lost
    assert (again.source == first.source).all()


def test_light_that_may_not_be_there_refuses_nothing(monkeypatch):
    """Where all but the shares of a display that is lit all over would fit, they are told when
    the light is traced: a display that is nearly dark is solved, one that is not is refused then.
    """
    pixels = {"pixels": 64, "display_pixels": 1024}
    dark, lit = ball_rig(2, **pixels, display=4.0), ball_rig(2, **pixels)
    for a_rig in (dark, lit):
        parts = memory.estimated(a_rig, Settings())
        whole = sum(parts.values())
        monkeypatch.setattr(free_memory, "available", lambda whole=whole: 0.9 * whole)
        if a_rig is dark:
            assert run_steps(Session().solve(a_rig)).source.any()
            continue

        told, steps = [], Session().solve(a_rig)
        with pytest.raises(RigError, match="lower the resolution of the display 'display'"):
            told.extend(steps)
        assert told[-1] > 0
        without = whole - parts["light"] - 1e6
        monkeypatch.setattr(free_memory, "available", lambda without=without: without)
        with pytest.raises(RigError, match="lower the resolution of the display"):
            next(Session().solve(a_rig))


def test_light_and_picture_count_together(monkeypatch):
    """Each would fit alone: refused as soon as the light is traced."""
    image = np.zeros((2400, 2400, 3), np.float32)
    a_rig = ball_rig(2, pixels=64, display_pixels=1024, image=image)
    parts = memory.estimated(a_rig, Settings())
    free = sum(parts.values()) - parts["light"] + 1e6
    assert parts["display"] + parts["light"] < free
    monkeypatch.setattr(free_memory, "available", lambda: free)
    with pytest.raises(RigError, match="GB are free"):
        run_steps(Session().solve(a_rig))


@pytest.mark.numpy_alone
def test_what_is_free_is_known_here():
    free = free_memory.available()
    assert free is None or 1e7 < free < 1e14


@pytest.mark.parametrize(
    ("groups", "files"),
    [
        (
            "0::/slice/box",
            {
                "slice/memory.max": "300000000",
                "slice/memory.current": "250000000",
                "slice/memory.stat": "anon 5\ninactive_file 20000000",
                "slice/box/memory.max": "max",
                "slice/box/memory.current": "90000000",
                "slice/box/memory.stat": "inactive_file 7",
            },
        ),
        (
            "5:devices:/\n4:memory:/not/seen/from/inside",
            {
                "memory/memory.limit_in_bytes": "300000000",
                "memory/memory.usage_in_bytes": "250000000",
                "memory/memory.stat": "inactive_file 5\ntotal_inactive_file 20000000",
            },
        ),
    ],
    ids=["version 2", "version 1"],
)
def test_the_limit_of_a_container_counts(monkeypatch, tmp_path, groups, files):
    """Free is what the tightest control group leaves, and files that the system can drop."""
    (tmp_path / "of_self").write_text(groups)
    for name, text in files.items():
        path = tmp_path / "groups" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    monkeypatch.setattr(free_memory, "GROUPS", tmp_path / "groups")
    monkeypatch.setattr(free_memory, "GROUPS_OF_SELF", tmp_path / "of_self")
    assert free_memory.available() == 70e6


def test_the_limit_of_the_address_space_counts():
    """What a process with `ulimit -v` says is free can be allocated, and little more."""
    resource = pytest.importorskip("resource")
    code = (
        "import resource, sys; import numpy as np;"
        "from kiriko.core.base.free_memory import available;"
        "resource.setrlimit(resource.RLIMIT_AS, (2 * 10**9,) * 2); free = available();"
        "np.empty(int(free - 5e7), np.uint8)\n"
        "try: np.empty(int(free + 5e7), np.uint8)\n"
        "except MemoryError: sys.exit(7)"
    )
    assert resource.getrlimit(resource.RLIMIT_AS)[0] == resource.RLIM_INFINITY
    assert subprocess.run([sys.executable, "-c", code], cwd=link_package()).returncode == 7


def test_a_photograph_is_refused_before_it_is_read(monkeypatch, tmp_path):
    """A photograph that needs more memory than is free is refused, and so is its remedy named."""
    path = tmp_path / "large.png"
    image_io.write(path, np.zeros((300, 200, 3), np.float32), "PNG8")
    assert picture_file.read_photograph(path).shape == (300, 200, 3)
    monkeypatch.setattr(free_memory, "available", lambda: 1e6)
    with pytest.raises(RigError, match=r"choose a smaller one \(200 x 300 pixels\)"):
        picture_file.read_photograph(path)
