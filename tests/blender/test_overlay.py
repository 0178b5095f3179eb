"""The overlay: the sketch that is kept up to date, and what is handed to the GPU of it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from types import ModuleType, SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest

from extension import loaded
from small_rigs import new_object, primitive, show_scene, small_rig


@pytest.fixture
def sketcher(scene, monkeypatch) -> Iterator[ModuleType]:
    """Module operators.sketcher, which takes all viewports for looked at, and does not wait."""
    module = loaded("operators.sketcher")
    monkeypatch.setattr(module, "is_looked_at", lambda area: area.type == "VIEW_3D")
    monkeypatch.setattr(module, "SHARE", 0.0)
    monkeypatch.setattr(module, "QUIET", 0.0)
    monkeypatch.setattr(module.chosen, "POLLING", 0.0)
    yield module
    module.on_load()


@pytest.fixture
def overlay(sketcher, kiriko, monkeypatch) -> ModuleType:
    """Package panels.overlay, which hands all to a stand-in for the GPU, and hides no error."""
    module = loaded("panels.overlay")
    for name in ("lines", "overlay_text"):
        drawer = getattr(module, name)
        monkeypatch.setattr(drawer, "gpu", PAPER)
        monkeypatch.setattr(drawer, "batch_for_shader", Batch)
    monkeypatch.setattr(module.overlay_text, "blf", PAPER.blf)
    monkeypatch.setattr(module, "_failed", [])
    PAPER.clear()
    return module


@dataclass
class Batch:
    """Takes the place of a batch, and checks what it is made of."""

    shader: "Shader"
    kind: str
    content: dict[str, list]

    def __post_init__(self) -> None:
        corners = {"LINES": 2, "TRIS": 3}[self.kind]
        for values in self.content.values():
            assert len(values) % corners == 0
            assert len(values)
            assert np.isfinite(np.array(values, float)).all()

    def draw(self, shader: "Shader") -> None:
        assert shader.name == self.shader.name
        PAPER.drawn.append((self.kind, dict(shader.values), np.array(self.content["pos"])))


@dataclass
class Shader:
    """Takes the place of a shader."""

    name: str
    values: dict[str, Any] = field(default_factory=dict)

    def bind(self) -> None:
        self.values.clear()

    def uniform_float(self, name: str, value: Any) -> None:
        self.values[name] = value


class Paper:
    """Takes the place of gpu and blf, and keeps all that is drawn."""

    def __init__(self) -> None:
        self.drawn: list[tuple[str, dict[str, Any], np.ndarray]] = []
        self.words: list[str] = []
        self.shader = SimpleNamespace(from_builtin=Shader)
        self.state = SimpleNamespace(blend_set=self.nothing, depth_test_set=self.nothing)
        self.blf = SimpleNamespace(
            SHADOW=1,
            dimensions=lambda font, text: (7.0 * len(text), 10.0),
            draw=lambda font, text: self.words.append(text),
            **dict.fromkeys(
                ("size", "enable", "disable", "shadow", "shadow_offset", "color", "position"),
                self.nothing,
            ),
        )

    def nothing(self, *_: object) -> None:
        pass

    def clear(self) -> None:
        self.drawn.clear()
        self.words.clear()

    def lines_of(self, colour: tuple[float, float, float]) -> list[np.ndarray]:
        return [
            ends
            for kind, values, ends in self.drawn
            if kind == "LINES" and values["color"][:3] == colour
        ]


PAPER = Paper()


def looked(sketcher: ModuleType) -> Any:
    """The scene's drawing once all that is to be done is done."""
    bpy.context.view_layer.update()
    for _ in range(1000):
        if not sketcher.draw_next():
            return sketcher.drawing_of(bpy.context.scene)
    raise AssertionError("there is no end of it")


def drawn(overlay: ModuleType) -> list:
    """All that is drawn over a viewport that looks at the rig."""
    PAPER.clear()
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    region = next(region for region in area.regions if region.type == "WINDOW")
    with bpy.context.temp_override(window=window, area=area, region=region):
        overlay.draw_in_space()
        overlay.draw_in_pixels()
    assert not overlay._failed
    return PAPER.drawn


