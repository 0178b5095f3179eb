import json
from pathlib import Path

import bpy
import numpy as np
import pytest

from known.kiriko_zip import kiriko_zip
from small_rigs import cube, pixels, small_rig


@pytest.fixture
def saved(scene, tmp_path) -> Path:
    """A small rig, saved; the folder for results beside it."""
    small_rig()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    return tmp_path / "out"


@pytest.mark.every_blender
def test_solve_writes_everything_and_tells_its_progress(run, saved, capsys):
    """Exit code 0, progress on stdout, nothing on stderr.

    All files are there and the report is that of this rig.
    """
    assert run("solve", "--out", saved, "--preview", "--samples", 1) == 0
    told = capsys.readouterr()
    assert told.err == ""
    assert "%" in told.out

    names = {
        "source.png",
        "source.exr",
        "ideal.png",
        "seen.png",
        "coverage.png",
        "preview.png",
        "report.json",
    }

    assert {path.name for path in saved.iterdir()} == names
    report = json.loads((saved / "report.json").read_text())
    assert report["file"] == "rig.blend"
    assert report["picture_coverage"] > 0.99
    assert report["resolution"] == [64, 64]


@pytest.mark.parametrize("form", ["EXR_HALF", "EXR_FLOAT"])
def test_a_source_image_in_linear_light_is_one_file(run, saved, form):
    """It is the scene's result, to its own rounding; a second run replaces it only when told."""
    asked = ("solve", "--out", saved, "--format", form)
    assert run(*asked) == 0
    assert run(*asked) == 1
    assert run(*asked, "--overwrite") == 0
    files = {"source.exr", "ideal.png", "seen.png", "coverage.png", "report.json"}
    assert {path.name for path in saved.iterdir()} == files
    shown = pixels(bpy.context.scene.kiriko.result.source)[..., :3]
    image = bpy.data.images.load(str(saved / "source.exr"))
    number = np.float16 if form == "EXR_HALF" else np.float32
    assert np.array_equal(pixels(image)[..., :3], shown.astype(number).astype(np.float32))
    assert shown.max() > 0.1


def test_solve_takes_products_by_their_names(run, saved, capsys):
    """The open file's display is the named one, its glass has the named index.

    A name that is not in the catalogue is refused before anything is done.
    """
    products = ("--display", "iPhone SE (2022)", "--glass", "Water")
    assert run("solve", "--out", saved, *products) == 0
    told = capsys.readouterr().out
    assert "is now iPhone SE (2022)" in told
    assert "is now Water" in told
    report = json.loads((saved / "report.json").read_text())
    assert report["resolution"] == [1334, 750]
    assert report["display_size_m"] == pytest.approx([0.0254 * 1334 / 326, 0.0254 * 750 / 326])
    assert run("solve", "--out", saved, "--display", "Abacus") == 2
    assert "invalid choice: 'Abacus'" in capsys.readouterr().err


def refusal(capsys: pytest.CaptureFixture) -> str:
    """The one line on stderr."""
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("kiriko: ")
    assert line.endswith(".")
    return line


def test_missing_file_is_refused(run, tmp_path, capsys):
    """With no .blend loaded, as when its name was wrong, nothing is solved or written."""
    small_rig()
    assert run("solve", "--out", tmp_path / "out") == 1
    assert "No .blend file" in refusal(capsys)
    assert not (tmp_path / "out").exists()


def test_results_are_replaced_only_when_told(run, saved, capsys):
    """A folder with results is refused before any work, and accepted with --overwrite."""
    saved.mkdir()
    (saved / "ideal.png").write_bytes(b"mine")
    assert run("solve", "--out", saved) == 1
    assert "ideal.png already" in refusal(capsys)
    assert [path.name for path in saved.iterdir()] == ["ideal.png"]
    assert run("solve", "--out", saved, "--overwrite") == 0
    assert (saved / "ideal.png").read_bytes() != b"mine"


@pytest.mark.every_blender
def test_broken_rig_is_one_sentence(run, saved, capsys):
    """A rig without a display fails with the sentence of the panel, not with a traceback."""
    bpy.data.objects["Kiriko Display"].kiriko.role = "NONE"
    assert run("solve", "--out", saved) == 1
    assert "The rig has no display" in refusal(capsys)
    assert not saved.exists()  # things made for it are gone again


