"""The heuristics and options of the solver, each with a neutral value, for `dev.py ablation`."""

from __future__ import annotations

import importlib
import pkgutil
import sys
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any

import numpy as np

CORE = "kiriko.core"
ROOMS = "glass", "light", "map", "image", "solve"
NEVER = 1 << 40  # a count no solve reaches
INF = float("inf")


@dataclass(frozen=True)
class Change:
    """A neutral replacement of an object.

    target : dotted path below kiriko.core of an attribute of a module or of a class
    make : makes the neutral object from the original
    fields : changed fields of a record
    """

    target: str
    make: Callable[[Any], Any]
    fields: tuple[str, ...] = ()

    def found(self) -> tuple[Any, str, Any]:
        """The module or class with the target, the target's name there, and the target itself.

        Raises
        ------
        AttributeError, ModuleNotFoundError : the target no longer exists
        """
        room, module, *path, name = self.target.split(".")
        holder = importlib.import_module(f"{CORE}.{room}.{module}")
        for part in path:
            holder = getattr(holder, part)
        return holder, name, getattr(holder, name)

    def apply(self) -> list[tuple[Any, str, Any]]:
        """Replace the object everywhere it is bound; returns the originals."""
        holder, name, old = self.found()
        new = self.make(old)
        before = []
        for module in {id(one): one for one in (holder, *_modules())}.values():
            for here, value in list(vars(module).items()):
                # equal numbers may be one object, so they are replaced only under their own name
                if value is old and (here == name or not isinstance(old, int | float | tuple)):
                    before.append((module, here, old))
                    setattr(module, here, new)
        return before


@dataclass(frozen=True)
class Row:
    """A heuristic or an option.

    name : of the heuristic
    changes : replacements to switch it off
    why : why this value is neutral
    protects : rows of other benches that depend on it; it stays, whatever the gain here
    by_numpy : the kernel has its own copy, so numpy is measured instead
    """

    name: str
    changes: tuple[Change, ...]
    why: str
    protects: str = ""
    by_numpy: bool = False

    @property
    def room(self) -> str:
        return self.changes[0].target.split(".")[0]

    @property
    def is_fit(self) -> bool:
        """Whether it matters only if surfaces are fitted to meshes."""
        _, module = self.changes[0].target.split(".")[:2]
        return self.room == "glass" and module not in ("bounding_shell", "curved_hits")

    @contextmanager
    def off(self) -> Iterator[None]:
        """The solver without it."""
        import_all()
        before: list[tuple[Any, str, Any]] = []
        try:
            for change in self.changes:
                before += change.apply()
            yield
        finally:
            for holder, name, old in reversed(before):
                setattr(holder, name, old)


def import_all() -> None:
    """Import all modules of the solver, so all their bindings exist."""
    for room in ROOMS:
        package = importlib.import_module(f"{CORE}.{room}")
        for found in pkgutil.iter_modules(package.__path__):
            importlib.import_module(f"{CORE}.{room}.{found.name}")


def _modules() -> list[ModuleType]:
    """The imported modules of core."""
    return [module for name, module in list(sys.modules.items()) if name.startswith(CORE)]


def options(target: str, **values: object) -> Change:
    """Other values of fields of a frozen record."""
    return Change(target, lambda old: replace(old, **values), tuple(values))


def instead(target: str, new: object) -> Change:
    """Another constant, function or class."""
    return Change(target, lambda old: new)


# Neutral functions


def _giving(value: object) -> Callable[..., Generator[int, None, Any]]:
    """Steps without work that return a value."""

    def work(*arguments: object, **named: object) -> Generator[int, None, Any]:
        return value
        yield

    return work


def _untouched(self: object, places: np.ndarray, met: np.ndarray, rays: np.ndarray) -> Generator:
    """No bundle of rays passes by anything."""
    return np.zeros(len(rays), bool)
    yield


def _all_touch(solids: object, surfaces: list, is_closed: object, slack: float) -> np.ndarray:
    """Any two parts may touch."""
    return np.ones((len(surfaces), len(surfaces)), bool)


