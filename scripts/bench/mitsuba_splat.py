"""The splat as a loop of Mitsuba 3 and Dr.Jit: the opponent of `dev.py marks`, and its judge.

It accumulates the same values as core/image/source_image.py, in single precision and on all
threads: random points of the viewer's pixels, refraction at the triangles with interpolated normals
or at a sphere, total reflection, an ideal plate, a rectangular display. Embree traces only the
glass; plate and display are two planes, which is faster.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from environments import LEAST_LLVM, MISSING_LLVM
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.trace import trace_all
from kiriko.core.rig.rig import WAVELENGTH, Mesh, Rig
from kiriko.core.rig.settings import Settings

Floats = NDArray[np.float64]

try:
    mi.set_variant("llvm_ad_rgb")
except ImportError as error:
    raise SystemExit(MISSING_LLVM) from error
if dr.detail.llvm_version()[0] < LEAST_LLVM:
    raise SystemExit(MISSING_LLVM)

# m, along the ray: the offset of spawn_ray moves landings by 0.12 display px
OFFSET = 1e-6
MOST_EVENTS = 32  # as in core.rig.settings.Settings
AT_ONCE = 128  # spp of a judge in one launch: sums of single precision stay exact to 1e-6
CHECKED = 100_000  # rays whose landings are compared


def use_threads(n: int) -> None:
    """Let Dr.Jit work on n threads."""
    dr.set_thread_count(n)


def _vector(values: Floats) -> mi.Vector3f:
    return mi.Vector3f(*(float(x) for x in values))


class Rectangle:
    """A flat rectangle with UV. No dataclass, or Dr.Jit would carry its fields through the loop as
    state.
    """

    def __init__(self, mesh: Mesh) -> None:
        points = mesh.corners.reshape(-1, 3)
        uv = mesh.uv.reshape(-1, 2)
        system = np.column_stack([uv, np.ones(len(uv))])
        fit, *_ = np.linalg.lstsq(system, points, rcond=None)

        if np.abs(system @ fit - points).max() > 1e-9 or np.ptp(uv, axis=0).min() < 1:
            raise ValueError(
                "Plate, display and picture have to be flat rectangles under a whole UV square."
            )

        right, up, corner = fit
        normal = np.cross(right, up)
        self.corner = mi.Point3f(_vector(corner))
        self.normal = _vector(normal / np.linalg.norm(normal))
        self.u, self.v = (_vector(row) for row in np.linalg.pinv(np.stack([right, up], axis=1)))

    def meet(self, origins: mi.Point3f, directions: mi.Vector3f) -> tuple[mi.Float, mi.Point2f]:
        """Distance, infinite where the rectangle is missed, and uv."""
        distance = dr.dot(self.corner - origins, self.normal) / dr.dot(directions, self.normal)
        across = origins + distance * directions - self.corner
        uv = mi.Point2f(dr.dot(across, self.u), dr.dot(across, self.v))
        met = (distance > 0) & dr.all((uv >= 0) & (uv <= 1))
        return dr.select(met, distance, dr.inf), uv


class MeshGlass:
    """Triangles with interpolated normals. Fetched here, for Mitsuba's surface interaction costs a
    sixth more.
    """

    def __init__(self, mesh: Mesh) -> None:
        if mesh.corner_normals is None or not mesh.is_smooth.all():
            raise ValueError("The glass has to be smooth all over.")
        # a vertex with several normals becomes several
        corners = np.column_stack([mesh.triangles.ravel(), mesh.corner_normals.reshape(-1, 3)])
        unique, faces = np.unique(corners, axis=0, return_inverse=True)
        shape = mi.Mesh("glass", len(unique), len(mesh.triangles), has_vertex_normals=True)
        parameters = mi.traverse(shape)
        parameters["vertex_positions"] = (
            mesh.vertices[unique[:, 0].astype(int)].ravel().astype(np.float32)
        )
        parameters["vertex_normals"] = unique[:, 1:].ravel().astype(np.float32)
        parameters["faces"] = faces.ravel().astype(np.uint32)
        parameters.update()
        self.scene = mi.load_dict({"type": "scene", "glass": shape})
        self.faces = parameters["faces"]
        self.positions = parameters["vertex_positions"]
        self.normals = parameters["vertex_normals"]

    def surface(
        self, pi: mi.PreliminaryIntersection3f, ray: mi.Ray3f, is_met: mi.Bool
    ) -> tuple[mi.Vector3f, ...]:
        """Point, the face's normal and the interpolated one."""
        corners = dr.gather(mi.Vector3u, self.faces, pi.prim_index, is_met)
        p0, p1, p2 = (dr.gather(mi.Vector3f, self.positions, corner, is_met) for corner in corners)
        n0, n1, n2 = (dr.gather(mi.Vector3f, self.normals, corner, is_met) for corner in corners)
        u, v = pi.prim_uv
        point = (1 - u - v) * p0 + u * p1 + v * p2
        return point, dr.cross(p1 - p0, p2 - p0), dr.normalize((1 - u - v) * n0 + u * n1 + v * n2)