def test_the_light_of_a_rig_is_sketched_where_it_goes(sketcher):
    """From viewer to display, in metres, whatever the scene's unit; distances as Add Rig made
    them.
    """
    scene = bpy.context.scene
    for metres in (1.0, 0.001):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        scene = bpy.context.scene
        scene.unit_settings.scale_length = metres
        mesh = primitive("cube", size=0.05 / metres)
        glass = new_object(mesh, "GLASS")
        glass.select_set(True)
        glass.kiriko.use_ior = True
        bpy.ops.kiriko.add_rig(viewer_resolution=64, display_resolution=(64, 64))
        rig = {thing.kiriko.role: thing for thing in scene.objects}
        drawing = looked(sketcher)
        assert drawing.metres == pytest.approx(metres)

        *_, middle = drawing.sketch.light.ways
        assert middle.has_arrived
        ends = middle.points[[0, -1]] / metres
        places = [scene.kiriko.viewer.location, rig["DISPLAY"].location]
        assert np.abs(ends - np.array(places)).max() < 1e-5 / metres
        distance = (rig["PLATE"].location - glass.location).length * metres
        assert drawing.sketch.dimensions[0].length == pytest.approx(distance, rel=1e-6)


def test_the_sketch_follows_the_scene_and_rests_else(sketcher, monkeypatch):
    """A move of the glass changes it; without a change nothing is read; a change that does not
    count leaves it as it is.
    """
    glass = small_rig()["GLASS"]
    n_read = []
    read = sketcher.read_places
    monkeypatch.setattr(sketcher, "read_places", lambda *a: n_read.append(1) or read(*a))
    first = looked(sketcher)
    assert len(n_read) == 1
    assert looked(sketcher) is first
    assert len(n_read) == 1

    glass.location.z += 0.002
    second = looked(sketcher)
    assert second is not first
    moved = second.sketch.light.ways[4].points[-1] - first.sketch.light.ways[4].points[-1]
    assert np.isfinite(moved).all()

    new_object(primitive("cube", size=1.0))
    assert looked(sketcher) is second
    bpy.context.scene.kiriko.max_events = 2
    third = looked(sketcher)
    assert {note.text for note in third.sketch.notes} >= {"cut off by Max Events"}


def test_a_picture_in_the_viewers_pixels_is_looked_at_over_its_frame(sketcher):
    """The corners are those of the frame, and no plane is needed."""
    small_rig()
    ours = bpy.context.scene.kiriko
    ours.picture_image, ours.picture_source = bpy.data.images["Kiriko Lattice"], "IMAGE"
    sketch = looked(sketcher).sketch
    assert len(sketch.light.ways) == 5
    assert sketch.light.ways[4].has_arrived
    frame = np.concatenate([line.points for line in sketch.lines if line.state == "picture"])
    assert np.abs(np.abs(frame[:, [0, 2]]) - 0.02).max() < 1e-6


def nothing(rig: dict[str, bpy.types.Object]) -> None:
    for thing in list(bpy.context.scene.objects):
        bpy.data.objects.remove(thing)


def hide(role: str) -> Callable[[dict[str, bpy.types.Object]], None]:
    return lambda rig: rig[role].hide_set(True)


def no_camera(rig: dict[str, bpy.types.Object]) -> None:
    bpy.context.scene.kiriko.viewer = bpy.context.scene.camera = None


def no_image(rig: dict[str, bpy.types.Object]) -> None:
    rig["PICTURE"].data.materials.clear()
    rig["PICTURE"].kiriko.image = None


def no_number(rig: dict[str, bpy.types.Object]) -> None:
    rig["PLATE"].data.vertices[0].co.x = float("nan")


def no_place(rig: dict[str, bpy.types.Object]) -> None:
    rig["DISPLAY"].location.x = float("nan")


def camera_as_glass(rig: dict[str, bpy.types.Object]) -> None:
    new_object(bpy.data.cameras.new("c"), "GLASS")


def bent_plate(rig: dict[str, bpy.types.Object]) -> None:
    rig["PLATE"].data.vertices[0].co.z += 0.1


@pytest.mark.parametrize(
    "spoil",
    [
        nothing,
        *map(hide, ("GLASS", "PLATE", "DISPLAY", "PICTURE")),
        no_camera,
        no_image,
        no_number,
        no_place,
        camera_as_glass,
        bent_plate,
    ],
)
def test_a_rig_that_cannot_be_solved_is_drawn_as_far_as_it_goes(sketcher, overlay, spoil):
    """No light, no error, and all that is drawn has a place."""
    rig = small_rig()
    assert looked(sketcher).sketch.light.ways
    spoil(rig)
    drawing = looked(sketcher)
    assert drawing.sketch.light.ways == ()
    drawn(overlay)
    assert not PAPER.lines_of(overlay.lines.colours.ARRIVES)
    if spoil not in (nothing, no_place, camera_as_glass):
        assert PAPER.drawn