def _as_given(v: Any, wanted: object, exact: np.ndarray) -> Generator[int, None, np.ndarray]:
    """The given normals, except the known ones."""
    return np.where(np.isnan(exact), v.normal, exact)
    yield


def _no_bevels(v: Any, normal: object, wanted: object) -> np.ndarray:
    """No edge turns as a bevel does."""
    return np.zeros(len(v.start), bool)


def _no_lines(old: Callable) -> Callable:
    """Lines without information: no vertex lies on one."""

    def look(v: Any, size: np.ndarray) -> Generator[int, None, Any]:
        from kiriko.core.glass.grid_lines import Lines

        nowhere = np.full(len(v.at), np.inf)
        return Lines(nowhere, np.zeros(len(v.at)))
        yield

    return look


def _all_lack(old: Callable) -> Callable:
    """No pixel has rays left for its quarters."""

    def lack(points: Any, cells: Any, *others: Any) -> Generator[int, None, np.ndarray]:
        return np.ones(len(cells), bool)
        yield

    return lack


def _no_tessellation(old: Callable) -> Callable:
    from kiriko.core.solve.tessellation import Tessellation

    return _giving(Tessellation())


def _option_rows(
    target: str, word: str, protects: str = "", by_numpy: bool = False, **neutral: tuple[Any, str]
) -> list[Row]:
    """A row for each of some fields of a record, with its neutral value and the reason for it."""
    return [
        Row(f"{word}: {name}", (options(target, **{name: value}),), why, protects, by_numpy)
        for name, (value, why) in neutral.items()
    ]


# The tail that layout.md names

TAIL = [
    Row(
        "Exact limit of Subdivision",
        (instead("glass.subdivided.MOST_TRIANGLES", -1),),
        "no mesh is small enough to be looked at",
        "meant: wine glass, bottle and rings by one level",
    ),
    Row(
        "Exact splines",
        (instead("glass.subdivided.spline_steps", _giving(None)),),
        "no grid is taken for splines",
        "meant: wine glass by one level",
    ),
    Row(
        "Exact limit around poles",
        (instead("glass.subdivided.subdivided_steps", _giving(None)),),
        "no quads around poles are taken for subdivided ones",
        "meant: bodies that end on their axis",
    ),
    Row(
        "Faces trusted in part",
        (options("glass.trust.PART", irregular=INF),),
        "no face is irregular, so that each is curved or drawn",
        "irregular: noisy, decimated and scanned meshes",
    ),
    Row(
        "Undecided light reported",
        (instead("solve.tessellation._undecided", lambda *arguments: 0.0),),
        "no light is reported as undecided; no image changes",
        "extremes: ball in a cavity of its own size",
    ),
    Row(
        "Error of the mesh reported",
        (Change("solve.accuracy.tessellation", _no_tessellation),),
        "the error that the mesh leaves open is not measured; no image changes",
        "the message that the mesh limits the accuracy",
    ),
    Row(
        "Lines of the mesh",
        (Change("glass.trust.line_steps", _no_lines),),
        "no vertex lies on a smooth line: only jumps of normals decide",
        "irregular: coarse ellipsoids and tori",
    ),
    *_option_rows(
        "glass.agreement.AGREEMENT",
        "Automatic",
        protects="irregular: coarse and noisy meshes",
        trusted=(1e-9, "no jump of normals is small enough"),
        scattered=(1e-9, "vertices of coarse faces are off any line"),
        coarse=(0.0, "no face counts as coarse by its turn"),
        by_lines=(0.0, "coarse lines make no larger jump trusted"),
        fine=(0.0, "no face is fine enough for larger jumps"),
        smooth=(1e-9, "vertices of fine faces are off any line"),
        on_smooth=(0.2, "as much as is trusted elsewhere"),
    ),
    Row(
        "Faint light takes more samples",
        (instead("map.samples.TIMES", ()),),
        "no cell takes further samples",
    ),
    Row(
        "Samples spread by density",
        (instead("map.pieces.TOGETHER", NEVER),),
        "no part of the display has enough samples: each lights its pixel alone",
    ),
    Row(
        "Samples spread: limit by mixing",
        (instead("map.pieces.MIXED", -1.0),),
        "no light is unmixed, so that density alone decides",
        "tests/core/test_widths.py: a flat-shaded ball errs twice as much",
    ),
    Row(
        "Allowance of rays",
        (instead("map.ray_budget.TIMES_EFFORT", NEVER),),
        "each pixel may take as many rays as it asks for",
        "extremes: the bound on rays of a pixel",
    ),
    Row(
        "Parts that rays nearly hit",
        (instead("light.near_misses.ThinParts.touch", _untouched),),
        "no bundle of rays passes by anything",
        "extremes: thin parts; judge: rays at edges",
    ),
    Row(
        "Solids that touch",
        (instead("light.compile_plan.find_touching", _all_touch),),
        "any two solids may touch",
        "extremes: touching solids",
    ),
    *_option_rows(
        "light.layer_hits.MISSED_HITS",
        "Missed hits",
        protects="judge: rays at vertices and edges",
        by_numpy=True,
        neighbours=(1, "one ray beside a lost one instead of six"),
        wider=(0.0, "no slack for rays along a face"),
    ),
]