def test_folder_that_cannot_be_written_is_one_sentence(run, saved, capsys):
    """A folder below a file is refused with its name."""
    saved.write_bytes(b"")
    assert run("solve", "--out", saved / "below") == 1
    assert f"'{saved / 'below'}' cannot be written" in refusal(capsys)


@pytest.mark.parametrize(
    ("verb", "option", "needed"),
    [
        ("solve", ("--movie", "FFV1"), "--frames"),
        ("solve", ("--placeholders",), "--frames"),
        ("solve", ("--log", "1"), "--frames"),
        ("solve", ("--samples", "16"), "--preview"),
        ("solve", ("--name", "a_##"), "--frames"),
        ("solve", ("--frames", "1", "--test-card", "3"), "--movie"),
        ("solve", ("--name", "source_####"), "--frames"),
        ("solve", ("--frames", "1", "--test-card", "0"), "--movie"),
        ("job", ("--chunk", "10"), "--frames"),
        ("job", ("--name", "source_####"), "--frames"),
        ("join", ("--name", "a_##"), "--frames"),
        ("atlas", ("--zip", "kiriko.zip"), "--job"),
    ],
)
def test_an_option_that_would_do_nothing_is_refused(run, saved, capsys, verb, option, needed):
    assert run(verb, "--out", saved, *option) == 2
    (name,) = (word for word in option if word.startswith("--") and word != "--frames")
    assert refusal(capsys) == (
        f"kiriko: {name} would do nothing without {needed}: add {needed}, or leave out {name}."
    )
    assert not saved.exists()


@pytest.mark.parametrize(
    "argv",
    [
        (),
        ("dance",),
        ("solve",),
        ("solve", "--out", "x", "--format", "GIF"),
        ("solve", "--out", "x", "--samples", "1e2"),
        ("solve", "--out", "x", "--simulate", "0"),
        ("report", "--out", "x", "--seconds", "nan"),
        ("atlas", "--out", "x", "--most", "many"),
        ("atlas", "--out", "x", "--places", "2-b"),
        ("atlas", "--out", "x", "--share", "2"),
    ],
)
def test_mistyped_command_is_one_sentence(run, argv, capsys):
    """A command line that cannot be understood gives exit code 2."""
    assert run(*argv) == 2
    assert "--help" in (told := refusal(capsys))
    assert " _" not in told  # no function's name


def test_help_is_no_failure(run, capsys):
    """--help explains on stdout, exit code 0."""
    assert run("solve", "--help") == 0
    assert "--out DIR" in capsys.readouterr().out


def test_solve_simulates_when_asked(run, saved, capsys):
    """One picture more, and its numbers: light by path, with
    standard errors, is the picture's mean.
    """
    bpy.data.objects["Kiriko Plate"].kiriko.plate.model = "CROSSED"
    bpy.ops.wm.save_mainfile()
    assert run("solve", "--out", saved, "--simulate", 4) == 0
    told = capsys.readouterr()

    assert told.err == ""
    assert "simulating" in told.out
    found = json.loads((saved / "report.json").read_text())["simulated"]
    assert found["rays_a_pixel"] == 4
    assert 0 < found["noise"] < 0.2

    paths = {"none", "imaged", "stray_1", "stray_2", "through", "reflected"}
    assert set(found["luminance"]) == set(found["luminance_error"]) == paths
    assert found["luminance"]["imaged"] > found["luminance_error"]["imaged"] > 0
    image = bpy.data.images.load(str(saved / "simulated.png"))
    encoded = pixels(image)[..., :3]

    assert encoded.shape == (64, 64, 3)
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    assert (linear @ [0.2126, 0.7152, 0.0722]).mean() == pytest.approx(
        sum(found["luminance"].values()), rel=0.02
    )
    assert run("solve", "--out", saved, "--simulate", 4) == 1
    assert "simulated.png" in refusal(capsys)