def test_it_is_drawn_in_the_colours_of_its_light(sketcher, overlay):
    """Ways that arrive in one colour, those that are lost, and the hatch, in another, in Blender's
    units.
    """
    colours = overlay.lines.colours
    rig = small_rig()
    looked(sketcher)
    drawn(overlay)
    (ways,) = PAPER.lines_of(colours.ARRIVES)
    assert not PAPER.lines_of(colours.LOST)
    assert np.abs(ways - np.array(rig["DISPLAY"].location)).max(axis=1).min() < 1e-6

    rig["PLATE"].scale = (0.02, 0.02, 0.02)
    looked(sketcher)
    drawn(overlay)
    assert len(PAPER.lines_of(colours.LOST)) == 2  # ways and hatch


def test_words_are_distances_in_the_scenes_unit_and_reasons(sketcher, overlay, monkeypatch):
    """Each where it belongs, the same words once if they would be at one place. Names are those of
    parts that are selected or under the pointer.
    """
    bpy.context.scene.unit_settings.length_unit = "MILLIMETERS"
    rig = small_rig(distance=0.15)
    monkeypatch.setattr(
        overlay.overlay_text,
        "location_3d_to_region_2d",
        lambda region, data, place: Flat(place),
    )
    text = overlay.overlay_text
    whole = np.array([[-1e4, -1e4], [1e4, 1e4]])
    monkeypatch.setattr(
        text, "controls_of", lambda _: overlay.label_layout.Obstacles((), (), whole)
    )
    select(rig["PLATE"])
    looked(sketcher)
    drawn(overlay)
    aerial = "mid-air image of the display"
    assert sorted(PAPER.words) == ["150 mm", "150 mm", "Kiriko Plate", aerial]
    monkeypatch.setattr(text, "pointed_at", lambda region: "Kiriko Display")
    drawn(overlay)
    assert sorted(PAPER.words) == ["150 mm", "150 mm", "Kiriko Display", "Kiriko Plate", aerial]

    # a smaller unit counts at once, for the drawing of before, too
    units = bpy.context.scene.unit_settings
    units.scale_length = 0.01
    drawn(overlay)
    assert sorted(PAPER.words) == ["1.5 mm", "1.5 mm", "Kiriko Display", "Kiriko Plate", aerial]
    units.scale_length = 1.0
    rig["DISPLAY"].show_name = True  # by Blender itself
    rig["PLATE"].hide_viewport = True
    bpy.context.view_layer.update()
    drawn(overlay)
    assert not [word for word in PAPER.words if word.startswith("Kiriko")]
    rig["PLATE"].hide_viewport = False

    rig["PLATE"].scale = (0.02, 0.02, 0.02)
    looked(sketcher)
    drawn(overlay)
    assert "missed the plate" in PAPER.words


class Flat(tuple):
    """A place seen from x, 2000 px to a metre."""

    def __new__(cls, place: list[float]) -> "Flat":
        return super().__new__(cls, (2000 * place[1] + 500, 2000 * place[2] + 500))


def test_nothing_is_drawn_where_it_is_not_asked_for(sketcher, overlay, monkeypatch):
    """Not with the toggle off, not where the tab is closed, not over another scene."""
    small_rig()
    looked(sketcher)
    shown = bpy.context.window_manager.kiriko
    shown.show_overlay = False
    assert not drawn(overlay)
    shown.show_overlay = True
    assert drawn(overlay)

    mine = bpy.context.scene
    show_scene(bpy.data.scenes.new("other"))
    assert not drawn(overlay)
    show_scene(mine)
    monkeypatch.setattr(sketcher, "is_looked_at", lambda area: False)
    assert not drawn(overlay)


def select(*things: bpy.types.Object) -> None:
    for thing in bpy.context.scene.objects:
        thing.select_set(thing in things)


def test_labels_cover_nothing(kiriko):
    """Not each other, the navigation gizmo, or the picture; they stay within the free region. The
    picture is covered if its surroundings are not free. The same words are not written twice.
    """
    layout = loaded("panels.overlay.label_layout")
    free = np.array([[0.0, 0.0], [400.0, 300.0]])
    gizmo = np.array([[300.0, 200.0], [400.0, 300.0]])
    picture = np.array([[100.0, 100.0], [250.0, 200.0]])
    obstacles = layout.Obstacles((gizmo,), (picture,), free)
    generator = np.random.default_rng(1)
    taken: list = []
    for n in range(60):
        place = generator.uniform((-50, -50), (450, 350))
        label = layout.Sized(f"label {n}", place, np.array([60.0, 12.0]))
        box = layout.box_for(label, taken, obstacles, 1.0)
        if box is None:
            continue
        assert not any(layout._overlap(box, other) for other in (gizmo, *(b for _, b in taken)))
        assert (box >= free[0]).all()
        assert (box <= free[1]).all()
        taken.append((label.text, box))
    assert len(taken) > 15

    at = layout.Sized("name", picture.mean(axis=0), np.array([60.0, 12.0]))
    box = layout.box_for(at, [], obstacles, 1.0)
    assert not layout._overlap(box, picture)
    assert layout.box_for(at, [("name", box)], obstacles, 1.0) is None
    all_of_it = layout.Obstacles((), (free,), free)
    assert layout.box_for(at, [], all_of_it, 1.0) is not None