# Cutting, sampling and painting

MAP = [
    Row(
        "Cutting: quarters of pixels",
        (Change("map.cutting.quarters_exceed_budget", _all_lack),),
        "no pixel is quartered",
    ),
    Row(
        "Cutting: n_doubtful",
        (instead("map.cutting.N_DOUBTFUL", NEVER),),
        "no number of doubtful pixels makes a square chaotic: all pixels are cut",
    ),
    Row(
        "Cutting: apart_px",
        (instead("map.cutting.APART_PX", INF),),
        "samples never leave gaps",
        "tests/core/test_allowance.py: a display of more pixels than the viewer's image",
    ),
    Row(
        "Cutting: gap_share",
        (instead("map.cutting.GAP_SHARE", 1.0),),
        "no part that pieces leave out is large enough to be looked into",
        "tests/core/test_chaos.py: light in all, of which a twentieth would be lost",
    ),
    Row(
        "Quads of smooth cells: cheap_error_px",
        (instead("map.smooth_cells.CHEAP_ERROR_PX", INF),),
        "quads keep the tolerance, and no more",
        "the other rows of quads: with them off, too, a ball errs twice as much",
    ),
    Row(
        "Quads of smooth cells: n_places",
        (instead("map.smooth_cells.N_PLACES", 1),),
        "one colour for a display pixel that is larger than a viewer pixel",
    ),
    Row(
        "Quads of smooth cells: n_places_few",
        (instead("map.smooth_cells.N_PLACES_FEW", 1.0),),
        "one colour for a smaller display pixel",
    ),
    Row(
        "Quads of smooth cells: most_parts",
        (instead("map.smooth_cells.MOST_PARTS", 1 << 20),),
        "no bound on the quads of a cell",
    ),
    Row(
        "Squares: first size",
        (instead("map.sampling.N_ACROSS", 4),),
        "four squares across the view to begin with, a sixteenth of the number",
        "extremes: small glass",
    ),
    Row(
        "Squares: dark, with rays lost for different reasons",
        (instead("map.sampling.DARK_SIDE_PX", NEVER),),
        "a dark square is left alone, whatever its rays met",
        "tests/core/test_view_map.py: a slit between two blockers",
    ),
]
GLASS = [
    Row(
        "Normals found from vertices",
        (instead("glass.surface_fit.normal_steps", _as_given),),
        "means of the faces around are taken for normals",
        "surface: orders of convergence",
    ),
    *_option_rows(
        "glass.surface_fit.NORMALS",
        "Normals",
        protects="irregular: uneven, decimated and bevelled meshes",
        sweeps=(2, "one pair of sweeps"),
        restless=(INF, "normals count as settled after the last sweep"),
        moved=(INF, "no found normal has to prove itself"),
        straight=(INF, "chords contradict no normal"),
        gentle=(0.0, "none is looked for again by stiffer fields"),
    ),
    Row(
        "Normals of bevels",
        (instead("glass.surface_fit.contradicted", _no_bevels),),
        "no edge turns as a bevel does",
        "irregular: bevelled meshes",
    ),
    *_option_rows(
        "glass.fitted_faces.FACE",
        "Fitted faces",
        protects="irregular: decimated and bevelled meshes",
        least_cosine=(-1.0, "a face may turn away from its facet"),
        swollen=(INF, "no face is swollen"),
        extra_bulge=(INF, "no face stands out"),
    ),
    *_option_rows(
        "glass.fitted_faces.FACE",
        "Fitted faces",
        protects="surface: orders of convergence",
        by_numpy=True,
        steps=(1, "one step of the fixed point"),
    ),
    *_option_rows(
        "glass.surface_fit.FIT",
        "Fit",
        protects="irregular: voxels",
        least_cosine=(0.0, "normals contradict a facet only behind it"),
        coplanar=(0.0, "no facets are one flat face"),
    ),
    *_option_rows(
        "glass.grid_lines.LINES",
        "Lines",
        protects="irregular: coarse meshes",
        ends=(1, "one smooth line at a vertex is enough"),
        spokes=(NEVER, "no vertex is a pole"),
        straight=(0.0, "no line is straight"),
    ),
    *_option_rows(
        "glass.trust.PART",
        "In part",
        protects="irregular: noisy and scanned meshes",
        least=(0.0, "any weight counts"),
        chance=(0.0, "no vertex is worth it by chance"),
    ),
    *_option_rows(
        "glass.bounding_shell.SHELL",
        "Hull",
        angle=(INF, "no turn divides a face"),
        uneven=(0.0, "only turns across count"),
        halvings_at_edges=(0, "faces at straight edges are divided as others are"),
    ),
    *_option_rows(
        "glass.curved_hits.ROOTS",
        "Roots",
        protects="tests/core/test_curved.py: silhouettes",
        by_numpy=True,
        patience=(12, "no ray is given up early"),
        walks=(2, "a root wanders over two faces"),
        corner_turns=(0, "no face around a corner is searched"),
        few_starts=(4, "all starts for each ray"),
    ),
]

