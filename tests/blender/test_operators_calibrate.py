"""From a photograph of a bench that is off to a source image for it, and back."""

import importlib
import json
import re
from collections.abc import Generator
from pathlib import Path
from types import ModuleType

import bpy
import numpy as np
import pytest

from small_rigs import (
    inventory,
    linear_lattice,
    new_object,
    pixels,
    primitive,
    record_text,
    small_rig,
)

HIDDEN = {
    "Kiriko Viewer: turn about the vertical axis": 0.08,
    "Kiriko Viewer: shift in depth": 0.6,
    "Kiriko Plate: turn about the horizontal axis": -0.06,
    "Kiriko Display: shift right": 0.4,
    "Cube: turn about the vertical axis": 0.2,
    "Cube: index": 0.002,
}


class Bench:
    """A rig in the scene, and the real bench: parts that are off by HIDDEN."""

    def __init__(
        self, kiriko: ModuleType, scene: bpy.types.Scene, hidden: dict = HIDDEN, **options: object
    ) -> None:
        self.kiriko, self.scene = kiriko, scene
        (
            self.work,
            self.misalignment,
            self.offset,
            self.lattice,
            self.picture,
            self.session,
            self.steps,
            self.image_io,
        ) = (
            importlib.import_module(f"{kiriko.__name__}.{name}")
            for name in (
                "operators.work",
                "core.lab.calibrate.misalignment",
                "core.bench.offset",
                "core.lab.calibrate.drawn",
                "core.image.flat_picture",
                "core.solve.session",
                "core.base.steps",
                "core.files.image_io",
            )
        )
        self.parts = small_rig(viewer_resolution=512, display_resolution=(512, 512), **options)
        self.parts["GLASS"].rotation_euler[2] = 0.2
        self.drawn = self.rig()
        self.real, unknown = self.offset.with_amounts(self.drawn, hidden)

        assert not unknown

    def source_of(self, rig):
        """Solved for a rig."""
        return self.steps.run_steps(
            self.session.Session().solve(rig, self.work.settings_of(self.scene))
        )

    def rig(self):
        """As Kiriko takes it, with its offset."""
        return self.work.read(bpy.context).rig

    def wanted(self) -> np.ndarray:
        """Where the lattice's points are to be seen (49, 2), viewer px."""
        lattice = self.lattice.Lattice(7, 7, 1 / 14)
        return self.picture.view_of_picture(self.drawn.picture_place, self.drawn.viewer, lattice.uv)

    def seen(self, rig) -> np.ndarray:
        """Where they are seen on the real bench (49, 2) while
        the display shows the source image of a rig.
        """
        settings = self.work.settings_of(self.scene)
        bench = self.misalignment.Bench
        lattice = self.lattice.Lattice(7, 7, 1 / 14)
        shown = bench(
            rig, settings, self.picture.view_of_picture(rig.picture_place, rig.viewer, lattice.uv)
        ).display
        return bench(self.real, settings, self.wanted(), []).seen(np.zeros(0), display=shown)

    def off(self, rig) -> float:
        """Mean distance, viewer px, from where they are to be seen."""
        return float(np.nanmean(np.linalg.norm(self.seen(rig) - self.wanted(), axis=1)))

    def photograph(self, path: Path, change=np.asarray) -> Path:
        """The sight of the source image on the real bench, changed somehow, as a file."""
        source = pixels(self.scene.kiriko.result.source)[..., :3]
        return self.image_io.write(path, change(self.source_of(self.real).seen(source)), "PNG8")

    def csv(self, path: Path, points: np.ndarray | None = None, names: bool = True) -> Path:
        """The points that are seen, with a little noise."""
        points = self.seen(self.drawn) if points is None else points
        points = points + np.random.default_rng(0).normal(0, 0.1, points.shape)
        lines = ["column,row,x,y" if names else "x,y"]
        for k, (x, y) in enumerate(points):
            lines.append(f"{k % 7 + 1},{k // 7 + 1},{x},{y}" if names else f"{x},{y}")
        path.write_text("\n".join(lines) + "\n")
        return path


@pytest.fixture
def bench(kiriko: ModuleType, scene: bpy.types.Scene) -> Bench:
    return Bench(kiriko, scene)


