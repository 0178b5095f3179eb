"""Optics against mpmath at fifty digits, and rays at vertices that may not leak: `dev.py judge`.

Of 100 000 random cases of each kind, hard ones among them: the worst relative error where the
problem is a good one (k > 1e-6), the worst part of its mark (1e-12 there, 4 eps / sqrt k below),
how many cases are of the wrong class, and by how much others missed the class.

`--leaks`: rays aimed at all vertices and all middles of edges of closed meshes, from outside and
from inside, straight on and refracted.
"""

import argparse
import time
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from known.judges import JUDGES
from known.leaks import leak_cases, leaks_of

from .runner import MISSED, Bench, Row, option, run

Floats = NDArray[np.float64]


def verdicts(_: str, ask: Callable, arguments: argparse.Namespace) -> Iterator[Row]:
    """Findings of one judge on random cases."""
    started = time.process_time()
    for v in ask(arguments.cases, arguments.seed):
        seconds = time.process_time() - started
        started = time.process_time()
        yield {
            "what": v.what,
            "cases": v.n_cases,
            "worst error": v.error,
            "of its mark": v.part,
            "wrong": v.n_wrong,
            "off": v.off,
            "kept": "yes" if v.is_kept else MISSED,
            "s": seconds,
            "where": v.where,
        }


def leaking(_: str, size: int, __: argparse.Namespace) -> Iterator[Row]:
    """How many rays escape from each mesh of a size."""
    for shape, kind, mesh in leak_cases(size):
        started = time.process_time()
        found = leaks_of(shape, mesh)
        yield {
            "mesh": f"{shape}, {kind}",
            "triangles": len(mesh.triangles),
            "rays": found.n_rays,
            "lost inside": found.lost,
            "side unseen": found.odd,
            "missed": found.missed,
            "kept": MISSED if any(found[2:]) else "yes",
            "s": time.process_time() - started,
        }


VERDICTS = {
    "what": "", "cases": "d", "worst error": ".1e", "of its mark": ".2g", "wrong": "d",
    "off": ".0e", "kept": "s", "s": ".0f", "where": "",
}  # fmt: skip
LEAKS = {
    "mesh": "", "triangles": "d", "rays": "d", "lost inside": "d", "side unseen": "d",
    "missed": "d", "kept": "s", "s": ".0f",
}  # fmt: skip

if __name__ == "__main__":
    run(
        __doc__,
        "bench.judge",
        Bench({ask.__name__: ask for ask in JUDGES}, VERDICTS, verdicts),
        option("--cases", type=int, default=100_000, help="of each kind"),
        option("--seed", type=int, default=0),
        leaks=Bench({"5 000 triangles": 0, "82 000 triangles": 1}, LEAKS, leaking),
    )
