"""The paper's results beside ours, as pictures and tables in out/paper/: `dev.py paper`.

Runs inside Blender, which is imported only where it is
asked: geometry and measures in core run without.
"""

from __future__ import annotations

import argparse
import html
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter, process_time
from typing import TYPE_CHECKING, TypeVar

import numpy as np

import kiriko
from environments import machine
from kiriko.core import image_io
from kiriko.core.arrays import Floats
from kiriko.core.image.seen_image import LatticeShift, dot_centroids, lattice_shift
from kiriko.core.image.source_image import splat
from kiriko.core.light.optics import reflect
from kiriko.core.light.planning import make_plan
from kiriko.core.rig import PRESETS, Mesh, Rig
from kiriko.core.settings import Settings
from kiriko.core.solve.session import Session
from kiriko.core.solve.solution import Solution, without_glass
from kiriko.core.steps import finish
from kiriko.core.vectors import normalise

if TYPE_CHECKING:
    from kiriko.core.blender.scene import Reading

SPP = 100
# m of air between the display and the half glass before it, so that the two are not in one place
GAP = 1e-6
# of what is called converged: viewer pixels each way times as many, tolerance in display px
FINER = 2
FINEST = 1e-3
# of the pictures by Cycles
PIXELS = 512
SAMPLES = 64
# where Cycles is measured: with 4 its dots are off by up to 0.06 px, with 64 by 0.003
CYCLES_SAMPLES = 16
# the conditions, as the paper has them
PLAIN = "no compensation"
HALF = "InFloasion"
SOURCE = "source image"
# on 32 cores of a Threadripper 3970X, 100 spp
PAPER_SECONDS = {"ideal plate": 5.1, "mirror array": 2552.8}
PAPER_DX = {PLAIN: 276.1, HALF: 155.4, SOURCE: 62.8}  # px, mean over the 49 points of photographs
COLOURS = {"ideal": "#888888", PLAIN: "#c8501e", HALF: "#3f7d20", SOURCE: "#0b6e99"}

ABOUT_TIMES = (
    "RMSE of linear values over all display pixels that are wholly seen, against Kiriko's own"
    " image at 2 x 2 times the viewer pixels and a tolerance of 0.001 display pixels. A second"
    " splat with samples of its own, a quarter of them, tells the noise from what both have in"
    " common: what the splat would keep at any number of samples. The paper's times are of 32"
    " cores of a Threadripper 3970X."
)
ABOUT_LATTICE = (
    "Against the ideal image, in pixels of a frame in which the lattice is 1165 px wide from dot"
    " to dot, over 49 dots; dx to the right, dy downward. Apart: distance between the dots of"
    " core's simulation and of Cycles. The paper measured photographs."
)

Table = list[list[str]]
Result = TypeVar("Result")


# InFloasion


def half_before(mesh: Mesh, point: Floats, normal: Floats) -> Mesh:
    """The part of a flat-faced convex solid that lies before a plane, closed by the cut.

    Parameters
    ----------
    point, normal : (3,) of the plane, m and unit; what lies along the normal stays
    """
    height = (mesh.vertices - point) @ normal
    vertices = list(mesh.vertices)
    cuts: dict[tuple[int, int], int] = {}  # vertices on the plane, by the edge they cut

    def cut(a: int, b: int) -> int:
        a, b = min(a, b), max(a, b)
        if (a, b) not in cuts:
            cuts[a, b] = len(vertices)
            share = height[a] / (height[a] - height[b])
            vertices.append(mesh.vertices[a] + share * (mesh.vertices[b] - mesh.vertices[a]))
        return cuts[a, b]

    triangles = []
    for corners in mesh.triangles.tolist():
        kept = []
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
            if height[a] > 0:
                kept.append(a)
            if (height[a] > 0) != (height[b] > 0):
                kept.append(cut(a, b))
        triangles += [[kept[0], kept[k], kept[k + 1]] for k in range(1, len(kept) - 1)]
    rim = np.array(list(cuts.values()), int)
    if len(rim):
        across = normalise(np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))]))
        around = np.array(vertices)[rim]
        around = around - around.mean(axis=0)
        order = rim[np.argsort(np.arctan2(around @ np.cross(normal, across), around @ across))][
            ::-1
        ]
        triangles += [[order[0], order[k], order[k + 1]] for k in range(1, len(order) - 1)]
    return Mesh(np.array(vertices), np.array(triangles, int).reshape(-1, 3))