@pytest.fixture
def no_advice(kiriko: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where to take another photograph from is a third of the work, and told by other tests."""

    def none(*_: object) -> Generator[float, None, list]:
        yield 1.0
        return []

    module = importlib.import_module(f"{kiriko.__name__}.operators.calibrate")
    monkeypatch.setattr(module, "extra_photographs", none)


@pytest.mark.parametrize("names", [True, False])
def test_points_of_a_bench_that_is_off_make_it_right(
    bench: Bench, tmp_path: Path, names: bool
) -> None:
    """Kept as an offset: objects stay, the rig that is solved is
    another, and the real bench shows the picture.
    """
    before = bench.off(bench.drawn)
    assert before > 5
    places = {o.name: o.matrix_world.copy() for o in bpy.data.objects}
    assert bpy.ops.kiriko.calibrate(
        filepath=str(bench.csv(tmp_path / "points.csv", names=names))
    ) == {"FINISHED"}
    assert {o.name: o.matrix_world.copy() for o in bpy.data.objects} == places
    assert bench.off(bench.rig()) < 0.1

    ours = bench.scene.kiriko.calibration
    found = json.loads(ours.found)
    assert found["points"] == found["of"] == 49
    assert found["before_viewer_px"] == pytest.approx(before, rel=0.3)
    assert found["after_viewer_px"] < 0.2
    assert found["condition"] is None or found["condition"] > 1e6
    assert {entry["name"] for entry in found["amounts"]} >= set(HIDDEN)
    assert "Cube: shift right" in found["still"]
    assert found["extra_photographs"][0]["gain_bits"] > 1
    assert "offset" in bench.scene.kiriko.result.notes

    bpy.ops.kiriko.remove_calibration()
    assert bench.off(bench.rig()) == pytest.approx(before)
    with pytest.raises(RuntimeError, match="No calibration yet"):
        bpy.ops.kiriko.remove_calibration()


@pytest.mark.usefixtures("no_advice")
def test_a_photograph_does_it_too(bench: Bench, tmp_path: Path) -> None:
    """Solved, shown on a bench that is off, photographed, found
    in the image, fitted, solved again: all of it.
    """
    bpy.ops.kiriko.solve()
    path = bench.photograph(tmp_path / "photograph.png")
    bpy.ops.kiriko.calibrate(filepath=str(path))
    assert bench.off(bench.rig()) < 0.3
    bpy.ops.kiriko.remove_calibration()


@pytest.mark.usefixtures("no_advice")
@pytest.mark.parametrize(("look_down", "by"), [(0, "photograph"), (90, "points")])
def test_a_bench_without_a_plate_is_calibrated(
    kiriko: ModuleType, scene: bpy.types.Scene, tmp_path: Path, look_down: float, by: str
) -> None:
    """A display behind the glass, or under it: the same steps, and no word of a plate."""
    hidden = {name: amount for name, amount in HIDDEN.items() if "Plate" not in name}
    bench = Bench(
        kiriko,
        scene,
        hidden,
        kind="BEHIND_GLASS",
        look_down=np.radians(look_down),
        field=0.06,
        picture_size=0.02,
        display_size=0.05,
        distance=0.02,  # else a turned glass would stand in the display
    )
    assert "PLATE" not in bench.parts
    bpy.ops.kiriko.solve()
    before = bench.off(bench.drawn)
    assert before > 1
    path = (bench.csv if by == "points" else bench.photograph)(
        tmp_path / ("points.csv" if by == "points" else "photograph.png")
    )
    bpy.ops.kiriko.calibrate(filepath=str(path))
    assert bench.off(bench.rig()) < 0.3
    found = json.loads(bench.scene.kiriko.calibration.found)
    assert found["points"] == found["of"] == 49
    told = json.dumps(found) + bench.scene.kiriko.result.notes
    assert "Plate" not in told
    assert not re.search(r"\bplate\b", told.replace("no plate", ""))
    bpy.ops.kiriko.remove_calibration()
    assert bench.off(bench.rig()) == pytest.approx(before)


@pytest.mark.parametrize(
    ("name", "flip"), [("mirrored", np.fliplr), ("upside down", lambda a: a[::-1, ::-1])]
)
@pytest.mark.parametrize("own", [False, True])
def test_a_photograph_held_another_way_is_refused(
    bench: Bench, tmp_path: Path, name: str, flip, own: bool
) -> None:
    """Of coloured dots, and of the lattice with its two larger dots."""
    if own:
        bpy.ops.kiriko.lattice_picture()
    bpy.ops.kiriko.solve()
    path = bench.photograph(tmp_path / "photograph.png", flip)
    with pytest.raises(RuntimeError, match=name):
        bpy.ops.kiriko.calibrate(filepath=str(path))
    assert bench.scene.kiriko.calibration.offset == ""


@pytest.mark.usefixtures("no_advice")
def test_what_the_display_does_not_show_is_not_missed(bench: Bench, tmp_path: Path) -> None:
    """A column beside the display is not in the photograph, and
    the others are told apart all the same.
    """
    display = bench.parts["DISPLAY"]
    display.location += display.matrix_world.to_3x3().col[0].normalized() * 0.004
    bpy.context.view_layer.update()
    bench.drawn = bench.rig()
    bench.real, _ = bench.offset.with_amounts(bench.drawn, HIDDEN)
    bpy.ops.kiriko.solve()
    before = bench.off(bench.drawn)
    bpy.ops.kiriko.calibrate(filepath=str(bench.photograph(tmp_path / "photograph.png")))
    found = json.loads(bench.scene.kiriko.calibration.found)
    assert found["points"] in (35, 42)  # whole columns; a dot that the border cuts may count or not
    assert bench.off(bench.rig()) < 0.3 < before


@pytest.mark.usefixtures("no_advice")
def test_the_same_file_again_takes_its_own_place(bench: Bench, tmp_path: Path) -> None:
    """With the index known, as with other tolerances: an earlier fit does not count twice."""
    path = str(bench.csv(tmp_path / "points.csv"))
    bpy.ops.kiriko.calibrate(filepath=path)
    ours = bench.scene.kiriko.calibration
    ours.index = ours.crossing = 0.0
    bpy.ops.kiriko.calibrate(filepath=path)
    (amounts,) = json.loads(ours.offset)["sets"]

    assert not any("index" in name for name in amounts)
    assert bench.off(bench.rig()) < 0.3
    ours.keep = "SCENE"
    bpy.ops.kiriko.calibrate(filepath=path)

    assert ours.offset == ""
    assert bench.off(bench.rig()) < 0.3
    with pytest.raises(RuntimeError, match="is already applied"):
        bpy.ops.kiriko.calibrate(filepath=path)


@pytest.mark.usefixtures("no_advice")
def test_offsets_add_up(bench: Bench, tmp_path: Path) -> None:
    """A second photograph is of the calibrated picture: its amounts come on top."""
    bpy.ops.kiriko.calibrate(filepath=str(bench.csv(tmp_path / "first.csv")))
    once = bench.off(bench.rig())
    bpy.ops.kiriko.calibrate(
        filepath=str(bench.csv(tmp_path / "second.csv", bench.seen(bench.rig())))
    )
    assert len(json.loads(bench.scene.kiriko.calibration.offset)["sets"]) == 2
    assert bench.off(bench.rig()) < once + 0.05


def test_an_offset_goes_into_the_scene(bench: Bench) -> None:
    """The same rig to single precision, by objects that were
    moved, one of them with a parent, and settings.
    """
    holder = bpy.data.objects.new("Holder", None)
    bench.scene.collection.objects.link(holder)
    holder.location = (0.1, 0.2, 0.3)
    holder.rotation_euler = (0.3, 0.2, 0.1)
    bpy.context.view_layer.update()
    plate = bench.parts["PLATE"]
    plate.parent = holder
    plate.matrix_parent_inverse = holder.matrix_world.inverted()
    display = bench.parts["DISPLAY"]
    display.parent = plate
    display.matrix_parent_inverse = plate.matrix_world.inverted()
    bench.scene.kiriko.calibration.offset = record_text(
        {"sets": [HIDDEN, {"Kiriko Viewer: focal length": 0.2}]}
    )
    wanted = bench.rig()

    assert bpy.ops.kiriko.apply_calibration() == {"FINISHED"}
    assert bench.scene.kiriko.calibration.offset == ""
    found = bench.rig()
    assert np.allclose(found.plates[0].mesh.vertices, wanted.plates[0].mesh.vertices, atol=1e-6)
    assert np.allclose(found.display.mesh.vertices, wanted.display.mesh.vertices, atol=1e-6)
    assert np.allclose(found.viewer.axes, wanted.viewer.axes, atol=1e-6)
    assert np.allclose(found.viewer.window, wanted.viewer.window, rtol=1e-5)
    assert found.glasses[0].ior.at(0) == pytest.approx(wanted.glasses[0].ior.at(0), abs=1e-6)

    corners = bench.lattice.Lattice(2, 2, 0.0).uv
    seen = bench.picture.view_of_picture(found.picture_place, found.viewer, corners)
    assert (
        np.abs(
            seen
            - bench.picture.view_of_picture(bench.drawn.picture_place, bench.drawn.viewer, corners)
        ).max()
        < 0.01
    )


@pytest.mark.parametrize("holds", ["constraint", "keyframes", "lens", "strip", "mirror", "name"])
def test_what_is_held_is_not_moved(bench: Bench, holds: str) -> None:
    """All stays as it was, channel by channel, the offset too."""
    bench.scene.kiriko.calibration.offset = record_text(
        {"sets": [{**HIDDEN, "Kiriko Plate: shift up": 0.5}]}
    )
    plate = bench.parts["PLATE"]
    if holds == "constraint":
        constraint = plate.constraints.new("LIMIT_LOCATION")
        constraint.use_max_z = constraint.use_min_z = True
        constraint.max_z = constraint.min_z = plate.location.z
    elif holds == "keyframes":
        plate.keyframe_insert("location")
    elif holds == "lens":
        bench.scene.kiriko.viewer.data.keyframe_insert("lens")
    elif holds == "strip":
        plate.keyframe_insert("location")
        plate.animation_data.nla_tracks.new().strips.new("moves", 1, plate.animation_data.action)
        plate.animation_data.action = None
    elif holds == "mirror":
        mirror = new_object(primitive("grid", x_segments=1, y_segments=1, size=0.01), "MIRROR")
        mirror.parent = plate
        mirror.location = (0.2, 0.2, 0.1)
    else:
        plate.name = "Other Plate"

    bench.parts["GLASS"].rotation_euler[2] = 12.77  # two turns more than a matrix tells
    bpy.context.view_layer.update()

    def state() -> dict:
        return {
            o.name: (o.matrix_world.copy(), o.location[:], o.rotation_euler[:], o.scale[:])
            for o in bpy.data.objects
        }

    places = state()
    offset = bench.scene.kiriko.calibration.offset
    with pytest.raises(
        RuntimeError, match="which is not in this rig" if holds == "name" else "Keep the offset"
    ):
        bpy.ops.kiriko.apply_calibration()

    bpy.context.view_layer.update()
    assert state() == places
    assert bench.scene.kiriko.calibration.offset == offset


@pytest.mark.usefixtures("no_advice")
def test_a_preview_is_of_the_fitted_rig(bench: Bench, tmp_path: Path) -> None:
    """Cycles sees the lattice where it is wanted, though the objects stand elsewhere.

    Not so without the offset.
    """
    bpy.ops.kiriko.calibrate(filepath=str(bench.csv(tmp_path / "points.csv")))
    preview, seen_image, ideal_image = (
        importlib.import_module(f"{bench.kiriko.__name__}.core.{name}")
        for name in ("blender.preview.cycles_preview", "image.seen_image", "image.seen_image")
    )
    ideal = ideal_image.ideal_image(bench.drawn.picture, bench.drawn.viewer)
    reading = bench.work.read(bpy.context)
    source = bench.scene.kiriko.result.source
    render = preview.render_preview(bench.scene, reading, source, samples=4, fresnel=False)

    assert seen_image.lattice_shift(render, ideal).mean < 0.1
    bpy.ops.kiriko.remove_calibration()
    render = preview.render_preview(
        bench.scene, bench.work.read(bpy.context), source, samples=4, fresnel=False
    )

    assert seen_image.lattice_shift(render, ideal).mean > 3


BAD = {
    "no file": ("", "choose a photograph"),
    "missing file": (None, "cannot be read"),
    "no points": ("column,row,x,y\n", "no points"),
    "no numbers": ("column,row,x,y\n1,1,a,b\n", "number"),
    "three points": ("column,row,x,y\n1,1,99,99\n2,1,150,99\n1,2,99,150\n", "Only 3 points"),
    "beside the lattice": ("column,row,x,y\n8,1,1,1\n", "columns run from 1 to 7"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_files_change_nothing(bench: Bench, tmp_path: Path, case: str) -> None:
    text, words = BAD[case]
    path = tmp_path / "points.csv"
    if text:
        path.write_text(text)
    before = inventory()
    with pytest.raises(RuntimeError, match=words):
        bpy.ops.kiriko.calibrate(filepath="" if text == "" else str(path))
    ours = bench.scene.kiriko.calibration
    assert inventory() == before
    assert ours.found == ours.offset == ""
    assert bench.scene.kiriko.result.source is None


def state(scene: bpy.types.Scene) -> tuple:
    """All that a calibration writes to."""
    result = scene.kiriko.result
    ours = scene.kiriko.calibration
    places = {thing.name: tuple(map(tuple, thing.matrix_world)) for thing in bpy.data.objects}
    told = ours.found, ours.offset, result.summary, result.details, result.notes
    return (
        inventory(),
        places,
        told,
        pixels(result.source).tobytes(),
        [g.kiriko.ior for g in scene.objects],
    )


@pytest.mark.parametrize("stage", ["calibrate.fit", "calibrate.write_solution"])
def test_a_calibration_that_fails_changes_nothing(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stage: str
) -> None:
    """First and last, where parts would be moved by it."""
    points = bench.csv(tmp_path / "points.csv", bench.wanted())
    bpy.ops.kiriko.solve()
    ours = bench.scene.kiriko.calibration
    ours.keep = "SCENE"
    # shifts alone, and small ones: what is fitted is not asked here
    ours.turn = ours.crossing = ours.index = ours.mirror = ours.focal = 0.0
    before = state(bench.scene)

    def fail(*_: object, **__: object) -> None:
        raise ValueError("an odd\nnumber")

    module, name = stage.split(".")
    owner = importlib.import_module(f"{bench.kiriko.__name__}.operators.{module}")
    monkeypatch.setattr(owner, name, fail)
    words = r"Calibrate failed \(ValueError: an odd number\).*\.$"
    with pytest.raises(RuntimeError, match=words):
        bpy.ops.kiriko.calibrate(filepath=str(points))
    assert state(bench.scene) == before


def test_the_lattice_becomes_the_picture(bench: Bench) -> None:
    ours = bench.scene.kiriko.calibration
    ours.columns = 9
    ours.rows = 6
    ours.margin = 0.1
    ours.style = "GRID"
    assert bpy.ops.kiriko.lattice_picture() == {"FINISHED"}
    shown = bench.parts["PICTURE"].kiriko.image
    assert bench.rig().picture.image.shape[:2] == tuple(shown.size)
    lattice = pixels(shown)[..., 0]
    assert 0.02 < (lattice > 0.5).mean() < 0.3
    assert not np.allclose(lattice[:1024, :1024], linear_lattice()[..., 0][:1024, :1024], atol=0.1)


def test_the_command_line_calibrates(
    bench: Bench, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """Fit, source image and a .blend that has the offset; the file that was given stays."""
    run = importlib.import_module(f"{bench.kiriko.__name__}.operators.cli.command_line").run
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    before = (tmp_path / "rig.blend").read_bytes()
    points = bench.csv(tmp_path / "points.csv")
    out = tmp_path / "out"

    assert run(["calibrate", "--out", str(out), "--measured", str(points)]) == 0, (
        capsys.readouterr().err
    )
    assert (tmp_path / "rig.blend").read_bytes() == before
    assert {"calibration.json", "calibrated.blend", "source.png", "report.json"} <= {
        p.name for p in out.iterdir()
    }
    assert json.loads((out / "calibration.json").read_text())["points"] == 49
    assert run(["calibrate", "--out", str(out), "--measured", str(points)]) == 1
    assert "already" in capsys.readouterr().err
    assert (
        run(
            ["calibrate", "--out", str(tmp_path / "none"), "--measured", str(tmp_path / "none.csv")]
        )
        == 1
    )
    assert not (tmp_path / "none").exists()

    bpy.ops.wm.open_mainfile(filepath=str(out / "calibrated.blend"))
    assert json.loads(bpy.context.scene.kiriko.calibration.offset)