class SphereGlass:
    """The sphere around the origin that a mesh approximates."""

    def __init__(self, mesh: Mesh) -> None:
        radii = np.linalg.norm(mesh.vertices, axis=1)
        if np.ptp(radii) > 1e-9:
            raise ValueError("The glass is not a ball around the origin.")
        self.radius = float(radii.mean())
        self.scene = mi.load_dict(
            {"type": "scene", "glass": {"type": "sphere", "radius": self.radius}}
        )

    def surface(
        self, pi: mi.PreliminaryIntersection3f, ray: mi.Ray3f, is_met: mi.Bool
    ) -> tuple[mi.Vector3f, ...]:
        """Point, and the normal twice."""
        normal = dr.normalize(mi.Vector3f(ray.o + pi.t * ray.d))
        return self.radius * normal, normal, normal


def refract(
    directions: mi.Vector3f, normals: mi.Vector3f, eta: mi.Float
) -> tuple[mi.Vector3f, mi.Bool]:
    """Snell's law as in core.light.optics: the refracted or totally reflected direction, and which
    of the two it is.
    """
    c = -dr.dot(directions, normals)
    k = c * c + (1 - eta) * (1 + eta) * dr.squared_norm(directions + c * normals)
    is_tir = k < 0
    refracted = eta * directions + (eta * c - dr.sqrt(dr.maximum(k, 0))) * normals
    return dr.select(is_tir, directions + 2 * c * normals, refracted), is_tir


def meet_glass(
    d: mi.Vector3f, face: mi.Vector3f, normal: mi.Vector3f, ior: float
) -> tuple[mi.Vector3f, mi.Bool, mi.Bool]:
    """Directions after a surface of the glass, which of them are totally reflected, and which come
    from outside.

    As in core/light, the face's own normal takes over where the
    interpolated one would send light to the wrong side.
    """
    enters = dr.dot(d, face) < 0
    face = dr.select(enters, face, -face)
    normal = dr.select(enters, normal, -normal)
    face = dr.normalize(face)
    normal = dr.select(dr.dot(d, normal) >= 0, face, normal)
    eta = dr.select(enters, mi.Float(1 / ior), mi.Float(ior))
    out, is_tir = refract(d, normal, eta)
    own, own_is_tir = refract(d, face, eta)
    wrong = (dr.dot(out, face) > 0) != is_tir
    return dr.normalize(dr.select(wrong, own, out)), dr.select(wrong, own_is_tir, is_tir), enters


