"""Scenes in which plays begin, and questions about them."""

from __future__ import annotations

import importlib
import json
import shutil
import sys
import tempfile
from pathlib import Path
from types import ModuleType

import bmesh
import bpy
import numpy as np
from mathutils import Euler

from manual.grab import grab

EXTENSION = "bl_ext.user_default.kiriko"
LARGE = 1.6  # of the interface, in pictures of the whole window
SIGHT = 1600, 900  # px of the viewer of an exhibit
FROM = 1.17, 0.0, 0.66  # direction to a rig: rotation of the view, rad


def has_rig() -> bool:
    """Whether there is a rig and nothing is running."""
    scene = bpy.context.scene
    return is_quiet() and any(thing.kiriko.role == "DISPLAY" for thing in scene.objects)


def is_solved() -> bool:
    """Whether there is a final source image."""
    result = bpy.context.scene.kiriko.result
    return bool(result.source is not None and not result.is_coarse and result.summary)


def is_seen() -> bool:
    """Does a 3D view show the viewer's sight in Cycles, with the source image of the scene as it is
    then? The image of an earlier solve is final, too, until Live has read the scene.
    """
    scene = bpy.context.scene
    views = [
        area.spaces.active
        for area in bpy.context.window_manager.windows[0].screen.areas
        if area.type == "VIEW_3D"
    ]
    return is_up_to_date() and any(
        view.shading.type == "RENDERED"
        and view.region_3d.view_perspective == "CAMERA"
        and scene.render.engine == "CYCLES"
        for view in views
    )


def is_up_to_date() -> bool:
    """Whether the source image is final and Live, if on, has nothing left to do."""
    live = kiriko("operators.live").followed()
    is_settled = live is None or not (live.is_working or live.is_changed)
    return is_settled and is_solved()


def stop_live() -> None:
    """Or the next file would have a sentence on why it stopped."""
    kiriko("operators.live").stop()


def kiriko(module: str) -> ModuleType:
    """A module of the installed extension."""
    return importlib.import_module(f"{EXTENSION}.{module}")


def is_quiet() -> bool:
    """Whether none of Kiriko's operators is running."""
    modal = bpy.context.window_manager.windows[0].modal_operators
    return not any(operator.bl_idname.startswith("KIRIKO") for operator in modal)


def exported() -> Path:
    """The newest exported file."""
    return Path(bpy.path.abspath(bpy.context.scene.kiriko.export_path))


def is_exported() -> bool:
    """Whether the complete file exists."""
    return is_quiet() and exported().is_file() and exported().stat().st_size > 0


def remove_exported() -> None:
    """Leave no file behind."""
    exported().unlink()


def small_display() -> None:
    """Give the display fewer pixels than a screen has, odd numbers of them, in its shape."""
    for thing in bpy.context.scene.objects:
        if thing.kiriko.role == "DISPLAY":
            thing.kiriko.resolution = (801, 451)


def show_window() -> None:
    """Run the operator of its button, which is in a closed panel."""
    bpy.ops.kiriko.show_window("INVOKE_DEFAULT")


def keep_shown() -> None:
    """The show window's pixels on the screen and the exported file, next to the accounts."""
    folder = Path(sys.argv[sys.argv.index("--") + 2])
    (window,) = kiriko("operators.show_window").show_windows()
    region = next(
        region
        for area in window.screen.areas
        for region in area.regions
        if area.type == "TEXT_EDITOR" and region.type == "WINDOW"
    )
    told = {
        "window": grab(window, folder / "shown.rgb"),
        "region": (region.x, region.y, region.width, region.height),
    }
    (folder / "shown.json").write_text(json.dumps(told), encoding="utf-8")
    shutil.copyfile(exported(), folder / "source.png")
    remove_exported()


def glass_material() -> bpy.types.Material:
    """Acrylic."""
    material = bpy.data.materials.new("Acrylic")
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    out = nodes.new("ShaderNodeOutputMaterial")
    glass = nodes.new("ShaderNodeBsdfGlass")
    glass.inputs["IOR"].default_value = 1.49
    glass.inputs["Roughness"].default_value = 0.0
    material.node_tree.links.new(glass.outputs["BSDF"], out.inputs["Surface"])
    return material


