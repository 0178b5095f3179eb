"""Random rigs for scripts/fuzz/run.py, each made in Blender from one random generator.

A rig begins with a sensible arrangement: glass, picture, plate, display and viewer as placed by Add
Rig. A third stay *tame*. In the others, every part may be damaged, moved away, left out or given
absurd settings.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import TypeVar

import bmesh
import bpy
import numpy as np
from mathutils import Euler, Matrix

from kiriko.core.base.arrays import Floats
from kiriko.core.bench.placement import Placement, Wishes, place, propose_behind
from kiriko.core.blender.materials.shaders import show_picture
from known import reference_rigs

from .shapes import BROUGHT, fitting, mesh_of, prism
from .shapes import add as add_modifier

Thing = TypeVar("Thing")

SIZE = 0.05  # of the glass in Blender units, where nothing is wild
MOST_FACES = 60  # of a mesh with a modifier: more take time and find nothing else
STRAIGHT = 1 / 7  # of the rigs have no plate, and the display is behind the glass
MODELS = ("IDEAL", "CROSSED", "HOLES", "RADIAL")


class Dice:
    """Draws the parts of a rig, and remembers each wild choice."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.wildness = float(rng.choice((0.0, 0.3, 1.0)))
        self.drawn: list[str] = []

    @property
    def is_tame(self) -> bool:
        return self.wildness == 0

    def chance(self, share: float) -> bool:
        return bool(self.rng.random() < share)

    def wild(self, share: float, what: str) -> bool:
        """Whether this is wild, in this fraction of the wildest rigs."""
        is_wild = self.chance(share * self.wildness)
        if is_wild:
            self.drawn.append(what)
        return is_wild

    def pick(self, options: Sequence[Thing]) -> Thing:
        return options[int(self.rng.integers(len(options)))]

    def log(self, low: float, high: float) -> float:
        """A number whose logarithm is spread evenly."""
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def pixels(self) -> int:
        return round(self.log(8, 96 if self.chance(0.02) else 14))

    def turn(self) -> Matrix:
        """Any rotation (4, 4)."""
        return Euler(self.rng.uniform(0, 2 * np.pi, 3).tolist()).to_matrix().to_4x4()


def add(data: bpy.types.ID | None, matrix: Floats | Matrix, role: str = "NONE") -> bpy.types.Object:
    """A new object in the scene."""
    thing = bpy.data.objects.new("Thing" if role == "NONE" else role.title(), data)
    bpy.context.scene.collection.objects.link(thing)
    thing.matrix_world = Matrix(np.asarray(matrix, float).tolist())
    thing.kiriko.role = role
    return thing


# Meshes


def hull(dice: Dice) -> bpy.types.Mesh:
    """The convex hull of a few random points: flat faces at any angle."""
    mesh = bpy.data.meshes.new("Hull")
    shape = bmesh.new()
    for point in dice.rng.uniform(-0.5, 0.5, (int(dice.rng.integers(4, 30)), 3)):
        shape.verts.new(point)
    made = bmesh.ops.convex_hull(shape, input=shape.verts)
    bmesh.ops.delete(shape, geom=[*{*made["geom_interior"], *made["geom_unused"]}], context="VERTS")
    shape.to_mesh(mesh)
    shape.free()
    return mesh


def torus(dice: Dice) -> bpy.types.Mesh:
    """A ring."""
    n, m = (int(dice.rng.integers(3, most)) for most in (16, 10))
    thick = dice.rng.uniform(0.05, 0.24)
    mesh = reference_rigs.torus(0.5 - thick, thick, n, m)
    return from_arrays(mesh.vertices, mesh.triangles.tolist())


def uv_sphere(dice: Dice) -> bpy.types.Mesh:
    """A ball of longitudes and latitudes."""
    u, v = (int(dice.rng.integers(3, most)) for most in (24, 12))
    return mesh_of("uvsphere", u_segments=u, v_segments=v, radius=0.5)


def cone(dice: Dice, top: float) -> bpy.types.Mesh:
    """A cylinder or a cone."""
    return prism(int(dice.rng.integers(3, 40)), radius1=0.5, radius2=top)


SHAPES: tuple[Callable[[Dice], bpy.types.Mesh], ...] = (
    lambda dice: mesh_of("cube", size=1.0),
    uv_sphere,
    lambda dice: mesh_of("icosphere", subdivisions=int(dice.rng.integers(1, 4)), radius=0.5),
    lambda dice: cone(dice, 0.5),
    lambda dice: cone(dice, 0.0),
    hull,
    torus,
)


