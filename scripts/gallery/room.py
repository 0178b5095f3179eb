"""A room for the gallery: a table before a wall, soft light, and a camera for the viewer."""

from __future__ import annotations

import math
from typing import NamedTuple

import bmesh
import bpy
import numpy as np
from mathutils import Matrix, Vector

from fuzz.shapes import linked, mesh_of
from kiriko.core.base.arrays import Floats
from kiriko.core.blender.data.image import image_from_pixels
from kiriko.core.blender.materials.shaders import cleared

Place = tuple[float, float, float]
WALL = 1.2  # m from the glass to the wall
MIDDLE = 0.0, 0.0, 0.05  # of a glass


class Look(NamedTuple):
    """The viewer's camera.

    at : point in the middle of the frame, m
    width : of the frame at this point, m
    elevation : angle by which the camera looks down, degrees
    azimuth : turn of the camera about the point, degrees; at 0 it looks along +y
    distance : from the point, m
    """

    at: Place
    width: float
    elevation: float
    azimuth: float = 0.0
    distance: float = 1.0


def aim(camera: bpy.types.Object, look: Look) -> None:
    """Put a camera in place."""
    down, turn = math.radians(look.elevation), math.radians(look.azimuth)
    to_camera = Vector(
        (math.cos(down) * math.sin(turn), -math.cos(down) * math.cos(turn), math.sin(down))
    )
    camera.location = Vector(look.at) + look.distance * to_camera
    camera.rotation_euler = to_camera.to_track_quat("Z", "Y").to_euler()
    lens = camera.data
    lens.sensor_fit, lens.shift_x, lens.shift_y = "HORIZONTAL", 0.0, 0.0
    lens.lens = lens.sensor_width * look.distance / look.width


def block(name: str, size: Place, at: Place, material: bpy.types.Material) -> bpy.types.Object:
    """A box of a size, its middle at a place."""
    mesh = mesh_of("cube", size=1.0)
    thing = linked(mesh, name)
    thing.scale, thing.location = size, at
    mesh.materials.append(material)
    return thing


def rounded(
    name: str, size: Place, radius: float, material: bpy.types.Material
) -> bpy.types.Object:
    """A slab with round corners, seen from the front."""
    mesh = mesh_of("cube", size=1.0)
    mesh.transform(Matrix.Diagonal((*size, 1.0)))
    shape = bmesh.new()
    shape.from_mesh(mesh)
    deep = [edge for edge in shape.edges if abs(edge.verts[0].co.y - edge.verts[1].co.y) > 1e-6]
    bmesh.ops.bevel(shape, geom=deep, offset=radius, segments=10, profile=0.5, affect="EDGES")
    shape.to_mesh(mesh)
    shape.free()
    mesh.materials.append(material)
    return linked(mesh, name)


def wood() -> bpy.types.Material:
    """Oiled walnut, its grain along x."""
    material = bpy.data.materials.new("Walnut")
    tree, output = cleared(material)
    place = tree.nodes.new("ShaderNodeNewGeometry")
    stretch = tree.nodes.new("ShaderNodeMapping")
    stretch.inputs["Scale"].default_value = (7.0, 55.0, 55.0)
    grain = tree.nodes.new("ShaderNodeTexNoise")
    grain.inputs["Scale"].default_value = 1.6
    grain.inputs["Detail"].default_value = 7.0
    grain.inputs["Distortion"].default_value = 0.7
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    ramp.color_ramp.elements[0].position, ramp.color_ramp.elements[1].position = 0.32, 0.72
    ramp.color_ramp.elements[0].color = (0.055, 0.022, 0.010, 1)
    ramp.color_ramp.elements[1].color = (0.24, 0.105, 0.045, 1)
    shader = tree.nodes.new("ShaderNodeBsdfPrincipled")
    shader.inputs["Roughness"].default_value = 0.32
    tree.links.new(place.outputs["Position"], stretch.inputs["Vector"])
    tree.links.new(stretch.outputs["Vector"], grain.inputs["Vector"])
    tree.links.new(grain.outputs[0], ramp.inputs["Fac"])
    tree.links.new(ramp.outputs["Color"], shader.inputs["Base Color"])
    tree.links.new(shader.outputs["BSDF"], output.inputs["Surface"])
    return material