def in_place_of_cube(mesh: bpy.types.Mesh, name: str) -> bpy.types.Object:
    """Glass alone in the scene, selected."""
    for thing in list(bpy.data.objects):
        if thing.type == "MESH":
            bpy.data.objects.remove(thing)
    thing = bpy.data.objects.new(name, mesh)
    thing.data.materials.append(glass_material())
    bpy.context.scene.collection.objects.link(thing)
    bpy.context.view_layer.objects.active = thing
    thing.select_set(True)
    return thing


def ball() -> None:
    """A smooth ball of acrylic, 50 mm across."""
    mesh = bpy.data.meshes.new("Glass Ball")
    made = bmesh.new()
    bmesh.ops.create_icosphere(made, subdivisions=5, radius=0.025)
    for face in made.faces:
        face.smooth = True
    made.to_mesh(mesh)
    made.free()
    in_place_of_cube(mesh, "Glass Ball")


def nothing_else() -> None:
    """Remove the camera and the light of Blender's default scene, which are far away."""
    for thing in list(bpy.data.objects):
        if thing.type in {"CAMERA", "LIGHT"}:
            bpy.data.objects.remove(thing)


# radius and height of a goblet's outer side, mm, from the middle of its foot to its rim; the foot
# is thicker than twice the wall, or its two sides, each with a wall of its own, would cut each
# other; the stem is short, so that the bowl fills the viewer's sight
OUTLINE = (
    (0, 0), (26, 0), (30, 3), (26, 6), (12, 8), (6, 11), (5, 15), (5, 20), (7, 26), (18, 31),
    (30, 42), (36, 59), (37, 78), (35, 97),
)  # fmt: skip


def goblet() -> None:
    """A wine glass: an outline with Screw, Solidify, whose wall is inside it, and Subdivision."""
    mesh = bpy.data.meshes.new("Goblet")
    places = [(radius / 1000, 0.0, height / 1000) for radius, height in OUTLINE]
    mesh.from_pydata(places, [(k, k + 1) for k in range(len(places) - 1)], [])
    thing = in_place_of_cube(mesh, "Goblet")
    screw = thing.modifiers.new("Screw", "SCREW")
    screw.steps = screw.render_steps = 32
    screw.use_merge_vertices = True
    screw.merge_threshold = 1e-5  # m: by default 10 mm, which draws a thin stem into a line
    screw.use_smooth_shade = True
    solidify = thing.modifiers.new("Solidify", "SOLIDIFY")
    solidify.thickness = 0.002
    solidify.offset = 1.0
    divided = thing.modifiers.new("Subdivision", "SUBSURF")
    divided.levels = divided.render_levels = 2