def from_arrays(
    points: Floats, faces: list[list[int]], edges: Sequence[tuple[int, int]] = ()
) -> bpy.types.Mesh:
    """An unvalidated mesh of vertices (n, 3) and faces, as scripts and importers may make it."""
    mesh = bpy.data.meshes.new("Mesh")
    mesh.from_pydata(points.tolist(), list(edges), faces)
    mesh.update()
    return mesh


def arrays_of(mesh: bpy.types.Mesh) -> tuple[Floats, list[list[int]]]:
    """Vertices (n, 3) and faces of a mesh."""
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    return points.reshape(-1, 3).astype(float), [
        list(polygon.vertices) for polygon in mesh.polygons
    ]


# exponents of ten of extreme coordinates
POWERS = {"huge": (5, 38), "tiny": (-30, -5), "denormal": (-45, -38)}
# faults of a mesh of any shape
FLAWS = (
    "open", "duplicated faces", "extra fin", "zero area", "sliver", "nan", "inf", *POWERS,
    "inverted", "some inverted", "crumpled", "no faces", "no vertices", "loose edges",
    "single triangle", "one point", "doubled", "split", "flat",
)  # fmt: skip


def spoil(dice: Dice, mesh: bpy.types.Mesh) -> bpy.types.Mesh:  # noqa: C901 - a case each flaw
    """The mesh with one flaw."""
    points, faces = arrays_of(mesh)
    rng, edges, n = dice.rng, [], len(points)
    flaw = dice.pick(FLAWS)
    dice.drawn.append(f"mesh: {flaw}")
    some = [k for k in range(len(faces)) if rng.random() < 0.2] or [0]
    at = int(rng.integers(n))
    a, b, *_ = faces[0]

    match flaw:
        case "open":
            faces = [face for k, face in enumerate(faces) if k not in some] or faces[:1]
        case "duplicated faces":
            faces += [faces[k] if dice.chance(0.5) else faces[k][::-1] for k in some]
        case "extra fin":
            points = np.concatenate([points, rng.uniform(-1, 1, (1, 3))])
            faces.append([a, b, n])
        case "zero area":
            middle = points[[a, b]].mean(axis=0, keepdims=True)
            points = np.concatenate([points, middle, points[:1], points[:1]])
            faces += [[a, b, n], [0, n + 1, n + 2]]
        case "sliver":
            points[b] = points[a] + 10.0 ** rng.uniform(-8, -3) * (points[b] - points[a])
        case "nan" | "inf":
            points[at, rng.integers(3)] = float(flaw) * dice.pick((1, -1))
        case "huge" | "tiny" | "denormal":
            which = slice(None) if dice.chance(0.5) else slice(at, at + 1)
            points[which] *= 10.0 ** rng.uniform(*POWERS[flaw])
        case "inverted":
            faces = [face[::-1] for face in faces]
        case "some inverted":
            faces = [face[::-1] if k in some else face for k, face in enumerate(faces)]
        case "crumpled":
            points += rng.normal(0, dice.log(1e-3, 1), points.shape)
        case "no faces":
            edges, faces = [(face[0], face[1]) for face in faces], []
        case "no vertices":
            points, faces = points[:0], []
        case "loose edges":
            points = np.concatenate([points, rng.uniform(-1, 1, (4, 3))])
            edges = [(n, n + 1), (0, n + 2)]
        case "single triangle":
            faces = [faces[0][:3]]
        case "one point":
            points[:] = points[at]
        case "doubled":
            faces += [[v + n for v in face] for face in faces]
            points = np.concatenate([points, points])
        case "split":
            points = np.concatenate([points[face] for face in faces])
            starts = np.cumsum([0, *(len(face) for face in faces)])
            faces = [list(range(first, last)) for first, last in pairwise(starts)]
        case "flat":
            points[:, 2] = 0.0

    return from_arrays(points, faces, edges)


def hollow(dice: Dice, mesh: bpy.types.Mesh) -> bpy.types.Mesh:
    """The mesh with smaller copies of itself within, drawn either way round."""
    points, faces = arrays_of(mesh)
    n = len(points)
    depth = dice.pick((1, 1, 1, 2, 3))
    scales = np.cumprod(dice.rng.uniform(0.3, 0.95, depth))
    within = [
        [v + n * (1 + k) for v in face[:: dice.pick((1, -1))]]
        for k in range(depth)
        for face in faces
    ]
    return from_arrays(
        np.concatenate([points, *(scale * points for scale in scales)]), faces + within
    )


def glass_mesh(dice: Dice) -> bpy.types.Mesh:
    """A shape about one unit across."""
    mesh = dice.pick(SHAPES)(dice)
    if dice.chance(0.15):
        mesh = hollow(dice, mesh)
    if dice.wild(0.3, "broken glass"):
        mesh = spoil(dice, mesh)
    mesh.polygons.foreach_set("use_smooth", np.full(len(mesh.polygons), dice.chance(0.5)))
    mesh.update()
    return mesh


