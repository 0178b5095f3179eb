"""The parts of the extreme cases of light and bench: rows
with bounds, rigs, and judges that are not Kiriko's.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kiriko.core.base.errors import KirikoError
from kiriko.core.base.steps import run_steps
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.rays import Landings
from kiriko.core.light.trace import trace_all
from kiriko.core.rig.rig import Glass, Mesh, Rig
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session
from kiriko.core.solve.solution import Solution

from .. import closed_forms
from ..reference_rigs import box, icosphere, rectangle, rig

Floats = NDArray[np.floating]
Face = tuple[
    Floats, Floats, float, float
]  # a plane's point and normal, the index before and behind it
Extended = (
    np.longdouble
)  # 64 bits of mantissa on Linux; where it is a double the bounds hold all the same, or nearly

X, Y, Z = np.eye(3)
N = 1.49
EPS = 2.0**-52
SLAB = (0.3, 0.02, 0.3)  # m, across the light; larger than all that is seen of it
EXACT = "exact"
WITHIN = "within tolerance"
REFUSED = "refused with reason"
LIMIT = "known limit"
WRONG = "WRONG"


@dataclass(frozen=True)
class Row:
    """One line of the table: the measured quantity, its error and the
    bound it has to keep, and the verdict if it does.
    """

    measured: str
    error: float
    unit: str
    bound: float
    kept: str
    avoid: str = ""

    @property
    def verdict(self) -> str:
        """WRONG where the error is above its bound or is no number."""
        return self.kept if self.error <= self.bound else WRONG


Rows = Iterator[Row]


@dataclass(frozen=True)
class Case:
    """A case of the list: its group, its name, and the rows it comes to, at full or at
    small size.
    """

    group: str
    name: str
    rows: Callable[[bool], Rows]


GROUPS = "indices", "angles", "maps", "scale", "meshes", "rig"
CASES: list[Case] = []


def case(group: str, name: str) -> Callable[[Callable[[bool], Rows]], Callable[[bool], Rows]]:
    """Put a function among the cases."""

    def add(rows: Callable[[bool], Rows]) -> Callable[[bool], Rows]:
        CASES.append(Case(group, name, rows))
        return rows

    return add


def exact(measured: str, error: float, bound: float = 0.0, unit: str = "") -> Row:
    """A row whose bound is that of rounding."""
    return Row(measured, float(error), unit, bound, EXACT)


def within(measured: str, error: float, bound: float, unit: str = "px") -> Row:
    """A row whose bound is a tolerance."""
    return Row(measured, float(error), unit, bound, WITHIN)


def limit(
    measured: str, error: float, bound: float, unit: str, avoid: str, told: bool = True
) -> Row:
    """A row of a known limit: so far and no further it is off.

    And Kiriko tells, where it can know.
    """
    return Row(measured, float(error) if told else np.inf, unit, bound, LIMIT, avoid)


def refused(a_rig: Rig, words: str, **settings: object) -> Row:
    """A row of a rig that has to be refused, by a sentence with these words."""
    try:
        solve(a_rig, **settings)
    except KirikoError as error:
        return Row(f'"{error}"', float(words not in str(error)), "", 0.0, REFUSED)
    return Row("not refused", np.inf, "", 0.0, REFUSED)


def slab_rig(glass: Mesh | tuple[Glass, ...] | None = None, **options: object) -> Rig:
    """The reference rig with glass that is larger than what
    is seen, and a display that takes all of it.
    """
    return rig(box(SLAB) if glass is None else glass, **({"display": 0.1} | options))


def ball_rig(quick: bool, **options: object) -> Rig:
    """The ball of the reference rigs, of 5 k or 20 k triangles."""
    return rig(icosphere(0.025, 4 if quick else 5), **options)


def solve(a_rig: Rig, **settings: object) -> Solution:
    return run_steps(Session().solve(a_rig, Settings(**settings)))


def tells(solution: Solution, words: str) -> bool:
    """Does the user read these words in a note?"""
    return any(words in note for note in solution.notes)


def rays_of(
    a_rig: Rig, n: int = 65, aside: tuple[float, float] = (0.3, 0.2)
) -> tuple[Floats, Floats]:
    """Rays on a grid of the viewer's pixels, a little beside the
    rig's plane of symmetry and the edges in it.
    """
    x, y = np.meshgrid(
        *(np.linspace(0, size, n) for size in (a_rig.viewer.width, a_rig.viewer.height))
    )
    return a_rig.viewer.rays(np.stack([x.ravel(), y.ravel()], axis=1) + aside)


def traced(a_rig: Rig, o: Floats, d: Floats, **settings: object) -> Landings:
    return trace_all(compile_plan(a_rig, Settings(**settings)), o, d)


def on(points: Floats, directions: Floats, faces: list[Face]) -> tuple[Floats, Floats]:
    """Rays through planes (point, normal, index before, index
    behind), one after the other, in extended precision.
    """
    p = points.astype(Extended)
    d = closed_forms.unit(directions.astype(Extended))
    for at, normal, n1, n2 in faces:
        normal = closed_forms.unit(np.asarray(normal, Extended))
        p = (
            p
            + (((np.asarray(at, Extended) - p) * normal).sum(-1) / (d * normal).sum(-1))[:, None]
            * d
        )
        d = d if n1 == n2 else closed_forms.snell(d, normal, Extended(n1), Extended(n2))
    return p, d


def layers(*faces: tuple[float, float]) -> list[Face]:
    """Planes across y for `on`: where each stands and the index behind it; air before the first."""
    indices = [1.0, *(n for _, n in faces)]
    return [(y * Y, Y, indices[k], indices[k + 1]) for k, (y, _) in enumerate(faces)]


def worst(*values: Floats) -> float:
    """Greatest absolute value; NaN where there is one."""
    return float(np.max([np.abs(some).max() for some in values]))


def furthest(
    a_rig: Rig, found: Landings, through: tuple[Floats, Floats], least: float = 0.3
) -> float:
    """Greatest distance, display px, of landings from those of
    rays as they leave the glass by a closed form.

    Infinite where one arrives of which the other does not, well
    inside the image, or where fewer than a share do.
    """
    expected = closed_forms.landing(a_rig, *through)
    size = np.array([a_rig.display.width, a_rig.display.height])
    with np.errstate(invalid="ignore"):
        is_inside = ((expected > 1e-3 * size) & (expected < (1 - 1e-3) * size)).all(axis=1)
    both = found.has_arrived & is_inside
    if (is_inside & ~found.has_arrived).any() or both.mean() < least:
        return np.inf
    return worst(found.xy[both] - expected[both])


def apart(one: Landings, other: Landings, least: float = 0.3) -> float:
    """Greatest distance, display px, between landings that have to be the same.

    Infinite where reasons differ.
    """
    if not np.array_equal(one.reason, other.reason) or one.has_arrived.mean() < least:
        return np.inf
    return worst((one.xy - other.xy)[one.has_arrived])


def joined(*meshes: Mesh) -> Mesh:
    """Meshes as one object."""
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate(
            [mesh.triangles + start for mesh, start in zip(meshes, starts, strict=False)]
        ),
        *(
            None
            if getattr(meshes[0], name) is None
            else np.concatenate([getattr(mesh, name) for mesh in meshes])
            for name in ("corner_normals", "is_smooth")
        ),
    )


def changed(a_rig: Rig, vertices: Callable[[Floats], Floats]) -> Rig:
    """The rig with all its vertices and its viewer somewhere else."""

    def mesh(m: Mesh) -> Mesh:
        return replace(m, vertices=vertices(m.vertices))

    return replace(
        a_rig,
        viewers=tuple(replace(v, position=vertices(v.position[None])[0]) for v in a_rig.viewers),
        **{
            name: tuple(replace(part, mesh=mesh(part.mesh)) for part in getattr(a_rig, name))
            for name in ("glasses", "plates", "displays", "pictures", "mirrors")
        },
    )


def without_plate(a_rig: Rig) -> Rig:
    """The rig with its plate out of all rays' way: they end where they leave the glass."""
    return replace(a_rig, plates=(replace(a_rig.plates[0], mesh=rectangle(9 * Z, X, Y, 1, 1)),))


def ramp(size: int = 64) -> NDArray[np.float32]:
    """A picture that is as bright, in red, as it is far to
    the right, and, in green, as it is far down.
    """
    image = np.ones((size, size, 4), np.float32)
    image[..., 0], image[..., 1] = np.meshgrid(
        (np.arange(size) + 0.5) / size, (np.arange(size) + 0.5) / size
    )
    image[..., 2] = 0.5
    return image


def at_aerial_plane(p: Floats, d: Floats) -> Floats:
    """Where rays, drawn forward or back, meet the aerial plane, y = 0."""
    return on(p, d, [(0 * Y, Y, 1.0, 1.0)])[0]


def reflected_in_plate(p: Floats) -> Floats:
    """Mirror image in the reference rig's plate, y - z = 0.15 m."""
    return np.stack([p[:, 0], p[:, 2] + Extended(0.15), p[:, 1] - Extended(0.15)], axis=1)
