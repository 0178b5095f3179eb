"""The paper's results next to Kiriko's, as tables and pictures in out/paper/: `dev.py paper`.

`cube`: the lattice in the cube, figures 7 and 8. `ball`: the ball's source image, figure 5.
`misalignment`: which part of the cube's bench matters, and how much one photograph shows of it.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from environments import machine

from .published import SPP, markdown

PARTS = "cube", "ball", "misalignment"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=PARTS, default=PARTS, help="these parts")
    parser.add_argument(
        "--out", type=Path, default=Path("out/paper"), help="folder for the results (out/paper)"
    )
    parser.add_argument(
        "--spp", type=int, default=SPP, help=f"samples a viewer pixel of the splat ({SPP})"
    )
    parser.add_argument(
        "--benches", type=int, default=200, help="random benches that are calibrated (200)"
    )
    arguments = parser.parse_args()
    out = arguments.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    print(f"{machine()}. Files: {arguments.out}/", flush=True)
    if "cube" in arguments.only:
        show_cube(out)
    if "ball" in arguments.only:
        show_ball(out, arguments.spp)
    if "misalignment" in arguments.only:
        show_misalignment(arguments.benches)


def show_cube(out: Path) -> None:
    """Measure the lattice in the cube in each condition."""
    from .figures_7_and_8 import figures_7_and_8, lattice_table

    conditions = figures_7_and_8(out)
    print(f"\n{markdown(lattice_table(conditions))}", flush=True)


def show_ball(out: Path, spp: int) -> None:
    """Measure the ball's source image by each plate and each way."""
    import bpy

    from demo import RIGS  # which registers Kiriko
    from environments import quiet
    from kiriko.operators import work

    from .figure_5 import figure_5

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with quiet():
        RIGS["ball"]()
    print(f"\n{markdown(figure_5(work.read(bpy.context).rig, spp, out))}", flush=True)


def show_misalignment(benches: int) -> None:
    """Measure the effect of a misaligned bench, and the information in its photograph."""
    from .misalignment import cube_bench, fits, sensitivities

    bench = cube_bench()
    for tables in (sensitivities(bench), fits(bench, benches, seed=0)):
        for about, table in tables.items():
            print(f"\n{about}:\n\n{markdown(table)}", flush=True)


if __name__ == "__main__":
    main()
