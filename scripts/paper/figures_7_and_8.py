"""The lattice in the cube under the paper's conditions, by core and by Cycles: figures 7 and 8."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np

from demo import RIGS
from environments import quiet
from kiriko.core.base.arrays import Floats
from kiriko.core.base.steps import run_steps
from kiriko.core.blender.preview.cycles_preview import render_preview
from kiriko.core.blender.read.scene import Reading
from kiriko.core.files import image_io
from kiriko.core.image.seen_image import LatticeShift, dot_centroids, lattice_shift
from kiriko.core.rig.rig import Rig
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session
from kiriko.core.solve.solution import Solution, without_glass
from kiriko.operators import work
from pictures import light_the_glass

from .infloasion import infloasion
from .lattice import measuring_width, shift_in_cycles
from .published import HALF, PAPER_DX, PLAIN, SOURCE, Table

# of the pictures by Cycles
PIXELS = 512
SAMPLES = 64
# where Cycles is measured: with 4 its dots are off by up to 0.06 px, with 64 by 0.003
CYCLES_SAMPLES = 16


def solve(rig: Rig, **settings: float) -> Solution:
    """A solve from nothing."""
    return run_steps(Session().solve(rig, Settings(**settings)))


@dataclass(frozen=True, eq=False)
class Condition:
    """One measured method to show the lattice in the cube.

    Parameters
    ----------
    ideal : (7, 7, 2) wanted positions of the dots, px of the paper's photographs
    in_core, in_cycles : displacement from them
    """

    name: str
    ideal: Floats
    in_core: LatticeShift
    in_cycles: LatticeShift

    @property
    def apart(self) -> Floats:
        """Distances (n,) between the two simulations' dots, px."""
        return np.linalg.norm(self.in_core.shift - self.in_cycles.shift, axis=-1).ravel()


def add_halves(rig: Rig, material: object) -> None:
    """Put the glasses added by InFloasion to a rig into the Blender scene."""
    for glass in rig.glasses:
        middle = glass.mesh.bounds.mean(axis=0)  # about it float32 is most exact
        mesh = bpy.data.meshes.new(glass.name)
        mesh.from_pydata((glass.mesh.vertices - middle).tolist(), [], glass.mesh.triangles.tolist())
        mesh.materials.append(material)
        half = bpy.data.objects.new(glass.name, mesh)
        half.location = middle
        half.kiriko.role = "GLASS"
        bpy.context.scene.collection.objects.link(half)


class Bench:
    """The cube's rig as placed in Blender, solved at the viewer's own size and in the frame of the
    photographs.
    """

    def __init__(self, reading: Reading) -> None:
        self.reading = reading
        self.own = solve(reading.rig)
        self.ideal = self.own.ideal()
        viewer = reading.rig.viewer
        width = measuring_width(reading, self.ideal)
        viewer = replace(viewer, width=width, height=round(width * viewer.height / viewer.width))
        self.framed = solve(replace(reading.rig, viewers=(viewer,)))

    def measure(self, name: str, source: Floats) -> Condition:
        """Where the dots of a source image are seen."""
        seen = self.framed.seen(source)
        ideal = self.framed.ideal()
        images = source, self.ideal, self.own.seen(source)
        in_cycles = shift_in_cycles(
            bpy.context.scene, self.reading, *images, samples=CYCLES_SAMPLES
        )
        return Condition(name, dot_centroids(ideal), lattice_shift(seen, ideal), in_cycles)

    def show(self, source: Floats, path: Path) -> None:
        """A picture of the viewer's sight by Cycles, with the surroundings."""
        options = {"size": (PIXELS, PIXELS), "samples": SAMPLES, "surroundings": True}
        seen = render_preview(bpy.context.scene, self.reading, source, **options)
        image_io.write(path, seen[..., :3], "PNG8", overwrite=True)


def figures_7_and_8(out: Path) -> list[Condition]:
    """Measure the conditions, with pictures of them into `out`."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with quiet():
        RIGS["cube"]()
        bench = Bench(work.read(bpy.context))
        rig = bench.reading.rig
        plain = solve(without_glass(rig), only_through_glass=False).source
        found = [bench.measure(PLAIN, plain), bench.measure(SOURCE, bench.own.source)]
        add_halves(
            replace(rig, glasses=infloasion(rig).glasses[len(rig.glasses) :]),
            bpy.data.materials["Acrylic"],
        )
        with_half = Bench(work.read(bpy.context))
        found.insert(1, with_half.measure(HALF, plain))
        light_the_glass()
        with_half.show(plain, out / "figure_7_infloasion.png")
        for half in [thing for thing in bpy.data.objects if thing.name.endswith(" Half")]:
            bpy.data.objects.remove(half)
        bench.show(plain, out / "figure_7_plain.png")
        bench.show(bench.own.source, out / "figure_7_source.png")

    pictures = {
        "figure_7_ideal": bench.ideal,
        "display_plain": plain,
        "display_source": bench.own.source,
    }
    for name, pixels in pictures.items():
        image_io.write(out / f"{name}.png", pixels, "PNG8", overwrite=True)

    return found


def lattice_table(conditions: Sequence[Condition]) -> Table:
    """Mean displacement of the 49 points, and how far core and Cycles are apart."""
    head = (
        "condition|mean dx|mean abs dx|mean abs dy|Cycles: mean abs dx|mean abs dy|dots"
        "|apart, mean|largest|the paper's mean dx"
    )
    table = [head.split("|")]
    for condition in conditions:
        core = condition.in_core
        cycles = condition.in_cycles
        apart = condition.apart
        numbers = np.nanmean(core.shift[..., 0]), *core.mean_xy, *cycles.mean_xy
        table.append(
            [
                condition.name,
                *(f"{value:z.2f}" for value in numbers),
                f"{core.n_seen}, {cycles.n_seen}",
                *(f"{value:.3f}" for value in (np.nanmean(apart), np.nanmax(apart))),
                f"{PAPER_DX[condition.name]:.1f}",
            ]
        )

    return table