IMAGE = [
    Row(
        "Reads: side",
        (instead("image.pyramid.SIDE", INF),),
        "no footprint is longer than one that two places read",
        by_numpy=True,
    ),
]

SOLVE = [
    Row(
        "Leaks: rays",
        (instead("solve.accuracy.LEAK_SAMPLES", 12),),
        "a sixty-fourth of the rays; no image changes",
    ),
    Row(
        "Contradicted normals: rays",
        (instead("solve.accuracy.ODD_SAMPLES", 6),),
        "a sixty-fourth of the rays; no image changes",
    ),
    Row(
        "Error of the mesh: rays",
        (instead("solve.tessellation.SAMPLES", 4),),
        "a sixty-fourth of the rays; no image changes",
    ),
    Row(
        "Shares cached for the next picture",
        (instead("solve.painting.SHARE_OF_FREE", 0),),
        "none are kept; no image changes",
    ),
]

ROWS = [*TAIL, *MAP, *GLASS, *IMAGE, *SOLVE]

# Records that no solve of these glasses depends on, and the bench that measures them instead
ELSEWHERE = {
    "bench": "`tests/core/test_spread.py` (Add Rig) and `dev.py paper` (photographs)",
    "image.seen_image.DotOptions": "`dev.py paper`: the lattice as seen",
    "image.tone.Tone": "the user's choice",
    "map.pieces.SWING": "only with Brightness",
    "solve.accuracy.MANY_EVENTS": "only with more than 64 events",
    "solve.memory.Bytes": "`dev.py bench`: memory told beforehand",
    "solve.memory.Numbers": "`dev.py bench`: memory told beforehand",
}