def mirrored(mesh: Mesh, point: Floats, normal: Floats) -> Mesh:
    """The mirror image of a flat-faced solid in a plane, its faces outward again."""
    vertices = point + reflect(mesh.vertices - point, normal[None])
    return Mesh(vertices, mesh.triangles[:, ::-1].copy())


def face_of(mesh: Mesh) -> tuple[Floats, Floats]:
    """A point (3,) and the unit normal (3,) of a plane mesh."""
    a, b, c = mesh.corners[0]
    return a, normalise(np.cross(b - a, c - a))


def infloasion(rig: Rig) -> Rig:
    """The rig with the mirror image of the half of its glass
    on the plate's side, standing on the display.

    The aerial plane cuts the glass; its mirror image in the plate is the display. Light of a point
    of the display goes through the mirrored half as it does, by symmetry, through the half behind
    the plate, and meets again in the point's mirror image: what is left is the bending by the half
    on the viewer's side.
    """
    plate = face_of(rig.plates[0].mesh)
    (display, front) = face_of(rig.display.mesh)
    halves = [
        replace(
            glass,
            name=f"{glass.name} Half",
            mesh=half_before(mirrored(glass.mesh, *plate), display + GAP * front, front),
        )
        for glass in rig.glasses
    ]
    return replace(
        rig, glasses=(*rig.glasses, *(half for half in halves if len(half.mesh.triangles)))
    )


# Figure 5 and the times


def solve(rig: Rig, **settings: float) -> Solution:
    """A solve from nothing."""
    return finish(Session().solve(rig, Settings(**settings)))


def converged(rig: Rig) -> Solution:
    """The rig solved far finer than it is shown."""
    viewer = rig.viewer
    viewer = replace(viewer, width=FINER * viewer.width, height=FINER * viewer.height)
    return solve(replace(rig, viewers=(viewer,)), tolerance=FINEST)


def rmse(one: Floats, other: Floats | None = None) -> float:
    """Root of the mean product of two errors: of one error its
    RMSE, of two with noise of their own what they share.
    """
    return float(np.sqrt(max(np.mean(one * (one if other is None else other)), 0.0)))


def holes(source: Floats, best: Solution) -> int:
    """How many display pixels (H, W, 3) are black where the converged image is bright."""
    return int(
        (
            (best.display_coverage > 0.999)
            & (source.max(axis=2) == 0)
            & (best.source.max(axis=2) > 0.5)
        ).sum()
    )


def timed(run: Callable[[], Result]) -> tuple[Result, list[str]]:
    """What a run returns, with seconds that passed and the processor's as a table has them."""
    started = perf_counter()
    busy = process_time()
    found = run()
    return found, [
        f"{seconds:.2f}" for seconds in (perf_counter() - started, process_time() - busy)
    ]


