"""Savings by leaving out: seconds with and without each rule of the plan: `dev.py rules`.

Measured are the plan and the trace of 65 536 rays; both ways take turns, medians are shown.
"""

import argparse
import statistics
from time import perf_counter

import numpy as np

from kiriko.core.light.trace import trace_all
from known.rules import RULES, Rule

N_RAYS = 1 << 16


def measure(rule: Rule, runs: int) -> list[float]:
    """Median seconds: plan and trace obeying the rule, plan and trace without it."""
    a_rig = rule.rig()
    w = a_rig.viewer.width
    h = a_rig.viewer.height
    rays = a_rig.viewer.rays(np.random.default_rng(0).uniform(0, (w, h), (N_RAYS, 2)))
    rule.obeyed(a_rig)  # the parts that a rule keeps are there from now on
    seconds: list[list[float]] = [[], [], [], []]

    for _ in range(runs):
        for k, make in enumerate((rule.obeyed, rule.broken)):
            started = perf_counter()
            plan = make(a_rig)
            planned = perf_counter()
            trace_all(plan, *rays)
            seconds[2 * k].append(planned - started)
            seconds[2 * k + 1].append(perf_counter() - planned)

    return [statistics.median(times) for times in seconds]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5)
    arguments = parser.parse_args()
    print(f"{'rule':<54} {'plan s':>8} {'without':>8} {'trace s':>8} {'without':>8} {'saved':>7}")
    for name, rule in RULES.items():
        plan, trace, plan_without, trace_without = measure(rule, arguments.runs)
        saved = 1 - (plan + trace) / (plan_without + trace_without)
        print(
            f"{name:<54} {plan:8.3f} {plan_without:8.3f} {trace:8.3f} {trace_without:8.3f}"
            f" {saved:7.1%}",
            flush=True,
        )


if __name__ == "__main__":
    main()