def modify(dice: Dice, thing: bpy.types.Object) -> None:
    """Give an object a modifier."""
    if len(thing.data.polygons) > MOST_FACES:
        return
    rng = dice.rng
    kinds: dict[str, Callable[[], dict[str, object]]] = {
        "SUBSURF": lambda: {
            "levels": int(rng.integers(1, 3)),
            "use_limit_surface": rng.random() < 0.7,
        },
        "BEVEL": lambda: {"width": dice.log(1e-4, 1)},
        "SOLIDIFY": dict,
        "DECIMATE": lambda: {"ratio": rng.uniform(0.0, 1.0)},
        "ARRAY": lambda: {"relative_offset_displace": rng.uniform(-1, 1, 3).tolist()},
        "MIRROR": dict,
        "TRIANGULATE": dict,
        "CAST": dict,
    }
    kind = dice.pick(("SUBSURF", *kinds))
    dice.drawn.append(f"modifier {kind}")
    add_modifier(thing, kind, **kinds[kind]())


def rectangle(dice: Dice, role: str) -> bpy.types.Mesh:
    """A plane of size 1 with a UV map over all of it, facing +z.

    Wild ones are bent, or have a bad UV map.
    """
    n = dice.pick((1, 1, 1, 2, 5))
    x, y = (c.ravel() for c in np.meshgrid(*2 * [np.linspace(0, 1, n + 1)]))
    points = np.stack([x - 0.5, y - 0.5, 0 * x], axis=1)
    faces = [[k, k + 1, k + n + 2, k + n + 1] for k in range(n * (n + 1)) if k % (n + 1) < n]
    if dice.wild(0.1, f"bent {role}"):
        points[:, 2] = dice.pick((1, -1)) * dice.log(1e-7, 1) * (x - 0.5) ** 2
    mesh = from_arrays(points, faces)
    if dice.wild(0.08, f"broken {role}"):
        mesh = spoil(dice, mesh)
    if dice.wild(0.05, f"{role} without UV"):
        return mesh
    layer = mesh.uv_layers.new(name="UVMap")

    if len(mesh.loops):
        corners = np.empty(len(mesh.loops), np.int32)
        mesh.loops.foreach_get("vertex_index", corners)
        uv = np.nan_to_num(arrays_of(mesh)[0][corners, :2], nan=0.0) + 0.5
        if dice.wild(0.15, f"{role} with strange UV"):
            uv = strange_uv(dice, uv)
        layer.uv.foreach_set("vector", uv.astype(np.float32).ravel())

    return mesh


