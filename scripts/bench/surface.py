"""Display error against triangles, for facets and for curved faces, held to closed forms.

`python3 scripts/dev.py surface [--most N] [--mean] [--plot FILE]`.

The rig is reference_rigs.rig with a display of 0.2 m and 512 px. Judged are those of 20 000 random
rays that, by the closed form, are far from grazing and from edges and land in the display's middle,
80 % of its side: the same rays for all curves. Rays that a mesh loses are counted, and left out
of its errors.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from kiriko.core.light.compile_plan import make_plan
from kiriko.core.light.trace import trace_all
from kiriko.core.rig.rig import Mesh, Rig
from kiriko.core.rig.settings import Settings
from known import closed_forms
from known.reference_rigs import mean_normals, rig, torus, uv_ellipsoid, wavy_slab

Floats = NDArray[np.float64]

N = 1.49
RAYS = 20_000
# |cos| to the normal, in or out: nearer to grazing,
# facets send single rays anywhere and rule the rms
GRAZING = 0.3
MIDDLE = 0.8  # of the display's side: so far from its border a landing is judged
OPTIONS = {"display": 0.2, "display_pixels": 512, "ior": N}
BALL = (0.025,) * 3
ELLIPSOID = (0.025, 0.020, 0.015)
TORUS = (0.018, 0.007)
LENTIL = (0.025, 0.025, 0.012)
BLENDERS_TORUS = (0.020, 0.005)  # of the proportions that Add > Mesh > Torus gives it
SEGMENTS = (10, 16, 32, 64, 128, 256, 512, 1024)
FIT_FROM = 64  # segments: coarser meshes do not yet show an order
FLOOR = 1e-6  # px: below, rounding and the end of the Newton steps set the error, not the mesh


@dataclass(frozen=True)
class Shape:
    """A solid: its mesh of some segments x half as many rings (x 2
    sides, for the slab), rays through it exactly.
    """

    mesh: Callable[[int], Mesh]
    through: Callable[[Floats, Floats], tuple[Floats, Floats, NDArray[np.bool_]]]


def through_ellipsoid(
    o: Floats, d: Floats, radii: tuple[float, ...]
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """The closed form, and which rays neither enter nor leave at a grazing angle."""
    p, e = closed_forms.through_ellipsoid(o, d, radii, N)
    # light goes back the way it came
    entry, _ = closed_forms.through_ellipsoid(p + e, -e, radii, N)
    normals = (closed_forms.unit(at / np.square(radii)) for at in (entry, p))
    slopes = [
        np.abs((ray * normal).sum(axis=1)) for ray, normal in zip((d, e), normals, strict=True)
    ]
    return p, e, np.minimum(*slopes) > GRAZING


SHAPES = {
    "ball": Shape(
        lambda s: uv_ellipsoid(BALL, s, s // 2, pole=1), lambda o, d: through_ellipsoid(o, d, BALL)
    ),
    "ellipsoid": Shape(
        lambda s: uv_ellipsoid(ELLIPSOID, s, s // 2),
        lambda o, d: through_ellipsoid(o, d, ELLIPSOID),
    ),
    "torus": Shape(
        lambda s: torus(*TORUS, s, s // 2),
        lambda o, d: closed_forms.through_torus(o, d, *TORUS, N, GRAZING),
    ),
    "wavy slab": Shape(
        lambda s: wavy_slab(s // 2, 0.075, 0.02, 0.001),
        lambda o, d: closed_forms.through_wavy_slab(o, d, 0.075, 0.02, 0.001, N, GRAZING),
    ),
}
# judged elsewhere only: the torus is of some segments x a quarter as many around the tube
BLENDERS = {
    "lentil": Shape(
        lambda s: uv_ellipsoid(LENTIL, s, s // 2), lambda o, d: through_ellipsoid(o, d, LENTIL)
    ),
    "Blender's torus": Shape(
        lambda s: torus(*BLENDERS_TORUS, s, s // 4),
        lambda o, d: closed_forms.through_torus(o, d, *BLENDERS_TORUS, N, GRAZING),
    ),
}
KINDS = ("facet normals", "interpolated normals", "curved faces")


@dataclass(frozen=True)
class Judged:
    """Rays (n, 3) with exact landings (n, 2), display px, and
    how many of the random rays were left out, and why.
    """

    origins: Floats
    directions: Floats
    xy: Floats
    unknown: int
    irregular: int
    outside: int


@cache
def judged(shape: str) -> Judged:
    """The rays that all curves of a shape are judged by."""
    solid = (SHAPES | BLENDERS)[shape]
    a_rig = rig(solid.mesh(16), **OPTIONS)
    viewer, display = a_rig.viewer, a_rig.display
    o, d = viewer.rays(
        np.random.default_rng(3).uniform(0, [viewer.width, viewer.height], (RAYS, 2))
    )
    p, e, is_regular = solid.through(o, d)
    xy = closed_forms.landing(a_rig, p, e)
    known = np.isfinite(p[:, 0])
    is_regular = known & is_regular
    lands = is_regular & (np.abs(xy / [display.width, display.height] - 0.5) < MIDDLE / 2).all(
        axis=1
    )

    return Judged(
        o[lands],
        d[lands],
        xy[lands],
        (~known).sum(),
        (known & ~is_regular).sum(),
        (is_regular & ~lands).sum(),
    )


def drawn(shape: str, segments: int, kind: str, mean: bool = False) -> Rig:
    """The rig with the shape's mesh: own or mean normals, as facets or as curved faces."""
    mesh = SHAPES[shape].mesh(segments)
    if mean:
        mesh = mean_normals(mesh)
    if kind == "facet normals":
        mesh = replace(mesh, is_smooth=None)
    mesh = replace(mesh, surface="smooth" if kind == "curved faces" else "facets")
    return rig(mesh, **OPTIONS)


