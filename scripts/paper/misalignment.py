"""The effect of a misaligned bench on the lattice in the cube, and the information in a photograph.

The paper's cube rig with an ASKA3D-488, 49 points over 1165 viewer pixels; simulated photographs
with noise.
"""

from collections import Counter
from dataclasses import replace

import numpy as np

from kiriko.core.base.errors import RigError
from kiriko.core.base.steps import run_steps
from kiriko.core.bench.offset import TOLERANCES, Parameter
from kiriko.core.lab.calibrate.fit import extra_photographs, fit
from kiriko.core.lab.calibrate.misalignment import Bench, spread
from kiriko.core.rig.rig import MirrorArray
from kiriko.core.rig.settings import Settings
from known.reference_rigs import cube_rig

from .published import PAPER_DX, SOURCE, Table

ACROSS = 1165  # viewer px from the first to the last point
# m
WIDTH = 0.03
FIELD = 0.05
NOISE = 0.3  # viewer px
BENCHES = 200  # random benches with a fit
N_SPREAD = 20_000  # random benches for the spread alone
ADVISED = 20  # fitted benches with advice on another photograph


def cube_bench() -> Bench:
    """The cube rig, its points as the picture has them."""
    across = (np.arange(7) / 6 - 0.5) * WIDTH
    x, z = (a.ravel() for a in np.meshgrid(across, -across))
    rig = cube_rig(pixels=round(ACROSS * FIELD / WIDTH), field=FIELD, picture=WIDTH * 7 / 6)
    rig = replace(rig, plates=(replace(rig.plates[0], array=MirrorArray()),))
    return Bench(rig, Settings(), rig.viewer.project(np.stack([x, 0 * x, z], axis=1)))


def tolerance_of(parameter: Parameter) -> float:
    """Expected standard deviation of a bench set up with rulers and squares, by its unit."""
    by_unit = {"mm": "shift", "deg": "turn", "": "index", "%": "focal"}
    return TOLERANCES.get(parameter.kind, TOLERANCES[by_unit[parameter.unit]])


def tolerances_of(bench: Bench) -> np.ndarray:
    return np.array([tolerance_of(p) for p in bench.parameters])


def sensitivities(bench: Bench) -> dict[str, Table]:
    """Which screw matters: a table by its heading."""
    d = bench.sensitivity()
    tolerances = tolerances_of(bench)
    wanted = PAPER_DX[SOURCE]

    head = "off by one unit|mean dx px|mean dy px|mean px|to expect|px"
    rows = [[*head.split("|"), f"alone makes the paper's {wanted} px of dx"]]
    for k in np.argsort(-np.linalg.norm(d, axis=2).mean(axis=1) * tolerances):
        parameter = bench.parameters[k]
        moved = d[k]
        dx, dy = moved.mean(axis=0)
        length = np.linalg.norm(moved, axis=1).mean()
        alone = (
            f"{wanted / abs(dx):.3g} {parameter.unit}"
            if abs(dx) > 1e-3 * length and abs(dx) > 0.1
            else "cannot"
        )
        expected = f"{tolerances[k]:.3g} {parameter.unit}".strip()
        rows.append(
            [
                parameter.name,
                *(f"{x:.3f}" for x in (dx, dy, length)),
                expected,
                f"{length * tolerances[k]:.2f}",
                alone.strip(),
            ]
        )

    low, middle, high = np.quantile(spread(d, tolerances, N_SPREAD), [0.05, 0.5, 0.95])
    about = (
        f"How far the lattice moves. On {N_SPREAD} random benches with the deviations to expect"
        f" the mean displacement"
        f" is {middle:.1f} px in the median, {low:.1f} to {high:.1f} px in 90 % of them"
    )

    return {about: rows}


def fits(bench: Bench, n: int, seed: int) -> dict[str, Table]:
    """Hidden errors of n benches, found again from one
    photograph of each: a table by its heading.
    """
    tolerances = tolerances_of(bench)
    before = []
    left = []
    shares = []
    conditions = []
    failed = 0
    advised = Counter()

    gains = []
    for k in range(n):
        random = np.random.default_rng([seed, k])
        hidden = random.standard_normal(len(tolerances)) * tolerances
        seen = bench.seen(hidden)
        try:
            found = run_steps(
                fit(bench, seen + random.normal(0, NOISE, seen.shape), tolerances, NOISE)
            )
        except RigError:
            failed += 1
            continue
        again = bench.seen(hidden, display=bench.shown(found.amounts))
        before.append(np.nanmean(np.linalg.norm(seen - bench.view, axis=1)))
        left.append(np.nanmean(np.linalg.norm(again - bench.view, axis=1)))
        conditions.append(found.condition)
        shares.append(found.errors / tolerances)
        if k < ADVISED:
            best = run_steps(extra_photographs(bench, found, tolerances, NOISE))[0]
            advised[best.where] += 1
            gains.append((best.gain, best.errors / tolerances))

    good = sum(x < 1 for x in left) / n
    places = ", ".join(f"{where} ({k})" for where, k in advised.most_common())
    about = (
        f"{n} random benches, one photograph of each with {NOISE} px of noise; not fitted:"
        f" {failed}. Mean displacement before: {np.median(before):.1f} px in the median; solved"
        f" again with the fit: {np.median(left):.2f} px, below 1 px in {good:.1%}. Condition"
        f" number in the median: {np.median(conditions):.1e}. The most informative other"
        f" photograph, of the first {min(n, ADVISED)} benches: {places}, by"
        f" {np.median([gain for gain, _ in gains]):.1f} bits. What stays unknown of each amount,"
        " in what was to expect"
    )
    one = np.median(shares, axis=0)
    two = np.median([errors for _, errors in gains], axis=0)
    rows = [["amount", "by one photograph", "with the other"]]
    rows += [[bench.parameters[k].name, f"{one[k]:.1%}", f"{two[k]:.1%}"] for k in np.argsort(one)]

    return {about: rows}
