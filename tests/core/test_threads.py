"""Solving takes one thread, but for the kernel's: BLAS is not
asked for products and systems of small matrices.

Its threads cost more than they save there, and wait for each other where others want the processor.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from kiriko.core.base.products import combine, solve_symmetric, turn

LIMITS = "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", "MKL_NUM_THREADS"
# of the processor time, for Embree's threads; with BLAS it
# was 0.05 to 0.17, by case and version of numpy
MOST = 0.04
TRIES = 4  # other work of the machine can only add to it
RUN = """
import json, time
from dataclasses import replace
import numpy as np
from known.reference_rigs import ball_rig, bottle, mean_normals, rig, torus
from kiriko.core.native import loading
from kiriko.core.image import simulation
from kiriko.core.bench.offset import moved, turned
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.rig.settings import Settings
from kiriko.core.rig.rig import MirrorArray
from kiriko.core.solve.session import Session
from kiriko.core.base.steps import run_steps

def with_mirrors(a_rig):
    return replace(a_rig, plates=(replace(a_rig.plates[0], array=MirrorArray()),))

def simulated(a_rig):
    plan = compile_plan(a_rig, Settings())
    run_steps(simulation.simulate(plan, np.ones((64, 64, 3), np.float32), 4))

def turned_twice(a_rig):
    session = Session()
    for degrees in (0.0, 3.0):
        motion = turned(np.array([0, 0, 1.0]), degrees, np.zeros(3))
        glass = moved(a_rig.glasses[0], motion)
        run_steps(session.solve(replace(a_rig, glasses=(glass,)), Settings()))

loading.use_threads(1)
solve = lambda a_rig: run_steps(Session().solve(a_rig, Settings()))
np.ones((64, 64)) @ np.ones((64, 64))  # whatever it takes to begin
time.sleep(0.5)  # threads that were begun look for work for a moment
process, own = time.process_time(), time.thread_time()
{work}
process, own = time.process_time() - process, time.thread_time() - own
print(json.dumps([process, process - own]))
"""
WORK = {
    "ball": "solve(ball_rig(5))",
    "torus with mean normals": "solve(rig(mean_normals(torus(0.02, 0.008, 128, 64)), pixels=256))",
    "bottle": "solve(rig(bottle(), pixels=96))",
    "ball, turned": "turned_twice(ball_rig(5, pixels=256))",
    "mirrors": "simulated(with_mirrors(ball_rig(3, pixels=256, display_pixels=64)))",
}


@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="with one processor there is one thread")
@pytest.mark.parametrize("name", WORK)
def test_a_solve_takes_no_time_of_other_threads(name: str) -> None:
    """However many threads BLAS may have, the processor time is that of the one thread
    that solves.
    """
    link = Path(__file__).parents[2] / ".dev" / "link"
    path = os.pathsep.join(map(str, (link, Path(__file__).parents[1])))
    free = {name: value for name, value in os.environ.items() if name not in LIMITS}
    code = RUN.replace("{work}", WORK[name])

    shares = []
    while len(shares) < TRIES and min(shares, default=1.0) > MOST:
        done = subprocess.run(
            [sys.executable, "-c", code],
            env={**free, "PYTHONPATH": path},
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr
        process, others = json.loads(done.stdout)
        shares.append(others / process)

    assert min(shares) <= MOST, shares


def test_products_are_those_of_matrices() -> None:
    """`turn` and `combine` are `@` but for rounding, of many
    rows, of one, of none, and of stacks of rows.
    """
    rng = np.random.default_rng(0)
    linear = rng.normal(size=(2, 3))
    columns = rng.normal(size=(3, 1000))
    for shape in ((1000, 3), (1, 3), (0, 3), (5, 7, 3), (3,)):
        vectors = rng.normal(size=shape)
        np.testing.assert_allclose(turn(linear, vectors), vectors @ linear.T, rtol=0, atol=1e-14)
    for some in (columns, columns[:, :0], columns.reshape(1000, 3).T):
        np.testing.assert_allclose(combine(linear, some), linear @ some, rtol=0, atol=1e-14)


@pytest.mark.parametrize("n", [0, 1, 1023, 1024, 1025, 3000])
def test_many_systems_are_solved_as_each_by_itself(n: int) -> None:
    """Normal equations of 18 rows with a small ridge: the
    residual is that of rounding, and LAPACK's solution.
    """
    rng = np.random.default_rng(n)
    rows = rng.normal(size=(n, 18, 12))
    matrices = np.matmul(rows.transpose(0, 2, 1), rows) + 1e-6 * np.eye(12)
    right = rng.normal(size=(n, 12, 2))
    found = solve_symmetric(matrices, right)
    assert found.shape == (n, 12, 2)
    np.testing.assert_allclose(np.matmul(matrices, found), right, rtol=0, atol=1e-11)
    np.testing.assert_allclose(found, np.linalg.solve(matrices, right), rtol=1e-9, atol=1e-11)
