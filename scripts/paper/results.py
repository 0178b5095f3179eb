"""The paper's results beside ours, as pictures and tables in out/paper/: `dev.py paper`.

Runs inside Blender.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import kiriko
from environments import machine
from kiriko.core.files import disk

from .figure_5 import figure_5
from .figures_7_and_8 import figures_7_and_8, lattice_table, points_csv
from .page import page
from .plot import figure_8
from .published import SPP
from .tables import markdown


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--out", type=Path, default=Path("out/paper"), help="folder for the results (out/paper)"
    )
    parser.add_argument(
        "--spp",
        type=int,
        default=SPP,
        help=f"samples a viewer pixel of the splat ({SPP}, as in the paper)",
    )
    parser.add_argument(
        "--benches", type=int, default=200, help="random benches that are calibrated (200)"
    )
    arguments = parser.parse_args()
    import bpy

    from bench import misalignment as misaligned
    from demo import RIGS, quiet  # which registers Kiriko
    from kiriko.operators import work

    out = arguments.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    print("cube: solving, rendering, measuring ...", flush=True)
    conditions = figures_7_and_8(out)
    lattice = lattice_table(conditions)
    disk.write_text(out / "lattice.csv", points_csv(conditions))
    disk.write_text(out / "figure_8.svg", figure_8(conditions))
    print(f"\n{markdown(lattice)}\n", flush=True)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with quiet():
        RIGS["ball"]()
    times = figure_5(work.read(bpy.context).rig, arguments.spp, out)
    print(f"\n{markdown(times)}\n\n{machine()}")
    print("\nbenches that are off: derivatives, explanations, fits ...", flush=True)
    bench = misaligned.cube_bench()
    sections = {
        "Misalignment: which screw matters": misaligned.sensitivities(bench),
        "What would make the paper's numbers": misaligned.explain(
            bench.rig, misaligned.tolerance_of
        ).tables,
        "Calibration: what one photograph tells": misaligned.fits(bench, arguments.benches, seed=0),
    }
    for tables in sections.values():
        misaligned.show(tables)
    disk.write_text(out / "index.html", page(times, lattice, sections, arguments.spp))
    print(f"Files: {arguments.out}/")
    kiriko.unregister()
    sys.stdout.flush()


if __name__ == "__main__":
    main()