def panels(x: Floats, z: Floats, u: Floats) -> bpy.types.Mesh:
    """A strip of panels, one unit high, along places (n,); u : (n - 1, 2) of the ends of each."""
    n = len(x)
    points = np.concatenate([np.stack([x, 0 * x + y, z], axis=1) for y in (-0.5, 0.5)])
    mesh = from_arrays(points, [[k, k + 1, n + k + 1, n + k] for k in range(n - 1)])
    uv = [(u[k, i], j) for k in range(n - 1) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
    layer = mesh.uv_layers.new(name="UVMap")
    layer.uv.foreach_set("vector", np.array(uv, np.float32).ravel())
    return mesh


def folded(dice: Dice) -> bpy.types.Mesh:
    """A display of two panels at an angle, with or without a gap in the image."""
    angle, gap = dice.rng.uniform(0.2, 1.5), dice.pick((0.0, 0.05))
    x, z = np.array([-0.5, 0.0, 0.5 * np.cos(angle)]), np.array([0, 0, 0.5 * np.sin(angle)])
    return panels(x, z, np.array([[0, 0.5 - gap], [0.5 + gap, 1]]))


def rolled(dice: Dice) -> bpy.types.Mesh:
    """A display bent to a part of a cylinder, hollow or bulging; its UV map goes evenly around."""
    turn = dice.pick((1, -1)) * dice.rng.uniform(0.2, 2.5)
    u = np.linspace(0, 1, int(dice.rng.integers(2, 12)) + 1)
    angle = turn * (u - 0.5)
    ends = np.stack([u[:-1], u[1:]], axis=1)
    return panels(np.sin(angle) / turn, (1 - np.cos(angle)) / turn, ends)


def strange_uv(dice: Dice, uv: Floats) -> Floats:
    """UV coordinates (l, 2) that are missing, or do not cover the whole image."""
    rng = dice.rng
    kinds: dict[str, Callable[[], Floats]] = {
        "zero": lambda: 0 * uv,
        "line": lambda: uv * [1, 0],
        "nan": lambda: np.where(rng.random(uv.shape) < 0.3, np.nan, uv),
        "huge": lambda: uv * dice.log(1e3, 1e30),
        "part": lambda: 0.2 + 0.3 * uv,
        "beyond": lambda: 3 * uv - 1,
        "mirrored": lambda: uv * [-1, 1] + [1, 0],
        "skewed": lambda: uv @ [[1, 0.3], [0, 1]],
        "noise": lambda: uv + rng.normal(0, 0.2, uv.shape),
        "islands": lambda: (
            uv / 2 + rng.integers(0, 2, (-(-len(uv) // 4), 2)).repeat(4, 0)[: len(uv)] / 2
        ),
    }
    kind = dice.pick([*kinds])
    dice.drawn.append(f"UV {kind}")
    return kinds[kind]()


# Parts


def displaced(dice: Dice, matrix: Floats, size: float, role: str) -> Matrix:
    """A place near this one, or a wild one."""
    there = Matrix(np.asarray(matrix, float).tolist())
    rng = dice.rng
    if dice.wild(0.12, f"{role} somewhere"):
        far = rng.normal(0, dice.log(0.1, 10), 3) * size
        return Matrix.Translation(far.tolist()) @ there @ dice.turn()
    if dice.wild(0.05, f"{role} edge-on"):
        angle = np.pi / 2 + dice.pick((0.0, 0.0, 1e-9, 1e-4))
        return there @ Matrix.Rotation(angle, 4, dice.pick("XY"))
    if dice.wild(0.04, f"{role} turned away"):
        return there @ Matrix.Rotation(np.pi, 4, "X")
    if dice.wild(0.04, f"{role} sheared"):
        return there @ Matrix.Shear("XY", 4, rng.uniform(-3, 3, 2).tolist())
    if dice.wild(0.03, f"{role} without scale"):
        scales = dice.pick(((0, 0, 0), (1, 1, 0), (1, 0, 1), (1e-20, 1, 1)))
        return there @ Matrix.Diagonal([*scales, 1.0])

    tilt = Euler(rng.normal(0, 0.01 if role == "viewer" else 0.05, 3).tolist())
    aside = Matrix.Translation((rng.normal(0, 0.05, 3) * size).tolist())
    return aside @ there @ tilt.to_matrix().to_4x4()


def scaled(frame: Matrix, size: Sequence[float] | float) -> Matrix:
    """A frame with a size along its own axes."""
    return frame @ Matrix.Diagonal([*np.broadcast_to(size, 3).tolist(), 1.0])


def glass_material(dice: Dice) -> bpy.types.Material | None:
    """A refractive or other material."""
    kind = dice.pick(("none", "Glass", "Glass", "Refraction", "Principled", "Diffuse"))
    if kind == "none":
        return None
    material = bpy.data.materials.new(kind)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    node = tree.nodes.new(f"ShaderNodeBsdf{kind}")
    if "IOR" in node.inputs:
        node.inputs["IOR"].default_value = dice.rng.uniform(1.2, 2.0)
        if dice.wild(0.1, "odd index"):
            node.inputs["IOR"].default_value = dice.pick((0.0, 0.5, 1.0, 1 + 1e-6, 4.0, 1000.0))
    if kind == "Principled":
        node.inputs["Transmission Weight"].default_value = 1.0
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    return material


def add_brought_glass(dice: Dice, centre: Floats, size: float) -> bpy.types.Object:
    """Glass as artists bring it: a text, a curve, a body with modifiers."""
    kind = dice.pick(sorted(BROUGHT))
    dice.drawn.append(kind)
    thing = BROUGHT[kind](dice.rng)
    turn = dice.turn() if dice.chance(0.5) else Matrix()
    thing.matrix_world = (
        Matrix.Translation(centre.tolist()) @ Matrix.Scale(size, 4) @ turn @ fitting(thing)
    )
    ours = thing.kiriko
    ours.role = "GLASS"
    ours.use_ior = True
    ours.ior = dice.rng.uniform(1.3, 1.9)
    ours.surface = dice.pick(("AUTOMATIC", "SMOOTH", "FACETS"))

    return thing


def add_glass(dice: Dice, centre: Floats, size: float) -> bpy.types.Object:
    """A glass object about `size` wide, near the centre."""
    if dice.chance(0.25):
        return add_brought_glass(dice, centre, size)
    aspect = dice.rng.uniform(0.6, 1.4, 3)
    if dice.chance(0.1):
        aspect[dice.rng.integers(3)] = dice.log(1e-4, 0.3)  # a panel, or a lens
    if dice.chance(0.1):
        aspect[dice.rng.integers(3)] *= -1
    shift = Matrix.Translation((centre + dice.rng.normal(0, 0.1, 3) * size).tolist())
    at = shift if dice.chance(0.3) else shift @ dice.turn()
    mesh = glass_mesh(dice)
    thing = add(mesh, scaled(displaced(dice, at, size, "glass"), aspect * size), "GLASS")

    if dice.wild(0.12, "glass beneath a sheared parent"):
        scales = dice.rng.uniform(0.3, 2, 3).tolist()
        thing.parent = add(None, Matrix.Diagonal([*scales, 1.0]) @ dice.turn())
    if dice.wild(0.2, "modified glass"):
        modify(dice, thing)
    material = glass_material(dice)
    if material is not None:
        mesh.materials.append(material)
    ours = thing.kiriko
    ours.use_ior = dice.chance(0.5)
    ours.ior = dice.rng.uniform(1.3, 1.9)
    if dice.wild(0.15, "odd index"):
        ours.use_ior = True
        ours.ior = dice.pick((0.1, 0.75, 1.0, 1 + 1e-7, 1.0001, 4.0, 10.0))
    colour(dice, ours)

    ours.surface = dice.pick(("AUTOMATIC", "AUTOMATIC", "SMOOTH", "FACETS"))
    if dice.wild(0.2, "priority"):
        ours.priority = int(dice.rng.integers(-3, 4))
    return thing


def colour(dice: Dice, ours: bpy.types.PropertyGroup) -> None:
    """Let some glass disperse or absorb."""
    if dice.wild(0.15, "dispersion"):
        ours.dispersion = dice.pick(("ABBE", "N-SF11", "Water"))
        ours.abbe = dice.pick((55.0, 20.0, 1.0, 0.0, -3.0))
    if dice.wild(0.15, "tint"):
        ours.use_tint, ours.tint = True, dice.rng.uniform(0, 1, 3)


def add_instances(dice: Dice, thing: bpy.types.Object, size: float) -> None:
    """Show an object a second time: as another object with its mesh, or by an instanced
    collection.
    """
    shift = Matrix.Translation((dice.rng.normal(0, 1, 3) * size).tolist())
    if dice.chance(0.5):
        add(thing.data, shift @ thing.matrix_world, "GLASS")
        return
    group = bpy.data.collections.new("Group")
    group.objects.link(thing)
    instance = add(None, shift)
    instance.instance_type, instance.instance_collection = "COLLECTION", group


def add_odd_object(dice: Dice, size: float) -> None:
    """A non-mesh object with a role."""
    data = bpy.data
    kinds: dict[str, Callable[[], bpy.types.ID | None]] = {
        "curve": lambda: data.curves.new("Curve", "CURVE"),
        "text": lambda: data.curves.new("Text", "FONT"),
        "metaball": lambda: data.metaballs.new("Ball"),
        "empty": lambda: None,
        "lattice": lambda: data.lattices.new("Lattice"),
        "light": lambda: data.lights.new("Light", "POINT"),
    }
    kind = dice.pick([*kinds])
    dice.drawn.append(f"{kind} with a role")
    made = kinds[kind]()
    if kind == "text":
        made.body, made.extrude = "K", 0.1
    elif kind == "metaball":
        made.elements.new()
    elif kind == "curve":
        made.dimensions, made.bevel_depth = "3D", 0.1
        made.splines.new("BEZIER").bezier_points.add(2)
    role = dice.pick(("GLASS", "PLATE", "DISPLAY", "PICTURE", "MIRROR", "BLOCKER"))
    add(made, scaled(displaced(dice, np.eye(4), size, role), size), role)


def add_plate(dice: Dice, frame: Floats, size: float) -> None:
    """A plate, of mirrors or ideal."""
    at = scaled(displaced(dice, frame, size, "plate"), 10 * size)
    thing = add(rectangle(dice, "plate"), at, "PLATE")
    ours = thing.kiriko.plate
    ours.model = dice.pick(("IDEAL", *MODELS)) if not dice.is_tame else "IDEAL"

    if dice.wild(0.4, "odd plate"):
        ours.pitch = dice.log(1e-3, 1e4)
        ours.height = dice.log(0.01, 1000)
        ours.ior = dice.pick((1.0, 1.0001, 1.5, 10.0))
        ours.reflectance = dice.pick((0.001, 0.5, 1.0))
        ours.crossing_error = dice.rng.uniform(-0.2, 0.2)
        ours.fresnel = dice.chance(0.5)
        ours.phase = dice.rng.normal(0, dice.log(0.1, 1e6), 2).tolist()


def picture_image(dice: Dice) -> bpy.types.Image:
    """A small image of any shape."""
    width, height = dice.pixels(), dice.pixels()
    if dice.wild(0.15, "picture of one pixel or one row"):
        width, height = dice.pick(((1, 1), (1, 64), (64, 1)))
    image = bpy.data.images.new(
        "Picture", width, height, alpha=dice.chance(0.5), float_buffer=dice.chance(0.4)
    )
    pixels = dice.rng.random((height * width, 4)).astype(np.float32)
    if image.is_float and dice.wild(0.2, "odd pixels"):
        pixels[dice.rng.integers(len(pixels)), 0] = dice.pick((np.nan, np.inf, 1e30, 1e-30, 1e5))
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    if dice.wild(0.05, "odd colour space"):
        image.colorspace_settings.name = dice.pick(("Non-Color", "Linear Rec.709", "Filmic Log"))

    return image


def add_picture(dice: Dice, frame: Floats, size: float) -> None:
    """The picture plane."""
    sides = np.array([1, dice.rng.uniform(0.5, 2), 1]) * 0.6 * size
    at = scaled(displaced(dice, frame, size, "picture"), sides)
    thing = add(rectangle(dice, "picture"), at, "PICTURE")
    if dice.wild(0.04, "picture without image"):
        return

    if dice.chance(0.5):
        thing.kiriko.image = picture_image(dice)
    else:
        material = bpy.data.materials.new("Picture")
        show_picture(material, picture_image(dice))
        thing.data.materials.append(material)


def add_display(dice: Dice, frame: Floats, size: float) -> None:
    """The display."""
    width, height = dice.pixels(), dice.pixels()
    if dice.wild(0.08, "display of one pixel or one row"):
        width, height = dice.pick(((1, 1), (1, 96), (96, 1)))
    across = (2 if dice.is_tame else dice.log(0.5, 20)) * size
    at = scaled(displaced(dice, frame, size, "display"), (across, across * height / width, across))
    is_bent = dice.chance(0.2)
    mesh = dice.pick((folded, rolled))(dice) if is_bent else rectangle(dice, "display")
    thing = add(mesh, at, "DISPLAY")
    thing.kiriko.resolution = (width, height)
    if dice.chance(0.3):
        thing.data.materials.append(bpy.data.materials.new("Screen"))


def lens_of(dice: Dice, size: float, distance: float) -> bpy.types.Camera:
    """The viewer's camera, which looks at a thing of this size."""
    lens = bpy.data.cameras.new("Viewer")
    lens.angle = 2 * np.arctan(1.2 * size / (2 * distance))
    lens.clip_start = 1e-6
    lens.clip_end = 1e6 * max(1.0, size)
    lens.sensor_fit = dice.pick(("AUTO", "AUTO", "HORIZONTAL", "VERTICAL"))
    if dice.chance(0.15):
        lens.type, lens.ortho_scale = "ORTHO", 1.2 * size
    if dice.chance(0.15):
        lens.shift_x, lens.shift_y = dice.rng.normal(0, 0.05, 2)
    if dice.wild(0.03, "panoramic viewer"):
        lens.type = "PANO"

    if dice.wild(0.1, "odd lens"):
        lens.lens = dice.log(1, 1e6)
        lens.ortho_scale = dice.log(1e-6, 1e6)
        lens.shift_x, lens.shift_y = dice.rng.normal(0, dice.log(0.01, 10), 2)
    return lens


def add_viewer(dice: Dice, frame: Floats, size: float, distance: float) -> None:
    """The viewer, and the size of its image."""
    lens = lens_of(dice, size, distance)
    at = displaced(dice, frame, size, "viewer")
    if dice.wild(0.05, "viewer inside the glass"):
        at.translation = frame[:3, 3] - distance * frame[:3, 2]
    if dice.wild(0.04, "viewer behind the plate"):
        at.translation = frame[:3, 3] - (distance + 5 * size) * frame[:3, 2]
    thing = add(lens, at)
    scene = bpy.context.scene
    scene.camera = thing
    if dice.chance(0.5):
        scene.kiriko.viewer = thing
    if dice.chance(0.3):
        thing.kiriko.use_resolution = True
        thing.kiriko.resolution = (dice.pixels(), dice.pixels())
    own = dice.rng.spawn(1)[0]  # other settings keep their random numbers
    if own.random() < 0.1:
        thing.kiriko.pupil, thing.kiriko.use_dof = 10 ** own.uniform(-1, 3), own.random() < 0.3

    render = scene.render
    render.resolution_x = dice.pixels()
    render.resolution_y = dice.pixels()
    render.resolution_percentage = 100

    if dice.wild(0.08, "odd frame"):
        render.resolution_percentage = int(dice.rng.integers(1, 100))
        render.pixel_aspect_x = dice.log(1, 200)
        render.pixel_aspect_y = dice.log(1, 200)

    if dice.wild(0.05, "viewer of a few pixels"):
        render.resolution_x, render.resolution_y = dice.pick(((4, 4), (4, 96), (96, 4)))


def add_extras(dice: Dice, frames: Sequence[Floats], size: float) -> None:
    """Mirrors and blockers, and duplicates of unique parts."""
    shares = {"mirror": 0.12, "blocker": 0.12, "display": 0.04, "picture": 0.04, "plate": 0.08}
    for role, share in shares.items():
        if dice.wild(share, f"another {role}"):
            at = displaced(dice, dice.pick(frames), 3 * size, role)
            mesh = rectangle(dice, role) if dice.chance(0.6) else glass_mesh(dice)
            add(mesh, scaled(at, dice.log(0.1, 10) * size), role.upper())

    if dice.wild(0.05, "mirrors face to face"):
        for z, turn in ((-1, 0.0), (1, np.pi)):
            at = Matrix(np.asarray(frames[1]).tolist()) @ Matrix.Translation((0, 0, z * size))
            at = scaled(at @ Matrix.Rotation(turn, 4, "X"), 3 * size)
            add(rectangle(dice, "mirror"), at, "MIRROR")


ELEMENTS = ("HALF_MIRROR", "RETROREFLECTOR", "LENS", "SCREEN", "POLARISER", "WAVE_PLATE")
FEW_GLASSES = 1  # with polarisation, which numpy traces


def add_elements(dice: Dice, frames: Sequence[Floats], size: float) -> None:
    """Half mirrors, retroreflectors, lenses, films, screens and projectors in the light's way;
    glass that reflects, displays whose light is polarised.

    They have a random generator of their own, so other rigs keep their random numbers.
    """
    own = Dice(dice.rng.spawn(1)[0])
    own.wildness = dice.wildness
    things = [o for o in bpy.context.scene.objects if o.kiriko.role in {"GLASS", "DISPLAY"}]
    is_small = sum(o.kiriko.role == "GLASS" for o in things) <= FEW_GLASSES
    for role in ELEMENTS if is_small else ELEMENTS[:-2]:
        if own.wild(0.1, f"a {role}"):
            wide = own.log(0.5, 10) * size
            at = scaled(displaced(own, own.pick(frames), 3 * size, role), wide)
            things.append(add(rectangle(own, role), at, role))
    for thing in things:
        if thing.kiriko.role in ELEMENTS or own.wild(0.1, "reflections, polarisation"):
            draw_numbers(own, thing, size, is_small)
    if own.wild(0.05, "a projector"):
        at = displaced(own, own.pick(frames), size, "projector")
        add(lens_of(own, size, 5 * size), at, "PROJECTOR")
    for thing in things:
        if thing.kiriko.role == "DISPLAY" and own.wild(0.1, "views"):
            ours = thing.kiriko.views
            ours.use, ours.columns, ours.rows = True, own.pick((1, 2, 9, 45)), own.pick((1, 1, 3))
            ours.cone, ours.overlap = own.rng.uniform(0, 2.5, 2), own.pick((0.0, 0.3, 1.0))
            ours.distance = own.pick((0.0, 1e3 * size, 1e-3))
    dice.drawn += own.drawn


def draw_numbers(dice: Dice, thing: bpy.types.Object, size: float, is_polarised: bool) -> None:
    """Draw all numbers of an element; its role uses some of them."""
    ours, rng = thing.kiriko.element, dice.rng
    ours.reflectance, ours.absorption = rng.uniform(0, 0.7), dice.pick((0.0, 0.0, 0.3, 0.4))
    ours.reflects = dice.chance(0.5)
    ours.polarising = is_polarised and dice.chance(0.5)
    ours.is_polarised = is_polarised and dice.chance(0.5)
    ours.prefers = dice.pick(("BRIGHTER", "REFLECTED", "TRANSMITTED"))
    ours.focal_length = dice.pick((1, -1)) * 1e3 * size * dice.log(0.3, 30)
    if dice.wild(0.1, "odd focal length"):
        ours.focal_length = dice.pick((0.0, 1e-20, 1e30))
    ours.angle, ours.retardance = rng.uniform(-7, 7), dice.pick((0.25, 0.5, -3.1))
    ours.extinction, ours.spread = dice.pick((0.0, 1e-4, 1.0)), dice.pick((0.0, 0.01))
    ours.pitch = dice.pick((0.0, 1e3 * size * dice.log(1e-4, 1)))
    if thing.kiriko.role == "SCREEN":
        thing.kiriko.resolution = (dice.pixels(), dice.pixels())


def set_up(dice: Dice, scene: bpy.types.Scene) -> None:
    """How the rig is solved."""
    ours = scene.kiriko
    ours.tolerance = dice.log(0.1, 1)
    if dice.wild(0.3, "odd tolerance"):
        ours.tolerance = dice.log(1e-6, 100)
    ours.max_events = int(dice.log(8, 64))
    if dice.wild(0.3, "odd number of events"):
        ours.max_events = round(dice.log(1, 10000))
    ours.effort = int(dice.log(1, 64))
    ours.only_through_glass = dice.chance(0.7)
    ours.only_through_plate = dice.chance(0.7)
    ours.brightness = dice.chance(0.3)
    ours.suppress_glare = dice.log(1e-3, 1) if dice.chance(0.3) else 0
    ours.sharpen = dice.rng.spawn(1)[0].random() < 0.1
    ours.ghosts = "STRONGEST" if dice.chance(0.2) else "MEAN"
    ours.margin = dice.pick((0, 0, 1, 1024)) if not dice.is_tame else 0

    if dice.wild(0.15, "picture in the viewer's pixels"):
        ours.picture_source = "IMAGE"
        if dice.chance(0.9):
            ours.picture_image = picture_image(dice)


def behind_glass(dice: Dice, centre: Floats, size: float, distance: float) -> Placement | None:
    """Placements of a rig without a plate, for a seventh of all rigs; None for the others.

    It has a random generator of its own, so other rigs keep their random numbers.
    """
    rng = dice.rng.spawn(1)[0]
    if rng.random() > STRAIGHT:
        return None
    dice.drawn.append("straight, with no plate")
    bounds = centre + 0.5 * size * np.array([[-1.0], [1.0]])
    wishes = Wishes(
        distance=float(rng.choice((0.0, rng.uniform(0.1, 5) * size))),
        azimuth=float(rng.uniform(0, 2 * np.pi)),
        look_down=float(rng.uniform(0, np.pi / 2)),
        viewer_distance=distance,
    )
    return propose_behind(bounds, wishes).placement


def make_rig(rng: np.random.Generator) -> Dice:  # noqa: C901 - one draw after the other
    """Make a random rig in the empty scene; returns the random choices."""
    dice = Dice(rng)
    scene = bpy.context.scene
    units, size, centre = scene.unit_settings, SIZE, np.zeros(3)
    if dice.chance(0.4):
        systems = ("METRIC", 1e-3), ("IMPERIAL", 0.0254), ("NONE", 5.0)
        units.system, units.scale_length = dice.pick(systems)
        size /= 1.0 if units.system == "NONE" else units.scale_length
    if dice.wild(0.1, "odd unit"):
        units.system, units.scale_length = "METRIC", dice.log(1e-5, 1e5)
    if dice.wild(0.15, "odd size"):
        size = dice.log(1e-4, 1e4)
    if dice.wild(0.12, "far away"):
        centre = dice.rng.normal(size=3) * dice.log(1e-1, 1e5)
    distance = dice.rng.uniform(5, 25) * size
    tilt, azimuth = dice.rng.uniform(0.5, 1.1), dice.rng.uniform(0, 2 * np.pi)
    stand = place(centre, 3 * size, tilt, distance, azimuth)
    stand = behind_glass(dice, centre, size, distance) or stand

    if not dice.wild(0.03, "no glass"):
        n_glasses = dice.pick((1, 1, 1, 1, 1, 2, 2, 3, 5))
        sizes = size * dice.rng.uniform(0.3, 1.3, n_glasses)
        glasses = [add_glass(dice, centre, float(one)) for one in sizes]
        if dice.chance(0.05) or dice.wild(0.1, "instances"):
            add_instances(dice, glasses[0], size)
        if dice.chance(0.06) and stand.plate is not None:
            dice.drawn.append("glass behind the plate")
            part = dice.rng.uniform(0.3, 0.7)
            behind = (1 - part) * stand.plate[:3, 3] + part * stand.display[:3, 3]
            add_glass(dice, behind, size * dice.rng.uniform(0.3, 2.0))

    if stand.plate is not None and not dice.wild(0.03, "no plate"):
        add_plate(dice, stand.plate, size)
    if not dice.wild(0.03, "no display"):
        add_display(dice, stand.display, size)
    if not dice.wild(0.03, "no picture"):
        add_picture(dice, stand.picture, size)
    if not dice.wild(0.03, "no viewer"):
        add_viewer(dice, stand.viewer, size, distance)
    frames = (stand.plate, stand.picture, stand.display)
    present = [frame for frame in frames if frame is not None]
    add_extras(dice, present, size)
    add_elements(dice, present, size)
    if dice.wild(0.06, "odd object"):
        add_odd_object(dice, size)
    if dice.wild(0.05, "something hidden"):
        setattr(dice.pick(scene.objects), dice.pick(("hide_render", "hide_viewport")), True)
    set_up(dice, scene)
    bpy.context.view_layer.update()

    return dice
