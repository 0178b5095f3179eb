"""Seconds and rays of solves through glass as artists bring it, by each choice of *Surface*.

`python3 scripts/dev.py glasses [--glass NAME ...] [--surface CHOICE ...] [--effort RAYS] [--numpy] [--threads N]`.
Seconds, and processor seconds of all threads, of whole solves at default settings, 512 x 512 pixels. `curved` is the
share of the triangles with a curved face, `beyond` that of what is seen off by more than the tolerance, `sampled` where
light is chaotic.
"""

from __future__ import annotations

import argparse
from contextlib import nullcontext
from dataclasses import replace
from time import perf_counter, process_time

from bench_irregular import CHOICES
from glasses import GLASSES, INDICES, made
from reference_rigs import rig

from kiriko.core import kernel
from kiriko.core.plan import Settings, make_plan
from kiriko.core.session import Session, finish

BENCH = {"field": 0.06, "picture": 0.035, "display": 0.1}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--glass", nargs="+", metavar="NAME", choices=GLASSES, default=list(GLASSES), help="only these")
    parser.add_argument("--surface", nargs="+", choices=CHOICES, default=list(CHOICES), help="only these choices")
    parser.add_argument("--effort", type=int, default=Settings().effort, metavar="RAYS", help="where light is chaotic")
    parser.add_argument("--numpy", action="store_true", help="without the compiled kernel")
    parser.add_argument("--threads", type=int, default=0, metavar="N", help="of the kernel; as many as there are")
    arguments = parser.parse_args()
    kernel.use_threads(arguments.threads)
    with kernel.off() if arguments.numpy else nullcontext():
        print_table(arguments)


def print_table(arguments: argparse.Namespace) -> None:
    numbers = f"{'curved':>8}{'s':>8}{'CPU s':>8}{'rays':>10}{'beyond %':>10}{'sampled %':>11}"
    print(f"{'glass':<16}{'triangles':>10}{'surface':>11}{numbers}")
    settings = Settings(effort=arguments.effort)
    for name in arguments.glass:
        mesh = made(name)
        for choice in arguments.surface:
            a_rig = rig(replace(mesh, surface=choice), ior=INDICES.get(name, 1.49), **BENCH)
            share = sum(make_plan(a_rig, settings).n_curved) / len(mesh.triangles)
            started, of_processor = perf_counter(), process_time()
            solution = finish(Session().solve(a_rig, settings))
            seconds, of_processor = perf_counter() - started, process_time() - of_processor
            error = solution.map_error
            beyond = 100 * (error.facet_limited + error.unresolved)
            told = f"{share:8.2f}{seconds:8.1f}{of_processor:8.1f}{solution.n_rays:10d}"
            told += f"{beyond:10.2f}{100 * error.sampled:11.2f}"
            print(f"{name:<16}{len(mesh.triangles):10d}{choice:>11}{told}", flush=True)


if __name__ == "__main__":
    main()