@dr.syntax
def follow(
    o: mi.Point3f,
    d: mi.Vector3f,
    glass: MeshGlass | SphereGlass,
    ior: float,
    plate: Rectangle,
    display: Rectangle,
) -> tuple[mi.Bool, mi.Point2f]:
    """Which rays arrive on the display by glass and plate, and at which uv."""
    o = mi.Point3f(o)
    d = mi.Vector3f(d)
    uv = mi.Point2f(0)
    is_inside = mi.Bool(False)
    has_met_glass = mi.Bool(False)
    has_met_plate = mi.Bool(False)
    has_arrived = mi.Bool(False)
    is_live = mi.Bool(True)
    n_events = mi.UInt32(0)

    while is_live & (n_events < MOST_EVENTS):
        ray = mi.Ray3f(o, d)
        # coherent: neighbours are samples of one pixel; three times as fast as without
        pi = glass.scene.ray_intersect_preliminary(ray, coherent=True)
        to_plate, _ = plate.meet(o, d)
        to_display, display_uv = display.meet(o, d)
        distance = dr.minimum(pi.t, dr.minimum(to_plate, to_display))
        at_glass = pi.is_valid() & (pi.t <= distance)
        at_plate = ~at_glass & (to_plate <= to_display) & (to_plate < dr.inf)
        at_display = ~at_glass & ~at_plate & (to_display < dr.inf)

        point, face, normal = glass.surface(pi, ray, at_glass)
        bent, is_tir, enters = meet_glass(d, face, normal, ior)
        bends = at_glass & (enters != is_inside)  # else it is the face just left

        lands = at_display & has_met_glass & has_met_plate & (dr.dot(d, display.normal) < 0)
        uv = dr.select(lands, display_uv, uv)
        has_arrived |= lands
        mirrored = 2 * dr.dot(d, plate.normal) * plate.normal - d
        o = mi.Point3f(dr.select(at_glass, mi.Point3f(point), o + distance * d))
        d = mi.Vector3f(dr.select(bends, bent, dr.select(at_plate, mirrored, d)))
        o = mi.Point3f(o + OFFSET * d)
        is_inside ^= bends & ~is_tir
        has_met_glass |= bends
        has_met_plate |= at_plate
        is_live &= at_glass | at_plate
        n_events += 1

    return has_arrived, uv