@pytest.mark.parametrize(
    ("y", "z", "name"), [(0.0, 0.0, "Small"), (0.03, 0.0, "Large"), (9, 9, "")]
)
def test_the_part_under_the_pointer_is_the_smallest_there(
    scene, kiriko, monkeypatch, y: float, z: float, name: str
):
    """Seen from x, a small box before or in a large one."""
    pointer = loaded("panels.overlay.pointer")
    rig = bpy.data.collections.new("rig")
    scene.collection.children.link(rig)
    for size, label in ((0.1, "Large"), (0.02, "Small")):
        thing = bpy.data.objects.new(label, primitive("cube", size=size))
        thing.kiriko.role = "GLASS"
        rig.objects.link(thing)
    bpy.context.view_layer.update()
    monkeypatch.setattr(pointer, "active_rig", lambda scene: rig)
    monkeypatch.setattr(
        pointer, "location_3d_to_region_2d", lambda region, data, place: Flat(place)
    )
    context = SimpleNamespace(scene=scene, region=None, region_data=None)
    assert pointer.part_at(context, np.array(Flat((0, y, z)))) == name


def test_glass_is_outlined_in_a_view_through_the_viewer(sketcher, overlay, monkeypatch):
    """A cube seen straight from the front has its four front edges as contours, whatever the light.
    They are drawn although Blender's overlays are off, and nothing else is.
    """
    glass = small_rig()["GLASS"]
    monkeypatch.setattr(sketcher, "is_looked_at", lambda area: False)
    assert not drawn(overlay)
    bpy.ops.kiriko.look_through()
    drawing = looked(sketcher)
    corners = np.array([glass.matrix_world @ v.co for v in glass.data.vertices])
    front = corners[np.argsort(corners[:, 1])[:4]]
    assert len(drawing.contours) == 4
    assert np.unique(np.round(drawing.contours.reshape(-1, 3), 6), axis=0) == pytest.approx(
        np.unique(np.round(front, 6), axis=0), abs=1e-6
    )
    assert {kind for kind, *_ in drawn(overlay)} == {"LINES"}
    assert len(PAPER.lines_of(overlay.colours.CONTOUR)) == 1
    bpy.ops.kiriko.look_through()
    assert not drawn(overlay)


@pytest.mark.parametrize("is_perspective", [True, False])
def test_contours_are_where_the_sight_touches_the_body(kiriko, is_perspective):
    """On a finely divided sphere each lies within an edge's length of the circle of tangents; an
    open edge is one, too.
    """
    mesh_of, module = loaded("core.rig.mesh").Mesh, loaded("core.blender.view.contours")
    sphere = primitive("icosphere", subdivisions=5, radius=1.0)
    vertices = np.array([v.co for v in sphere.vertices], float)
    triangles = np.array([p.vertices for p in sphere.polygons])
    projection = "perspective" if is_perspective else "orthographic"
    viewer = SimpleNamespace(
        position=np.array([0.0, -3.0, 0.0]),
        axes=np.array([[1.0, 0, 0], [0, 0, 1], [0, 1, 0]]),
        projection=projection,
    )
    mesh = mesh_of(vertices, triangles)
    found = module.contours(mesh, module.edges_of(mesh), viewer)
    assert len(found) > 80
    expected = -1 / 3 if is_perspective else 0.0
    assert np.abs(found[..., 1] - expected).max() < 0.07
    cut = mesh_of(vertices, triangles[1:])
    assert len(module.contours(cut, module.edges_of(cut), viewer)) >= len(found) + 1


def test_an_error_ends_the_overlay_and_is_told_once(sketcher, overlay, monkeypatch, capsys):
    """Blender goes on drawing, the console has the traceback, and it is not tried again."""
    small_rig()
    looked(sketcher)

    def fail(*_: object) -> None:
        raise ZeroDivisionError("no such thing")

    monkeypatch.setattr(overlay.lines, "strokes_of", fail)
    for _ in range(2):
        with pytest.raises(AssertionError):
            drawn(overlay)
    assert len(overlay._failed) == 1
    assert capsys.readouterr().err.count("ZeroDivisionError: no such thing") == 1
