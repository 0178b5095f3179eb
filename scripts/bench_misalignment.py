"""What a real bench does to the lattice in the cube, and what a photograph tells of it: `dev.py misalignment`.

The paper's cube rig with an ASKA3D-488, 49 points over 1165 viewer pixels; simulated photographs with noise.
"""

import argparse
from dataclasses import replace

import numpy as np
from reference_rigs import cube_rig

from kiriko.core.errors import RigError
from kiriko.core.misalignment import Bench, fit, spread
from kiriko.core.plan import Settings
from kiriko.core.rig import MirrorArray

ACROSS = 1165  # viewer px from the first to the last point
WIDTH, FIELD = 0.03, 0.05  # m
PAPER = 62.8  # px, mean dx of the paper's photograph with its source image
NOISE = 0.3  # viewer px
# standard deviations to expect of a bench that was set up with rulers and squares
TOLERANCES = {"mm": 0.5, "deg": 0.1, "": 0.002, "%": 0.1}
MAKE = {"plate: crossing angle": 0.02, "plate: mirror height": 0.01}  # deg, mm: of the plate's maker


def cube_bench() -> Bench:
    """The cube rig, its points as the picture has them."""
    across = (np.arange(7) / 6 - 0.5) * WIDTH
    x, z = (a.ravel() for a in np.meshgrid(across, -across))
    rig = cube_rig(pixels=round(ACROSS * FIELD / WIDTH), field=FIELD)
    rig = replace(rig, plates=(replace(rig.plates[0], array=MirrorArray()),))
    return Bench(rig, Settings(), rig.viewer.project(np.stack([x, 0 * x, z], axis=1)))


def tolerances_of(bench: Bench) -> np.ndarray:
    return np.array([MAKE.get(p.name, TOLERANCES[p.unit]) for p in bench.parameters])


def print_sensitivities(bench: Bench, tolerances: np.ndarray) -> None:
    """Which screw matters."""
    d = bench.sensitivity()
    heads = f"{'mean dx px':>10} {'mean dy px':>10} {'mean px':>9} {'tolerance':>13} {'px':>7}"
    print(f"{'off by one unit':<28} {heads}  alone makes the paper's {PAPER} px of dx")
    order = np.argsort(-np.linalg.norm(d, axis=2).mean(axis=1) * tolerances)
    for k in order:
        parameter, moved = bench.parameters[k], d[k]
        dx, dy = moved.mean(axis=0)
        length = np.linalg.norm(moved, axis=1).mean()
        alone = f"{PAPER / abs(dx):.3g} {parameter.unit}" if abs(dx) > 1e-3 * length and abs(dx) > 0.1 else "cannot"
        print(
            f"{parameter.name:<28} {dx:10.3f} {dy:10.3f} {length:9.3f} {tolerances[k]:9.3g} {parameter.unit:<3}"
            f" {length * tolerances[k]:7.2f}  {alone}"
        )
    lengths = spread(d, tolerances, 20_000)
    low, middle, high = np.quantile(lengths, [0.05, 0.5, 0.95])
    print("\nMean displacement on 20000 random benches:", end=" ")
    print(f"{middle:.1f} px in the median, {low:.1f} to {high:.1f} px in 90 % of them.")


def print_fits(bench: Bench, tolerances: np.ndarray, n: int, seed: int) -> None:
    """Hidden errors, found again from one photograph."""
    before, left, failed, conditions = [], [], 0, []
    for k in range(n):
        random = np.random.default_rng([seed, k])
        hidden = random.standard_normal(len(tolerances)) * tolerances
        seen = bench.seen(hidden)
        try:
            found = fit(bench, seen + random.normal(0, NOISE, seen.shape), tolerances, NOISE)
        except RigError:
            failed += 1
            continue
        again = bench.seen(hidden, display=bench.shown(found.amounts))
        before.append(np.nanmean(np.linalg.norm(seen - bench.view, axis=1)))
        left.append(np.nanmean(np.linalg.norm(again - bench.view, axis=1)))
        conditions.append(found.condition)
    good = sum(x < 1 for x in left) / n
    print(f"\n{n} random benches, photographs with {NOISE} px of noise; not fitted: {failed}.")
    print(f"Mean displacement before: {np.median(before):.1f} px in the median; solved again with the fit:", end=" ")
    print(f"{np.median(left):.2f} px, below 1 px in {good:.1%}.")
    print(f"Condition in the median: {np.median(conditions):.1e}. What one photograph tells of each amount:")
    shares = found.errors / tolerances
    for k in np.argsort(shares):
        print(f"  {bench.parameters[k].name:<28} to {shares[k]:5.1%} of its tolerance")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--benches", type=int, default=200, help="random benches that are fitted")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    bench = cube_bench()
    tolerances = tolerances_of(bench)
    print_sensitivities(bench, tolerances)
    if arguments.benches:
        print_fits(bench, tolerances, arguments.benches, arguments.seed)


if __name__ == "__main__":
    main()
