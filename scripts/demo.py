"""The main job on the reference rigs, ball and cube, into out/; on rigs without a plate: telephone,
tablet, aquarium; or on the systems of Add Rig > More. Runs inside Blender.

Started by dev.py.
"""

from __future__ import annotations

import argparse
import json
import math
from functools import partial
from pathlib import Path
from time import perf_counter

import bpy

from environments import quiet
from known import straight_rigs
from known.registered import registered
from paper.lattice import shift_in_cycles

registered()

from kiriko.core.base.steps import run_steps  # noqa: E402
from kiriko.core.bench.systems import SYSTEMS  # noqa: E402
from kiriko.core.blender.data.stored_records import StoredNumbers  # noqa: E402
from kiriko.core.files import disk, image_io  # noqa: E402 - the operators have to be there first
from kiriko.core.image.seen_image import LatticeShift, lattice_shift  # noqa: E402
from kiriko.core.rig.settings import Settings  # noqa: E402
from kiriko.core.solve.session import Session  # noqa: E402
from kiriko.core.solve.solution import without_glass  # noqa: E402
from kiriko.operators import framing, work  # noqa: E402


def add_ball() -> None:
    """Glass ball of 25 mm radius, picture 30 mm, display 50 mm, 512 x 512 pixels all."""
    bpy.ops.kiriko.add_rig(
        field=0.05, picture_size=0.03, display_size=0.05, display_resolution=(512, 512)
    )


def add_cube() -> None:
    """Acrylic cube of 50 mm turned 15.8 degrees.

    The lattice is 30 mm wide from dot to dot, so the picture 35 mm.
    """
    bpy.ops.mesh.primitive_cube_add(size=0.05, rotation=(0, 0, math.radians(15.8)))
    cube = bpy.context.object
    cube.name = "Acrylic Cube"
    material = bpy.data.materials.new("Acrylic")
    material.use_nodes = True
    material.node_tree.nodes.clear()
    glass = material.node_tree.nodes.new("ShaderNodeBsdfGlass")
    glass.inputs["IOR"].default_value, glass.inputs["Roughness"].default_value = 1.49, 0.0
    output = material.node_tree.nodes.new("ShaderNodeOutputMaterial")
    material.node_tree.links.new(glass.outputs["BSDF"], output.inputs["Surface"])
    cube.data.materials.append(material)
    bpy.ops.kiriko.add_rig(
        field=0.05, picture_size=0.035, display_size=0.05, display_resolution=(512, 512)
    )


FIRST = {"ball": add_ball, "cube": add_cube}
SYSTEM_RIGS = {kind.lower(): partial(bpy.ops.kiriko.add_rig, kind=kind) for kind in SYSTEMS}
RIGS = {**FIRST, **straight_rigs.RIGS, **SYSTEM_RIGS}


def numbers(shift: LatticeShift) -> dict[str, object]:
    """A displacement for the report."""
    dx, dy = shift.mean_xy
    mean = {"mean_px": shift.mean, "mean_dx_px": dx, "mean_dy_px": dy}
    return {**mean, "largest_px": shift.largest, "dots": shift.n_seen}


def run(name: str, out: Path) -> list[str]:
    """Solve one rig, write its files, and return its row of the table."""
    started = perf_counter()
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    RIGS[name]()
    context = bpy.context
    scene = bpy.context.scene
    solve_started = perf_counter()
    bpy.ops.kiriko.solve()
    solve_seconds = perf_counter() - solve_started

    reading = work.read(context)
    solution = run_steps(work.session().solve(reading.rig, work.settings_of(scene)))
    plain = run_steps(
        Session().solve(without_glass(reading.rig), Settings(only_through_glass=False))
    ).source
    ideal = solution.ideal()
    seen = solution.seen()
    uncompensated = solution.seen(plain)
    in_core = {"before": lattice_shift(uncompensated, ideal), "after": lattice_shift(seen, ideal)}
    in_cycles = {
        "before": shift_in_cycles(scene, reading, plain, ideal, uncompensated),
        "after": shift_in_cycles(scene, reading, solution.image, ideal, seen),
    }

    folder = out / name
    folder.mkdir(parents=True, exist_ok=True)
    images = {
        "ideal": ideal,
        "seen_uncompensated": uncompensated,
        "seen": seen,
        "coverage": solution.display_coverage,
    }
    for file, pixels in images.items():
        title = f"Kiriko {file}"
        image_io.write(folder / f"{file}.png", pixels, "PNG8", title=title, overwrite=True)
    for form, file in (("PNG8", "source.png"), ("EXR_FLOAT", "source.exr")):
        scene.kiriko.export_format = form
        bpy.ops.kiriko.export(filepath=str(folder / file), overwrite=True)

    bpy.ops.kiriko.preview(samples=32, filepath=str(folder / "preview.png"), overwrite=True)
    framing.frame_rig(context)  # whoever opens the file sees the rig
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "rig.blend"))
    seconds = perf_counter() - started
    report = {
        "rig": name,
        "blender": bpy.app.version_string,
        "picture_coverage": solution.picture_coverage,
        "displacement_in_core": {when: numbers(s) for when, s in in_core.items()},
        "displacement_in_cycles": {when: numbers(s) for when, s in in_cycles.items()},
        "displacement_in_cycles_viewer_px_across_lattice": 1165,
        "solve_seconds": solve_seconds,
        "seconds": seconds,
        **StoredNumbers.read(scene.kiriko.result.details).by_name,
        "misses": solution.misses,
        "notes": scene.kiriko.result.notes.splitlines(),
    }
    disk.write_text(folder / "report.json", json.dumps(report, indent=2) + "\n")
    before, after = in_cycles["before"], in_cycles["after"]
    return [
        name,
        f"{100 * solution.picture_coverage:.2f} %",
        f"{before.mean:.2f} px ({before.n_seen} dots)",
        f"{after.mean:.3f} px ({after.n_seen} dots)",
        f"{solve_seconds:.2f}",
        f"{seconds:.1f}",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out"), help="folder for the results")
    which = "which rigs; ball and cube when none is named"
    parser.add_argument("--all", action="store_true", help="all rigs")
    parser.add_argument("rigs", nargs="*", choices=[*RIGS, []], help=which)
    arguments = parser.parse_args()

    rows = [["rig", "coverage", "displacement before", "after", "solve s", "all s"]]
    for name in RIGS if arguments.all else arguments.rigs or FIRST:
        print(f"{name}: solving, rendering, measuring ...", flush=True)
        with quiet():
            rows.append(run(name, arguments.out.resolve()))

    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    for row in rows:
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)))
    print(
        "\nDisplacement: mean over the 7 x 7 dots as Cycles renders them, 1165 px across.", end=""
    )
    print(f" Files: {arguments.out}/", flush=True)


if __name__ == "__main__":
    main()