def distances(shape: str, segments: int, kind: str, mean: bool = False) -> Floats:
    """Display px (n,) from each judged ray's landing to the exact one; NaN where it was lost."""
    rays = judged(shape)
    landings = trace_all(
        make_plan(drawn(shape, segments, kind, mean), Settings()), rays.origins, rays.directions
    )
    return np.linalg.norm(landings.xy - rays.xy, axis=1)


def rms(px: Floats) -> float:
    """Root of the mean square of the distances that are known."""
    return float(np.sqrt(np.nanmean(px**2)))


def errors(shape: str, segments: int, kind: str, mean: bool = False) -> float:
    """Display error, rms px, of one mesh."""
    return rms(distances(shape, segments, kind, mean))


def order(triangles: list[int], px: list[float]) -> float:
    """Slope of log error against log edge (triangles^-1/2), over
    the errors above the floor; NaN if fewer than 2.
    """
    used = np.array(px) > FLOOR
    if used.sum() < 2:
        return np.nan
    return float(
        np.polyfit(-0.5 * np.log(np.array(triangles)[used]), np.log(np.array(px)[used]), 1)[0]
    )


@dataclass(frozen=True)
class Curve:
    """One kind of surface of one shape, from coarse to fine.

    All lists of the same length, errors in display px.
    """

    segments: list[int]
    triangles: list[int]
    rms: list[float]
    p99: list[float]
    lost: list[int]

    @property
    def order(self) -> float:
        fitted = [k for k, s in enumerate(self.segments) if s >= FIT_FROM]
        return order([self.triangles[k] for k in fitted], [self.rms[k] for k in fitted])


def curve(shape: str, kind: str, most: int, mean: bool = False) -> Curve:
    """Errors of the meshes that have no more than `most` triangles."""
    found = Curve([], [], [], [], [])
    for segments in SEGMENTS:
        n = len(SHAPES[shape].mesh(segments).triangles)
        if n > most:
            break
        px = distances(shape, segments, kind, mean)
        found.segments.append(segments)
        found.triangles.append(n)
        found.rms.append(rms(px))
        found.p99.append(float(np.nanquantile(px, 0.99)))
        found.lost.append(int(np.isnan(px).sum()))
    return found