def by_both_ways(rig: Rig, spp: int, out: Path, stem: str) -> Table:
    """Two rows, of Kiriko and of the splat, for the ball's source image by one plate.

    Pictures into `out`.
    """
    best = converged(rig)
    is_judged = best.display_coverage > 0.999
    solution, seconds = timed(lambda: solve(rig))
    error = rmse((solution.source - best.source)[is_judged])
    shown = f"{error:.4f}", "0", f"{error:.4f}", str(holes(solution.source, best))
    rows = [["Kiriko", f"{solution.n_rays:,}", *seconds, *shown]]

    # stray light weighs by what mirrors leave of it; with the ideal plate there is none
    plan = make_plan(rig, Settings(brightness=rig.plates[0].array is not None))
    image, seconds = timed(lambda: finish(splat(plan, spp, 1, "folded")))
    off, again = (
        (some - best.source)[is_judged]
        for some in (image, finish(splat(plan, max(spp // 4, 1), 2, "folded")))
    )
    error = rmse(off)
    shared = rmse(off, again)
    noise = np.sqrt(max(error**2 - shared**2, 0.0))
    n_rays = spp * rig.viewer.width * rig.viewer.height
    shown = f"{error:.4f}", f"{noise:.4f}", f"{shared:.4f}", str(holes(image, best))
    rows.append([f"splat, {spp} spp", f"{n_rays:,}", *seconds, *shown])
    for way, pixels in (("splat", image), ("kiriko", solution.source)):
        image_io.write(out / f"figure_5_{stem}_{way}.png", pixels, "PNG8", overwrite=True)
    return rows


def figure_5(rig: Rig, spp: int, out: Path) -> Table:
    """The ball's source image by each plate and each way: pictures into `out`, and the table."""
    table = [
        [
            "plate",
            "way",
            "rays",
            "seconds",
            "processor s",
            "RMSE",
            "of it noise",
            "shared by all runs",
            "holes",
        ]
    ]
    for name, array in {"ideal plate": None, "mirror array": PRESETS["ASKA3D-488"]}.items():
        print(
            f"ball, {name}: solving, and {spp} + {max(spp // 4, 1)} samples a pixel by splat ...",
            flush=True,
        )
        this = replace(rig, plates=tuple(replace(plate, array=array) for plate in rig.plates))
        table += [[name, *row] for row in by_both_ways(this, spp, out, name.replace(" ", "_"))]
        paper = [name, f"the paper's, {SPP} spp", "26.2 M paths", f"{PAPER_SECONDS[name]:.1f}"]
        table.append([*paper, *("not given" for _ in range(5))])
    return table


# Figures 7 and 8


@dataclass(frozen=True, eq=False)
class Condition:
    """One way to show the lattice in the cube, as it was measured.

    Parameters
    ----------
    ideal : (7, 7, 2) where the dots are wanted, px of the paper's photographs
    in_core, in_cycles : displacement against that
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
    """Put the glasses that InFloasion adds to a rig into the Blender scene."""
    import bpy

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
    """The cube's rig as it stands in Blender, solved at the
    viewer's own size and in the frame of the photographs.
    """

    def __init__(self, reading: Reading) -> None:
        from .lattice import measuring_width

        self.reading = reading
        self.own = solve(reading.rig)
        self.ideal = self.own.ideal()
        viewer = reading.rig.viewer
        width = measuring_width(reading, self.ideal)
        viewer = replace(viewer, width=width, height=round(width * viewer.height / viewer.width))
        self.framed = solve(replace(reading.rig, viewers=(viewer,)))

    def measure(self, name: str, source: Floats) -> Condition:
        """Where the dots of a source image are seen."""
        import bpy

        from .lattice import shift_in_cycles

        seen = self.framed.seen(source)
        ideal = self.framed.ideal()
        images = source, self.ideal, self.own.seen(source)
        in_cycles = shift_in_cycles(
            bpy.context.scene, self.reading, *images, samples=CYCLES_SAMPLES
        )
        return Condition(name, dot_centroids(ideal), lattice_shift(seen, ideal), in_cycles)

    def show(self, source: Floats, path: Path) -> None:
        """A picture of what the viewer sees by Cycles, with the surroundings."""
        import bpy

        from kiriko.core.blender.preview import render_preview

        options = {"size": (PIXELS, PIXELS), "samples": SAMPLES, "surroundings": True}
        seen = render_preview(bpy.context.scene, self.reading, source, **options)
        image_io.write(path, seen[..., :3], "PNG8", overwrite=True)


def figures_7_and_8(out: Path) -> list[Condition]:
    """Measure the conditions, with pictures of them into `out`."""
    import bpy

    from demo import RIGS, quiet
    from kiriko.operators import work
    from pictures import light_the_glass

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
    head = ["condition", "mean dx", "mean abs dx", "mean abs dy", "Cycles: mean abs dx",
    "mean abs dy", "dots",
            "apart, mean", "largest", "the paper's mean dx"]  # fmt: skip
    table = [head]
    for condition in conditions:
        core = condition.in_core
        cycles = condition.in_cycles
        apart = condition.apart
        numbers = np.nanmean(core.shift[..., 0]), *core.mean_xy, *cycles.mean_xy
        table.append([
            condition.name,
            *(f"{value:z.2f}" for value in numbers),
            f"{core.n_seen}, {cycles.n_seen}",
            *(f"{value:.3f}" for value in (np.nanmean(apart), np.nanmax(apart))),
            f"{PAPER_DX[condition.name]:.1f}",
        ])  # fmt: skip
    return table


def points_csv(conditions: Sequence[Condition]) -> str:
    """All 49 points in each condition, counted from 1, px of a frame 1165 px from dot to dot."""
    lines = ["condition,column,row,ideal x,ideal y,core dx,core dy,Cycles dx,Cycles dy"]
    for condition in conditions:
        for j, i in np.ndindex(condition.ideal.shape[:2]):
            values = (
                *condition.ideal[j, i],
                *condition.in_core.shift[j, i],
                *condition.in_cycles.shift[j, i],
            )
            lines.append(
                ",".join(
                    [condition.name, str(i + 1), str(j + 1), *(f"{value:.3f}" for value in values)]
                )
            )
    return "\n".join([*lines, ""])


def figure_8(conditions: Sequence[Condition]) -> str:
    """Where the 49 points stand in each condition, as SVG: px from the middle of the ideal grid."""
    ideal = conditions[0].ideal
    sets = {
        "ideal": ideal,
        **{condition.name: condition.ideal + condition.in_core.shift for condition in conditions},
    }
    middle = ideal.mean(axis=(0, 1))
    every = np.concatenate([points.reshape(-1, 2) for points in sets.values()]) - middle
    size, margin = 720, 60
    reach = 100 * np.ceil(np.nanmax(np.abs(every)) / 100)
    scale = (size - 2 * margin) / (2 * reach)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{size}" height="{size + 40}" viewBox="0 0'
        f' {size} {size + 40}"'
        ' font-family="Helvetica, Arial, sans-serif" font-size="13">',
        f'<rect width="{size}" height="{size + 40}" fill="white"/>',
    ]
    for tick in np.arange(-reach, reach + 1, 200):
        at = size / 2 + scale * tick
        parts += [
            f'<path d="M{at:.1f} {margin}V{size - margin}M{margin} {at:.1f}H{size - margin}"'
            f' stroke="#e5e5e5"/>',
            f'<text x="{at:.1f}" y="{size - margin + 18}" text-anchor="middle">{tick:.0f}</text>',
            f'<text x="{margin - 8}" y="{at + 4:.1f}" text-anchor="end">{tick:.0f}</text>',
        ]
    parts.append(
        f'<text x="{size / 2}" y="{size - 16}" text-anchor="middle">x, camera px (y'
        f" downward)</text>"
    )
    # a shift is nearly as long as from dot to dot: lines tell which point is which
    for way in np.moveaxis(
        size / 2 + scale * (np.stack(list(sets.values())) - middle), 0, 2
    ).reshape(-1, len(sets), 2):
        line = " ".join(f"{x:.2f},{y:.2f}" for x, y in way[np.isfinite(way[:, 0])])
        parts.append(f'<polyline points="{line}" fill="none" stroke="#bbbbbb"/>')
    for n, (name, points) in enumerate(sets.items()):
        colour = COLOURS[name]
        radius = 6 if name == "ideal" else 3.5
        look = (
            f'fill="none" stroke="{colour}" stroke-width="1.5"'
            if name == "ideal"
            else f'fill="{colour}"'
        )
        for x, y in size / 2 + scale * (points.reshape(-1, 2) - middle):
            if np.isfinite(x):
                parts.append(f'<circle cx="{x:.2f}" cy="{y:.2f}" r="{radius}" {look}/>')
        parts += [
            f'<circle cx="{margin + 160 * n}" cy="{size + 16}" r="{radius}" {look}/>',
            f'<text x="{margin + 160 * n + 12}" y="{size + 20}">{name}</text>',
        ]
    return "\n".join([*parts, "</svg>", ""])


# What is shown

STYLE = """
body { font: 15px sans-serif; max-width: 1200px; margin: 2em auto }
td, th { padding: 3px 9px; border-bottom: 1px solid #ccc; text-align: right }
figure { display: inline-block; margin: 6px }
img { width: 270px }
img.plot { width: 720px }
"""


def markdown(table: Table) -> str:
    """A table as the page in docs has it."""
    lines = [f"| {' | '.join(row)} |" for row in table]
    return "\n".join([lines[0], "|" + "---|" * len(table[0]), *lines[1:]])


def html_table(table: Table) -> str:
    rows = [[html.escape(cell) for cell in row] for row in table]
    head = "".join(f"<th>{cell}</th>" for cell in rows[0])
    body = ("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows[1:])
    return f"<table><tr>{head}</tr>{''.join(body)}</table>"


def figures(names: dict[str, str]) -> str:
    """Pictures side by side: files and what they show."""
    return "".join(
        f'<figure><img src="{file}" alt="{text}"><figcaption>{text}</figcaption></figure>'
        for file, text in names.items()
    )


def page(times: Table, lattice: Table, bench: dict[str, dict[str, Table]], spp: int) -> str:
    """index.html. bench : tables by what they are about, in sections."""
    return "\n".join([
        f"<!doctype html><meta charset=utf-8><title>The paper's results beside"
        f" ours</title><style>{STYLE}</style>",
        "<h1>The paper's results beside ours</h1>",
        "<h2>Figure 5: the ball's source image, and the times</h2>",
        figures({
            "figure_5_ideal_plate_splat.png": f"ideal plate, splat, {spp} spp",
            "figure_5_ideal_plate_kiriko.png": "ideal plate, Kiriko",
            "figure_5_mirror_array_splat.png": f"mirror array, splat, {spp} spp",
            "figure_5_mirror_array_kiriko.png": "mirror array, Kiriko",
        }),
        html_table(times),
        f"<p>{html.escape(ABOUT_TIMES)} Ours: {html.escape(machine())}.</p>",
        "<h2>Figures 7 and 8: the cube, in four conditions</h2>",
        figures({
            "figure_7_ideal.png": "ideal image",
            "figure_7_plain.png": f"{PLAIN}, by Cycles",
            "figure_7_infloasion.png": f"{HALF}, by Cycles",
            "figure_7_source.png": f"{SOURCE}, by Cycles",
        }),
        html_table(lattice),
        f"<p>{html.escape(ABOUT_LATTICE)}</p>",
        '<p><a href="lattice.csv">All points (CSV)</a></p><img class="plot" src="figure_8.svg"'
        ' alt="figure 8">',
        figures({
            "display_plain.png": f"what the display shows: {PLAIN} and {HALF}",
            "display_source.png": f"what it shows: {SOURCE}",
        }),
        *(
            f"<h2>{html.escape(section)}</h2>"
            + "".join(f"<p>{html.escape(about)}:</p>{html_table(table)}" for about,
            table in tables.items())
            for section, tables in bench.items()
        ),
        "",
    ])  # fmt: skip


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
    image_io.write_text(out / "lattice.csv", points_csv(conditions))
    image_io.write_text(out / "figure_8.svg", figure_8(conditions))
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
    image_io.write_text(out / "index.html", page(times, lattice, sections, arguments.spp))
    print(f"Files: {arguments.out}/")
    kiriko.unregister()
    sys.stdout.flush()


if __name__ == "__main__":
    main()