@pytest.fixture
def two_saved(scene, tmp_path) -> Path:
    """Two small rigs of which the second is active, saved; the folder for results beside it."""
    small_rig()
    other = cube(turn=0.3)
    other.location.x, other.name = 0.2, "Other"
    scene.objects["Cube"].select_set(False)
    bpy.ops.kiriko.add_rig(viewer_resolution=32, display_resolution=(32, 32), field=0.04)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    return tmp_path / "out"


@pytest.mark.parametrize(
    ("words", "pixels"), [((), 32), (("--rig", "Kiriko Rig"), 64)], ids=["active", "named"]
)
def test_one_of_two_rigs_is_solved(run, two_saved, words, pixels):
    """The one that the file shows, or that is named."""
    assert run("solve", "--out", two_saved, *words) == 0
    report = json.loads((two_saved / "report.json").read_text())
    assert report["resolution"] == [pixels, pixels]


def test_all_rigs_are_solved_each_to_its_folder(run, two_saved):
    assert run("solve", "--out", two_saved, "--rig", "all") == 0
    assert run("drawing", "--out", two_saved, "--rig", "all", "--paper", "A3") == 0
    for name, side in (("Kiriko_Rig", 64), ("Kiriko_Rig_001", 32)):
        report = json.loads((two_saved / name / "report.json").read_text())
        assert report["resolution"] == [side, side]
        assert list((two_saved / name).glob("*.svg"))
    assert len(list(two_saved.iterdir())) == 2


def test_a_broken_second_rig_is_told_before_the_first_is_solved(run, two_saved, capsys):
    """Nothing is written."""
    display = next(one for one in bpy.data.objects if one.name.startswith("Kiriko Display.0"))
    display.scale = (0, 0, 0)
    bpy.ops.wm.save_mainfile()
    assert run("solve", "--out", two_saved, "--rig", "all") == 1
    assert display.name in refusal(capsys)
    assert not two_saved.exists()


def test_all_rigs_are_solved_at_frames_that_have_them_whole(run, two_saved):
    """Though the frame that the file shows lacks a part of one, as with that rig alone."""
    scene = bpy.context.scene
    display = next(one for one in scene.objects if one.name == "Kiriko Display")
    for frame in (1, 2):
        display.hide_viewport = frame == 1
        display.keyframe_insert("hide_viewport", frame=frame)
    scene.frame_set(1)
    bpy.ops.wm.save_mainfile()
    assert run("solve", "--out", two_saved, "--rig", "all", "--frames", "2") == 0
    images = sorted(path.parent.name for path in two_saved.rglob("source_0002.png"))
    assert images == ["Kiriko_Rig", "Kiriko_Rig_001"]
    assert run("solve", "--out", two_saved, "--rig", "all") == 1


def test_values_are_set_of_the_rig_that_is_solved(run, two_saved):
    """Whichever the file shows; with all of them, of each."""
    wanted = ("--set", "kiriko.tolerance", "0.5")
    assert run("solve", "--out", two_saved / "one", "--rig", "Kiriko Rig", *wanted) == 0
    told = json.loads((two_saved / "one" / "report.json").read_text())
    assert told["tolerance"] == pytest.approx(0.5)
    assert told["resolution"] == [64, 64]

    wanted = ("--set", "kiriko.tolerance", "0.25")
    assert run("solve", "--out", two_saved / "all", "--rig", "all", *wanted) == 0
    for path in sorted((two_saved / "all").glob("*/report.json")):
        assert json.loads(path.read_text())["tolerance"] == pytest.approx(0.25)


@pytest.mark.parametrize(
    "path",
    [
        'objects["Cube"].rotation_euler[2]',
        "objects['Cube'].rotation_euler[2]",
        "objects[Cube].rotation_euler[2]",
        'bpy.data.objects["Cube"].rotation_euler[2]',
    ],
)
def test_one_number_of_several_is_set(run, saved, capsys, path):
    """By the path that Copy Full Data Path gives, and as it is left where a shell takes quotes."""
    assert run("drawing", "--out", saved, "--set", path, "0.25") == 0
    assert f"'{path}' is now 0.25" in capsys.readouterr().out
    assert [*bpy.data.objects["Cube"].rotation_euler] == [0.0, 0.0, 0.25]