def lacquer(name: str, colour: Place) -> bpy.types.Material:
    """A glossy surface of one colour."""
    material = bpy.data.materials.new(name)
    tree, output = cleared(material)
    shader = tree.nodes.new("ShaderNodeBsdfPrincipled")
    shader.inputs["Base Color"].default_value = (*colour, 1.0)
    shader.inputs["Roughness"].default_value = 0.15
    tree.links.new(shader.outputs["BSDF"], output.inputs["Surface"])
    return material


def glowing(name: str, pixels: Floats | None, strength: float = 1.0) -> bpy.types.Material:
    """A surface with the light of an image (h, w, 3) over its bounds, or without light."""
    material = bpy.data.materials.new(name)
    tree, output = cleared(material)
    shader = tree.nodes.new("ShaderNodeEmission")
    shader.inputs["Strength"].default_value = strength if pixels is not None else 0.0
    if pixels is not None:
        texture = tree.nodes.new("ShaderNodeTexImage")
        texture.image = image_from_pixels(name, pixels)
        across = tree.nodes.new("ShaderNodeTexCoord")
        tree.links.new(across.outputs["Generated"], texture.inputs["Vector"])
        tree.links.new(texture.outputs["Color"], shader.inputs["Color"])
    tree.links.new(shader.outputs["Emission"], output.inputs["Surface"])
    return material


def evening(height: int = 480, width: int = 960) -> Floats:
    """A wall (height, width, 3) out of focus: lamp light on plaster and lights in a window."""
    y, x = (np.mgrid[:height, :width] + 0.5) / height
    x, y = x - width / height / 2, 0.5 - y
    lamp = np.exp(-(((x + 0.42) / 0.46) ** 2) - ((y - 0.16) / 0.40) ** 2)
    wall = np.array([0.050, 0.040, 0.046]) + lamp[..., None] * np.array([0.46, 0.23, 0.085])
    random = np.random.default_rng(12)
    for _ in range(26):
        at = random.uniform((0.06, -0.16), (0.95, 0.46))
        radius = random.uniform(0.016, 0.036)
        far = np.hypot(x - at[0], y - at[1])
        disc = np.clip((radius - far) / 0.007 + 0.5, 0, 1) * (0.7 + 0.3 * (far / radius) ** 2)
        hue = random.choice([(1.0, 0.55, 0.18), (1.0, 0.75, 0.42), (0.35, 0.60, 1.0)])
        wall = wall + (disc * random.uniform(0.12, 0.42))[..., None] * hue
    return wall.astype(np.float32)


def lamp(name: str, at: Place, size: tuple[float, float], power: float, colour: Place) -> None:
    """A soft light at a place, aimed at the glass; its power in W."""
    data = bpy.data.lights.new(name, "AREA")
    data.shape, data.size, data.size_y = "RECTANGLE", *size
    data.energy, data.color = power, colour
    thing = linked(data, name)
    thing.location = at
    thing.rotation_euler = (Vector(at) - Vector(MIDDLE)).to_track_quat("Z", "Y").to_euler()


def hang(look: Look) -> None:
    """Put the wall behind all, square to the camera and wider than the frame."""
    wall = linked(mesh_of("grid", x_segments=1, y_segments=1, size=0.5), "Wall")
    camera = bpy.context.scene.kiriko.viewer
    wall.rotation_euler = camera.rotation_euler
    forward = camera.rotation_euler.to_matrix() @ Vector((0.0, 0.0, -1.0))
    wall.location = Vector(look.at) + WALL * forward
    width = 2.0 * look.width * (1.0 + WALL / look.distance)
    wall.scale = (width, width / 2, 1.0)
    wall.data.materials.append(glowing("Evening", evening()))


def furnish(look: Look, back: float) -> None:
    """Put the room into the scene.

    Parameters
    ----------
    look : camera of the viewer
    back : y of the table's far edge, m, in front of the plate
    """
    block("Table", (2.4, 1.6, 0.03), (0.0, back - 0.8, -0.015), wood())
    hang(look)
    # the plate shows the room below the table, too: a dark cabinet
    block("Cabinet", (4.0, 4.0, 0.01), (0.0, 0.0, -0.9), glowing("Dark", None))

    world = bpy.context.scene.world = bpy.data.worlds.new("Room")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.045, 0.040, 0.042, 1)
    lamp("Window", (-0.90, 0.02, 0.45), (0.45, 0.6), 12.0, (1.0, 0.93, 0.85))
    lamp("Strip", (0.55, 0.02, 0.22), (0.10, 0.50), 2.2, (0.70, 0.82, 1.0))