def table(curves: dict[str, dict[str, Curve]]) -> None:
    """Print rms, 99th percentile and lost rays, with the orders."""
    for shape, kinds in curves.items():
        rays = judged(shape)
        print(
            f"\n{shape}: {len(rays.xy)} of {RAYS} rays judged. Left out: {rays.unknown} that"
            f" miss the glass or are"
        )
        print(
            f"totally reflected, {rays.irregular} near grazing or an edge, {rays.outside} beside"
            f" the display's middle."
        )
        print(f"{'':>9} " + " ".join(f"{kind:>31}" for kind in kinds))
        print(f"{'triangles':>9} " + f"{'rms px':>12} {'99 % px':>11} {'lost':>6} " * len(kinds))
        for k, n in enumerate(next(iter(kinds.values())).triangles):
            print(
                f"{n:9d} "
                + " ".join(
                    f"{c.rms[k]:12.3g} {c.p99[k]:11.3g} {c.lost[k]:6d}" for c in kinds.values()
                )
            )
        print(f"{'order':>9} " + " ".join(f"{c.order:12.2f}{'':19}" for c in kinds.values()))

    print(f"\nOrders are fitted to the rms from {FIT_FROM} segments on, above {FLOOR} px.")


def thirty_two_by_sixteen(mean: bool) -> None:
    """Print how many times better curved faces are on an artist's usual mesh."""
    print("\n32 x 16 faces: error of interpolated normals / error of curved faces")
    for shape in ("ellipsoid", "torus"):
        interpolated, curved = (errors(shape, 32, kind, mean) for kind in KINDS[1:])
        print(
            f"{shape:>9} {interpolated:8.3f} px / {curved:8.4f} px = {interpolated / curved:6.1f}"
        )


def plot(curves: dict[str, dict[str, Curve]], file: str) -> None:
    """Draw a panel for each shape, as SVG or in another
    format, by the file's ending. Needs matplotlib.
    """
    import matplotlib as mpl

    mpl.use("Agg")
    # the same curves give the same, small file
    mpl.rcParams.update({"svg.hashsalt": "kiriko", "svg.fonttype": "none"})
    from matplotlib import pyplot

    figure, panels = pyplot.subplots(
        2, 2, figsize=(9, 7), sharex=True, sharey=True, layout="constrained"
    )
    for panel, (shape, kinds) in zip(panels.ravel(), curves.items(), strict=True):
        for (kind, c), marker in zip(kinds.items(), "s^o", strict=True):
            panel.loglog(
                c.triangles,
                c.rms,
                marker=marker,
                markersize=4,
                label=f"{kind}: order {c.order:.1f}",
            )
        panel.axhline(1, color="0.6", linewidth=0.8, linestyle=":")
        panel.set_title(shape)
        panel.minorticks_off()
        panel.grid(alpha=0.3)
        panel.legend(fontsize=8, loc="lower left")

    for panel in panels[-1]:
        panel.set_xlabel("triangles")
    for panel in panels[:, 0]:
        panel.set_ylabel("error on the display, rms (px of 512)")
    figure.savefig(file, metadata={"Date": None} if file.endswith(".svg") else None)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--most", type=int, default=1_100_000, help="triangles of the finest mesh")
    parser.add_argument(
        "--mean",
        action="store_true",
        help="mean normals, as Blender makes them, for the exact ones",
    )
    parser.add_argument(
        "--plot", metavar="FILE", help="draw the curves, as SVG or what else the ending says"
    )
    arguments = parser.parse_args()
    curves = {
        shape: {kind: curve(shape, kind, arguments.most, arguments.mean) for kind in KINDS}
        for shape in SHAPES
    }
    table(curves)
    thirty_two_by_sixteen(arguments.mean)
    if arguments.plot:
        plot(curves, arguments.plot)


if __name__ == "__main__":
    main()