@pytest.mark.parametrize(
    ("name", "path"),
    [
        ("Glass [old]", 'objects["Glass [old]"]'),
        ("Glass [old]", "objects['Glass [old]']"),
        ('a "[b]"', r'objects["a \"[b]\""]'),
        ("It's", 'objects["It\'s"]'),
        ("A.001", "objects[A.001]"),
        ("-3", "objects['-3']"),
    ],
)
def test_names_of_any_signs_are_found(run, saved, name, path):
    """Those with brackets, quotes and points: a name in double quotes stays as it is."""
    cube = bpy.data.objects["Cube"]
    cube.name = name
    bpy.ops.wm.save_mainfile()
    assert run("drawing", "--out", saved, "--set", f"{path}.kiriko.ior", "1.25") == 0
    assert run("drawing", "--out", saved, "--overwrite", "--set", f"{path}.location[1]", "2") == 0
    assert cube.kiriko.ior == 1.25
    assert cube.location.y == 2.0


def test_numbers_of_several_that_are_not_there_are_refused(run, saved, capsys):
    """And none is, where all are named at once; the scene stays."""
    for path in ("location", "location[3]"):
        assert run("drawing", "--out", saved, "--set", f"objects[Cube].{path}", "1") == 1
        told = "has 3 numbers: set 'objects[Cube].location[0]' to "
        assert f"{told}'objects[Cube].location[2]'" in refusal(capsys)
    assert run("drawing", "--out", saved, "--set", "objects[Cube].location[0]", "nan") == 1
    assert "can't be 'nan': use another type of value" in refusal(capsys)
    for path in ("objects[Cube].matrix_world[0]", "kiriko.tolerance[0]", "objects[None].hide"):
        assert run("drawing", "--out", saved, "--set", path, "1") == 1
        assert f"The property '{path}' doesn't exist: name it like" in refusal(capsys)
    assert [*bpy.data.objects["Cube"].location] == [0.0, 0.0, 0.0]


def test_one_frame_is_no_frames(run, saved, capsys):
    """In the line that tells what is solved, too."""
    assert run("solve", "--out", saved, "--frames", "1") == 0
    assert "solving 1 frame of 'rig.blend'" in capsys.readouterr().out


def test_a_job_varies_one_number_of_several(run, saved):
    """As a glass that turns; the file stays as it is."""
    zipped = kiriko_zip(saved.parent / "kiriko-9.zip")
    turn = ("--vary", 'objects["Cube"].rotation_euler[2]', "--values", "0.1", "0.2")
    assert run("job", "--out", saved / "job", *turn, "--zip", zipped) == 0
    assert [*bpy.data.objects["Cube"].rotation_euler] == [0.0, 0.0, 0.0]


def test_a_job_of_all_rigs_has_the_values_in_each(run, two_saved):
    """The one that the file shows stays so."""
    zipped = kiriko_zip(two_saved.parent / "kiriko-9.zip")
    wanted = ("--set", "kiriko.tolerance", "0.5", "--zip", zipped)
    assert run("job", "--out", two_saved, "--rig", "all", "--frames", "1-2", *wanted) == 0
    bpy.ops.wm.open_mainfile(filepath=str(two_saved / "rig.blend"))
    assert bpy.context.scene.kiriko.tolerance == pytest.approx(0.5)
    assert run("solve", "--out", two_saved / "shown") == 0
    told = json.loads((two_saved / "shown" / "report.json").read_text())
    assert told["resolution"] == [32, 32]
    assert run("solve", "--out", two_saved / "other", "--rig", "Kiriko Rig") == 0
    told = json.loads((two_saved / "other" / "report.json").read_text())
    assert told["tolerance"] == pytest.approx(0.5)
    assert told["resolution"] == [64, 64]


def test_a_rig_that_is_not_there_is_refused(run, two_saved, capsys):
    """By its name, with those that are; nothing is written."""
    assert run("solve", "--out", two_saved, "--rig", "Goblet") == 1
    assert "no rig 'Goblet', only 'Kiriko Rig', 'Kiriko Rig.001'" in refusal(capsys)
    assert run("calibrate", "--out", two_saved, "--rig", "all", "--measured", "a.csv") == 2
    assert "A photograph shows only one rig" in refusal(capsys)
    assert not two_saved.exists()