class MitsubaSplat:
    """A rig with one glass, one ideal plate and a flat display, ready for Mitsuba.

    Parameters
    ----------
    rig : completely smooth glass
    is_sphere : use the sphere that the glass approximates instead of its triangles
    """

    def __init__(self, rig: Rig, is_sphere: bool = False) -> None:
        if len(rig.glasses) != 1 or len(rig.plates) != 1 or rig.mirrors or rig.blockers:
            raise ValueError(
                "The Mitsuba loop follows one glass, one plate and the display, and nothing else."
            )

        self.rig = rig
        mesh = rig.glasses[0].mesh
        self.ior = float(rig.glasses[0].ior.at(WAVELENGTH))
        self.glass = SphereGlass(mesh) if is_sphere else MeshGlass(mesh)
        self.plate = Rectangle(rig.plates[0].mesh)
        self.display = Rectangle(rig.display.mesh)
        self.picture = Rectangle(rig.picture.mesh)
        self.texture = mi.Texture2f(
            mi.TensorXf(np.ascontiguousarray(rig.picture.image, np.float32)),
            filter_mode=dr.FilterMode.Linear,
            wrap_mode=dr.WrapMode.Clamp,
        )

    def _rays(self, x: mi.Float, y: mi.Float) -> tuple[mi.Point3f, mi.Vector3f]:
        """Rays through viewer pixels."""
        viewer = self.rig.viewer
        left, right, bottom, top = viewer.window
        to_right, up, forward = (_vector(axis) for axis in viewer.axes)
        x = left + (right - left) / viewer.width * x
        y = top + (bottom - top) / viewer.height * y
        across = x * to_right + y * up
        position = mi.Point3f(_vector(viewer.position))
        if viewer.projection == "orthographic":
            return mi.Point3f(position + across), forward
        return position, dr.normalize(forward + across)

    def _land(self, o: mi.Point3f, d: mi.Vector3f) -> tuple[mi.Bool, mi.Float, mi.Float]:
        """Which rays arrive, and their landings in display pixels."""
        has_arrived, uv = follow(o, d, self.glass, self.ior, self.plate, self.display)
        return has_arrived, uv.x * self.rig.display.width, (1 - uv.y) * self.rig.display.height

    def landings(self, xy: Floats) -> Floats:
        """Display pixels (n, 2) of viewer pixels (n, 2); NaN without a landing."""
        has_arrived, x, y = self._land(*self._rays(mi.Float(xy[:, 0]), mi.Float(xy[:, 1])))
        return np.stack(
            [np.array(dr.select(has_arrived, a, dr.nan), float) for a in (x, y)], axis=1
        )

    def sums(self, spp: int, seed: int = 0) -> NDArray[np.float32]:
        """Sums of red, green, blue and number of the samples on each display pixel (H, W, 4)."""
        viewer = self.rig.viewer
        display = self.rig.display
        n = viewer.width * viewer.height * spp
        pixel = dr.arange(mi.UInt32, n) // spp
        random = mi.PCG32(size=n, initstate=seed)
        x = mi.Float(pixel % viewer.width) + random.next_float32()
        y = mi.Float(pixel // viewer.width) + random.next_float32()
        o, d = self._rays(x, y)
        has_arrived, x, y = self._land(o, d)
        distance, uv = self.picture.meet(o, d)
        colour = self.texture.eval(mi.Point2f(uv.x, 1 - uv.y))
        is_seen = distance < dr.inf
        value = mi.Vector4f(*(dr.select(is_seen, channel, 0) for channel in colour[:3]), 1)
        column = mi.UInt32(x)
        row = mi.UInt32(y)
        has_arrived &= (column < display.width) & (row < display.height)
        total = dr.zeros(mi.Float, 4 * display.width * display.height)
        dr.scatter_reduce(dr.ReduceOp.Add, total, value, row * display.width + column, has_arrived)

        return np.array(total).reshape(display.height, display.width, 4)


def image_from_sums(sums: Floats) -> Floats:
    """Source image (H, W, 3), black where no sample landed."""
    return sums[..., :3] / np.maximum(sums[..., 3:], 1)


class Judge:
    """Two independent splats of many samples, and which display pixels they can judge."""

    def __init__(self, rig: Rig, spp: int, is_sphere: bool) -> None:
        loop = MitsubaSplat(rig, is_sphere)
        halves = [_many(loop, spp // 2, first_seed) for first_seed in (1 << 20, 1 << 21)]
        self.images = [image_from_sums(sums) for sums in halves]
        self.is_judged = np.logical_and.reduce([sums[..., 3] > 0 for sums in halves])
        self.counts = halves[0][..., 3] + halves[1][..., 3]

    def error(self, image: Floats) -> float:
        """RMSE of an image whose noise, if it has any, is independent of the judges'."""
        one, other = ((image - half)[self.is_judged] for half in self.images)
        return float(np.sqrt(max(np.mean(one * other), 0.0)))

    def seen_error(self, image: Floats) -> float:
        """The same, each display pixel weighed by how much the viewer sees of it."""
        one, other = ((image - half)[self.is_judged] for half in self.images)
        mean = np.average((one * other).mean(axis=1), weights=self.counts[self.is_judged])
        return float(np.sqrt(max(mean, 0.0)))

    def holes(self, is_painted: NDArray[np.bool_]) -> int:
        return int((self.is_judged & ~is_painted).sum())


def _many(loop: MitsubaSplat, spp: int, first_seed: int) -> Floats:
    """Sums over many samples, in double precision."""
    starts = range(0, spp, AT_ONCE)
    return sum(
        loop.sums(min(AT_ONCE, spp - first), first_seed + first).astype(float) for first in starts
    )


def share_apart(rig: Rig, loop: MitsubaSplat) -> float:
    """Share, 0..1, of the rays that see the display in either program but land more than a pixel
    elsewhere in Mitsuba.
    """
    size = np.array([rig.viewer.width, rig.viewer.height])
    # single precision, or the two would not get the same rays
    xy = (np.random.default_rng(0).random((CHECKED, 2)) * size).astype(np.float32).astype(float)
    ours = trace_all(compile_plan(rig, Settings()), *rig.viewer.rays(xy))
    theirs = loop.landings(xy)
    size = rig.display.width, rig.display.height
    seen = [
        ((xy >= 0) & (xy < size)).all(axis=1)
        for xy in (np.where(ours.has_arrived[:, None], ours.xy, -1), theirs)
    ]
    with np.errstate(invalid="ignore"):
        is_alike = np.linalg.norm(ours.xy - theirs, axis=1) <= 1
    either = seen[0] | seen[1]
    return float((either & ~(seen[0] & seen[1] & is_alike)).sum() / max(either.sum(), 1))