def seaside() -> None:
    """Write seaside.png, the artist's own picture: an evening with two sails, 900 x 600."""
    y, x = np.mgrid[:600, :900]
    colour = np.zeros((600, 900, 4), np.float32)
    dusk = (y[..., None] / 380.0) ** 1.5
    colour[..., :3] = np.array([0.10, 0.16, 0.42]) * (1 - dusk) + np.array([1.0, 0.50, 0.22]) * dusk
    colour[np.hypot(x - 620, y - 300) < 95] = (1.0, 0.86, 0.45, 1)
    sea = y > 380
    colour[sea, :3] = np.array([0.03, 0.20, 0.32])
    colour[sea & (np.abs(x - 620) < 30 + (y - 380) * 0.5) & (y // 10 % 2 == 0)] = (0.9, 0.6, 0.3, 1)
    for left, top, size in ((230, 150, 260), (450, 260, 130)):
        down = y - top
        is_sail = (down > 0) & (down < size) & (x > left) & (x - left < 0.55 * down)
        colour[is_sail] = (0.96, 0.94, 0.9, 1)
        hull = (
            (down > size + 8) & (down < size + 40) & (np.abs(x - left - 40) < 110 - (down - size))
        )
        colour[hull] = (0.35, 0.10, 0.08, 1)
    colour[..., 3] = 1

    image = bpy.data.images.new("seaside", 900, 600)
    image.pixels.foreach_set(colour[::-1].ravel())
    image.filepath_raw = str(pictures() / "seaside.png")
    image.file_format = "PNG"
    image.save()
    bpy.data.images.remove(image)


def pictures() -> Path:
    """The artist's folder, which is seen in the file browser."""
    made = Path(tempfile.gettempdir()) / "Pictures"
    made.mkdir(exist_ok=True)
    return made


def has_eye_box() -> bool:
    """Whether there is an eye box and nothing is running."""
    surfaces = kiriko("operators.outdated_surfaces")
    return is_quiet() and surfaces.looked_up(bpy.context.scene, surfaces.EYE_BOX) is not None


def has_seaside() -> bool:
    """Whether it is the picture and nothing is running."""
    return is_quiet() and any(image.name == "seaside.png" for image in bpy.data.images)


def is_telephone() -> bool:
    """Whether the display has the pixels of an iPhone 15."""
    return any(
        tuple(sorted(thing.kiriko.resolution)) == (1179, 2556)
        for thing in bpy.context.scene.objects
        if thing.kiriko.role == "DISPLAY"
    )


def is_compared() -> bool:
    """Whether Before and After is shown."""
    return is_quiet() and bpy.context.window_manager.kiriko.show_comparison


def only_viewport() -> None:
    """Give the whole window to the 3D viewport, in large letters and with an empty scene."""
    bpy.context.preferences.view.ui_scale = LARGE
    window = bpy.context.window_manager.windows[0]
    for area in list(window.screen.areas):
        if area.type != "VIEW_3D":
            with bpy.context.temp_override(window=window, area=area):
                bpy.ops.screen.area_close()
    for thing in list(bpy.data.objects):
        bpy.data.objects.remove(thing)


def gallery(module: str) -> ModuleType:
    """A module of the gallery, which imports the installed extension as the checkout."""
    for name, loaded in list(sys.modules.items()):
        if f"{name}.".startswith(f"{EXTENSION}."):
            sys.modules[f"kiriko{name.removeprefix(EXTENSION)}"] = loaded
    return importlib.import_module(f"gallery.{module}")


def model(name: str) -> None:
    """The glass of an exhibit as artists bring it: too large, and without a material."""
    thing = gallery("exhibits").EXHIBITS[name].glass()
    thing.data.materials.clear()
    thing.scale = (10.0,) * 3
    bpy.context.view_layer.objects.active = thing
    thing.select_set(True)


def exhibit(name: str) -> None:
    """An exhibit of the gallery with its rig, on no table."""
    gallery("show").assemble(gallery("exhibits").EXHIBITS[name], SIGHT)


def star() -> None:
    """Give the rig the film's picture, whose lines are straight, and a lens that it fills."""
    gallery("show").part("PICTURE").kiriko.image = importlib.import_module("film.story").star()
    bpy.context.scene.kiriko.viewer.data.lens *= 1.8


def furnish(name: str) -> None:
    """Add the table and the lamps of an exhibit, lit so that Cycles needs few samples."""
    wanted = gallery("exhibits").EXHIBITS[name]
    gallery("room").furnish(wanted.look, wanted.back)
    cycles = bpy.context.scene.cycles
    cycles.preview_samples = 64
    cycles.caustics_reflective = cycles.caustics_refractive = False
    for thing in bpy.context.scene.objects:
        if thing.type == "LIGHT":  # in the glass it would be bright dots: no denoiser is used
            thing.visible_glossy = thing.visible_transmission = False


def face_rig() -> None:
    """Turn the view to the glass and the display, and select nothing."""
    (area,) = (a for a in bpy.context.window_manager.windows[0].screen.areas if a.type == "VIEW_3D")
    area.spaces.active.region_3d.view_rotation = Euler(FROM).to_quaternion()
    for thing in bpy.context.scene.objects:
        thing.select_set(thing.kiriko.role in {"GLASS", "DISPLAY", "PICTURE"})
    region = next(region for region in area.regions if region.type == "WINDOW")
    window = bpy.context.window_manager.windows[0]
    with bpy.context.temp_override(window=window, area=area, region=region):
        bpy.ops.view3d.view_selected()
    for thing in bpy.context.scene.objects:
        thing.select_set(False)


def show_source() -> None:
    """Show the source image below the viewport."""
    window = bpy.context.window_manager.windows[0]
    (area,) = window.screen.areas
    with bpy.context.temp_override(window=window, area=area, region=area.regions[-1]):
        bpy.ops.screen.area_split(direction="HORIZONTAL", factor=0.4)
    (below,) = set(window.screen.areas) - {area}
    below.type = "IMAGE_EDITOR"
    below.spaces.active.image = bpy.context.scene.kiriko.result.source


def panels() -> list[str]:
    """Kiriko's panels with a header of their own in the sidebar, from the top down."""
    shown = kiriko("panels").CLASSES
    return [
        panel.__name__
        for panel in shown
        if getattr(panel, "bl_category", "") == "Kiriko"
        and not hasattr(panel, "bl_parent_id")
        and getattr(panel, "poll", lambda context: True)(bpy.context)
    ]
