"""Atlases: warp maps over a grid of heads, blended between them."""

import importlib.util
import json
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from kiriko.core.base.errors import ImageError, RigError
from kiriko.core.base.messages import Message
from kiriko.core.base.steps import run_steps
from kiriko.core.lab.atlas import atlas as atlas_plan
from kiriko.core.lab.atlas import atlas as atlases
from kiriko.core.lab.atlas import atlas as making
from kiriko.core.lab.atlas import head_map
from kiriko.core.lab.atlas.head_map import _Line, _worst_between, map_at, refine
from kiriko.core.lab.atlas.heads import HeadBox, HeadGrid, check_viewer, viewer_at
from kiriko.core.rig.settings import Settings
from kiriko.core.rig.views import Views
from kiriko.core.solve.session import Session
from known.closed_forms import landing, through_slab
from known.reference_rigs import ball_rig, box, rig
from known.work import drain

SMALL = {"pixels": 48, "display_pixels": 48}
READER = Path(__file__).resolve().parents[2] / "scripts" / "atlas_reader.py"
ASIDE = HeadBox((-0.06, 0.0, 0.0), (0.06, 0.0, 0.0))
TO_THE_RIGHT = HeadBox((0.0, 0.0, 0.0), (0.2, 0.0, 0.0))
TWO_WAYS = HeadBox((-0.03, -0.02, 0.0), (0.03, 0.02, 0.0))


def maker(of, **settings):
    return partial(map_at, Session(), of, of.viewer, Settings(**settings))


def make(folder, of, box_of_heads=TWO_WAYS, tolerance=0.05, **options):
    making_ = making.Making(Session(), of, of.viewer, Settings(), folder, **options)
    atlas = drain(
        atlas_plan.planned(making_, box_of_heads, tolerance, 100, False, "turn on Overwrite")
    )
    return making_, atlas


@pytest.mark.parametrize("offset", [(0.2, 0.0, 0.0), (-0.1, 0.3, 0.4), (0.0, 0.0, -0.5)])
def test_moved_viewer_sees_the_picture_at_the_same_place_and_size(offset):
    """The picture's middle stays at its pixel, a small circle around it keeps its size, the frame
    is a turned one: nothing is mirrored, or rolled where the head moves level.
    """
    slab = rig(box([0.06, 0.02, 0.06]), **SMALL)
    viewer, place = slab.viewer, slab.picture_place
    moved = viewer_at(viewer, place, offset)
    middle = place.mesh.bounds.mean(axis=0)
    assert np.abs(moved.project([middle]) - viewer.project([middle])).max() < 1e-9
    assert np.abs(moved.position - viewer.position - np.array(offset) @ viewer.axes).max() < 1e-12
    assert np.linalg.det(moved.axes) == pytest.approx(np.linalg.det(viewer.axes), abs=1e-12)

    # a step across the sight line, as the moved viewer sees it
    for seen_by in (viewer, moved):
        seen_by_step = seen_by.project(middle + 1e-3 * seen_by.axes[:2]) - seen_by.project([middle])
        sizes = np.abs(seen_by_step).max(axis=1)
        assert sizes == pytest.approx([1e-3 / 0.05 * 48] * 2, rel=1e-6)
    if offset[1] == 0:
        assert abs(moved.axes[0] @ viewer.axes[1]) < 1e-12


def test_corners_of_a_cell_weigh_as_the_place_in_it():
    """The weighted mean of the corners is the place itself, on nodes they are one."""
    grid = HeadGrid(HeadBox((-1.0, 0.0, 2.0), (1.0, 0.0, 3.0)), (2, 0, 1))
    offsets = np.array(grid.offsets())
    assert len(grid) == len(offsets) == 15
    for place in ((0.3, 0.0, 2.9), (-1.0, 0.0, 2.0), (1.0, 0.0, 3.0), (0.5, 0.0, 2.25)):
        numbers, weights = grid.around(place)
        assert weights @ offsets[numbers] == pytest.approx(place, abs=1e-12)
        assert weights.sum() == pytest.approx(1, abs=1e-12)
    assert grid.around(grid.offsets()[7])[0] == [7]


def test_slab_blends_with_second_order():
    """Between neighbours the error is that of a parabola's chord, and the traced map in their
    middle is Snell's law in closed form.

    A slab shifts light by an odd function of the head's place x, about cubic, whose curvature grows
    as x: the worst cell of n, at the far end, errs by (1 - 1 / 2n) / n^2.
    """
    slab = rig(box([0.06, 0.02, 0.06]), **SMALL)
    line = _Line(maker(slab), TO_THE_RIGHT)
    size = slab.picture_place.width, slab.picture_place.height
    offs = [
        drain(_worst_between(line, HeadGrid(TO_THE_RIGHT, (n, 0, 0)), 0, size)).median
        for n in range(3)
    ]
    assert offs[0] > 1e-3
    assert offs[0] / offs[1] == pytest.approx((1 / 2) / (3 / 4 / 4), rel=0.05)
    assert offs[1] / offs[2] == pytest.approx((3 / 4 / 4) / (7 / 8 / 16), rel=0.05)

    found = run_steps(line.map(0, 0.1))
    moved = viewer_at(slab.viewer, slab.picture_place, (0.1, 0.0, 0.0))
    lit = found.coverage > 0.999
    place = slab.picture_place.mesh.bounds
    on_picture = np.column_stack(
        [
            place[0, 0] + found.st[lit][:, 0] * np.ptp(place[:, 0]),
            np.full(lit.sum(), place[:, 1].mean()),
            place[0, 2] + found.st[lit][:, 1] * np.ptp(place[:, 2]),
        ]
    )
    o, d = moved.rays(moved.project(on_picture))
    out = through_slab(o, d, np.array([0, -1.0, 0]), 0.01, 0.02, 1.49)
    column, row = np.nonzero(lit)[::-1]
    off = landing(replace(slab, viewers=(moved,)), *out) - np.column_stack([column, row]) - 0.5
    assert np.quantile(np.abs(off).max(axis=1), 0.98) < 1e-4  # of single precision


def test_grid_is_as_fine_as_it_has_to_be():
    """The worst place between neighbours keeps the tolerance, with one halving less it does not."""
    slab = rig(box([0.06, 0.02, 0.06]), **SMALL)
    at, place = maker(slab), slab.picture_place
    refined = drain(refine(at, TO_THE_RIGHT, place, 0.01, 100))
    assert refined.grid.halvings[0] >= 1
    assert refined.off["right"].most <= 0.01

    coarser = HeadGrid(TO_THE_RIGHT, (refined.grid.halvings[0] - 1, 0, 0))
    line = _Line(at, TO_THE_RIGHT)
    assert drain(_worst_between(line, coarser, 0, (place.width, place.height))).most > 0.01


def test_paths_are_not_blended():
    """Where two maps show a pixel by two paths, or one shows nothing, the nearest one counts."""
    st = np.zeros((1, 3, 2), np.float32)
    low = head_map.HeadMap(st + 0.25, np.array([[1, 1, 0.0]], np.float32), np.ones((1, 3), "u4"))
    path = np.array([[1, 2, 1]], np.uint32)
    high = head_map.HeadMap(st + 0.75, np.ones((1, 3), np.float32), path)
    found = head_map.between([low, high], np.array([0.6, 0.4]))
    assert found.map.st[0, :, 0] == pytest.approx([0.45, 0.25, 0.75])
    assert found.map.coverage[0] == pytest.approx([1, 1, 0.4])
    assert found.is_whole.tolist() == [[True, False, False]]


@pytest.fixture(scope="module")
def ball_atlas(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ball")
    made_of, atlas = make(folder, ball_rig(3, **SMALL))
    return made_of, drain(making.whole(made_of, atlas, 100, n=3))


def test_atlas_keeps_its_tolerance_by_the_reader_for_others(ball_atlas):
    """The stand-alone reader gives maps, at places of its own choice, as they are traced there."""
    made_of, atlas = ball_atlas
    spec = importlib.util.spec_from_file_location("atlas_reader", READER)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    reader = module.Atlas(made_of.folder)
    size = atlas.picture_size

    for offset in ((0.011, -0.013, 0.0), (-0.03, 0.02, 0.0), (-0.0071, 0.0, 0.0)):
        st, coverage = reader.at(*offset)
        true = drain(made_of.at(offset))
        both = (true.coverage > 0.999) & (coverage > 0.999)
        assert both.sum() > 400
        off = np.hypot(*((st - true.st)[both] * size).T)
        assert np.quantile(off, 0.95) < atlas.tolerance
        assert np.abs(coverage - true.coverage).mean() < 0.02


def test_reader_needs_numpy_alone(ball_atlas):
    made_of, _ = ball_atlas
    command = [sys.executable, "-I", READER, made_of.folder, "0.01", "0", "0"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.endswith("% of the display is lit\n")
    assert "kiriko" not in READER.read_text(encoding="utf-8").split('"""')[2]


def test_work_that_was_stopped_goes_on(ball_atlas):
    """Maps that are there stay, those that are missing are made again, to the same bytes."""
    made_of, atlas = ball_atlas
    lost, kept = (made_of.folder / name for name in atlas.maps[1:3])
    before, time = lost.read_bytes(), kept.stat().st_mtime_ns
    lost.unlink()
    assert making.missing(made_of.folder, atlas) == [1]
    with pytest.raises(ImageError, match=r"1 of .* maps are missing"):
        drain(making.checked(made_of, atlas))

    # by the same command: nothing is planned anew
    again = drain(atlas_plan.planned(made_of, TWO_WAYS, 0.05, 100, False, "turn on Overwrite"))
    assert again == atlas
    assert drain(making.made(made_of, again, range(len(again.grid)))) == 1
    assert lost.read_bytes() == before
    assert kept.stat().st_mtime_ns == time
    assert not [path for path in made_of.folder.iterdir() if path.name.startswith(".")]


def test_index_of_another_rig_is_not_replaced(ball_atlas):
    made_of, _ = ball_atlas
    other = replace(made_of, rig=ball_rig(2, **SMALL))
    with pytest.raises(ImageError, match="an atlas of another rig"):
        drain(atlas_plan.planned(other, TWO_WAYS, 0.05, 100, False, "turn on Overwrite"))
    with pytest.raises(RigError, match="planned for"):
        atlas_plan.planned_before(other)


def test_maps_of_another_box_are_not_removed_unasked(tmp_path):
    """Before a map is made, another box may be planned; after it, only where that is asked for."""
    made_of, atlas = make(
        tmp_path, rig(box([0.06, 0.02, 0.06]), pixels=16, display_pixels=16), ASIDE, 9
    )
    drain(atlas_plan.planned(made_of, TO_THE_RIGHT, 9.0, 100, False, ""))
    atlas = drain(atlas_plan.planned(made_of, ASIDE, 9.0, 100, False, ""))
    drain(making.made(made_of, atlas, [0]))
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(
        ImageError, match=r"other head positions\. Choose another folder, or turn on Overwrite"
    ):
        drain(
            atlas_plan.planned(made_of, TO_THE_RIGHT, 9.0, 100, False, Message("turn on Overwrite"))
        )
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    drain(atlas_plan.planned(made_of, TO_THE_RIGHT, 9.0, 100, True, ""))
    assert {path.name for path in tmp_path.iterdir()} == {"index.json"}


def test_source_images_come_and_stay_beside_the_same_maps(tmp_path):
    """Asked for later they are added, not asked for they stay; of another picture they are
    refused, which alone leaves the maps alone. The maps are those of before, to the bit.
    """
    of = rig(box([0.06, 0.02, 0.06]), pixels=16, display_pixels=16)
    made_of, atlas = make(tmp_path, of, ASIDE, 9)
    drain(making.whole(made_of, atlas, 10, n=1))
    maps = contents(tmp_path, "*.npz")

    def plan(source, box_of_heads=ASIDE, tolerance=9.0, overwrite=False, **options):
        of_it = making.Making(
            Session(), source, source.viewer, Settings(), tmp_path, save_image=save, **options
        )
        steps = atlas_plan.planned(
            of_it, box_of_heads, tolerance, 100, overwrite, "turn on Overwrite"
        )
        return of_it, drain(steps)

    def save(path, pixels):
        path.write_bytes(pixels.tobytes())

    with pytest.raises(RigError, match="planned without source images"):
        atlas_plan.planned_before(replace(made_of, has_images=True))
    drain(making.whole(*plan(of, has_images=True), 10, n=1))
    images = contents(tmp_path, "*.png")
    assert len(images) == len(maps) > 1
    assert contents(tmp_path, "*.npz") == maps

    next(tmp_path.glob("*.png")).unlink()
    drain(making.whole(*plan(of), 10, n=1))
    drain(making.whole(*plan(of, tolerance=8.0), 10, n=1))
    assert (contents(tmp_path, "*.npz"), contents(tmp_path, "*.png")) == (maps, images)

    picture = of.pictures[0]
    other = replace(of, pictures=(replace(picture, image=picture.image * np.float32(0.5)),))
    before = contents(tmp_path)
    for wanted in (True, False):
        with pytest.raises(ImageError, match="another picture or other light"):
            plan(other, tolerance=8.0, has_images=wanted)
    with pytest.raises(RigError, match="another rig, picture or light"):
        atlas_plan.planned_before(replace(made_of, rig=other))
    assert contents(tmp_path) == before
    made_of, atlas = plan(other, tolerance=8.0, overwrite=True, has_images=True)
    assert contents(tmp_path, "*.npz") == maps
    assert not contents(tmp_path, "*.png")
    drain(making.whole(made_of, atlas, 10, n=1))
    assert contents(tmp_path, "*.npz") == maps
    assert contents(tmp_path, "*.png").keys() == images.keys()
    plan(other, tolerance=8.0)
    plan(of, tolerance=8.0, overwrite=True)
    assert not contents(tmp_path, "*.png")
    assert contents(tmp_path, "*.npz") == maps


def contents(folder, pattern="*"):
    return {path.name: path.read_bytes() for path in folder.glob(pattern)}


def test_overwriting_removes_maps_that_are_no_part(tmp_path):
    """Of another rig all go; nothing else in the folder does."""
    made_of, atlas = make(
        tmp_path, rig(box([0.06, 0.02, 0.06]), pixels=16, display_pixels=16), ASIDE, 9
    )
    drain(making.whole(made_of, atlas, 10, n=1))
    (tmp_path / "map_mine.npz").write_text("")
    other = replace(made_of, rig=rig(box([0.06, 0.03, 0.06]), pixels=16, display_pixels=16))
    drain(atlas_plan.planned(other, ASIDE, 9.0, 100, True, ""))
    assert {path.name for path in tmp_path.iterdir()} == {"index.json", "map_mine.npz"}


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"form": 99}', "[" * 100_000])
def test_broken_index_is_one_sentence(tmp_path, text):
    (tmp_path / atlases.INDEX).write_text(text)
    with pytest.raises(ImageError, match="not the index of an atlas"):
        atlases.read(tmp_path)


@pytest.mark.parametrize("halvings", [[40, 40, 40], [10**9] * 3, [-1, 0, 0], 7, [float("inf")] * 3])
def test_an_index_whose_numbers_contradict_each_other_is_refused(ball_atlas, tmp_path, halvings):
    """Halvings that are not those of the axes would ask for more heads than fit into memory."""
    _, atlas = ball_atlas
    atlases.write(tmp_path, atlas)
    told = json.loads((tmp_path / atlases.INDEX).read_text())
    assert atlases.read(tmp_path).grid == atlas.grid
    (tmp_path / atlases.INDEX).write_text(json.dumps({**told, "halvings": halvings}))
    with pytest.raises(ImageError, match="not the index of an atlas"):
        atlases.read(tmp_path)


def test_broken_map_is_one_sentence(tmp_path):
    path = tmp_path / "map.npz"
    for data in (b"", b"PK", b"no map"):
        path.write_bytes(data)
        with pytest.raises(ImageError, match="not a map of an atlas"):
            head_map.read(path)


def test_index_tells_all(ball_atlas):
    made_of, atlas = ball_atlas
    assert atlases.read(made_of.folder) == atlas
    told = json.loads((made_of.folder / atlases.INDEX).read_text(encoding="utf-8"))
    assert told["axes"]["up"] == atlas.grid.nodes[1].tolist()
    assert told["checked"]["most_px"] <= atlas.tolerance


def test_heads_that_cannot_be_are_one_sentence():
    slab = rig(box([0.06, 0.02, 0.06]), **SMALL)
    none = 0.0, 0.0, 0.0
    with pytest.raises(RigError, match="does not move"):
        HeadBox(none, none).check()
    for low, high in ((1.0, 0.0), (0.0, np.inf), (np.nan, 1.0)):
        with pytest.raises(RigError, match="mm is not valid"):
            HeadBox((0.0, low, 0.0), (0.0, high, 0.0)).check()
    with pytest.raises(RigError, match="or behind it"):
        viewer_at(slab.viewer, slab.picture_place, (0.0, 0.0, 1.5))
    with pytest.raises(RigError, match="is orthographic"):
        check_viewer(slab, replace(slab.viewer, projection="orthographic"))
    own = replace(slab.picture_place, mesh=None)
    with pytest.raises(RigError, match="use a picture plane"):
        check_viewer(replace(slab, pictures=(own,)), slab.viewer)
    turned = replace(slab.displays[0], views=Views(5, cone=(1.0, 0.0)))
    with pytest.raises(RigError, match="turn its Views off"):
        check_viewer(replace(slab, displays=(turned,)), slab.viewer)
    with pytest.raises(RigError, match="2 head positions"):
        drain(refine(maker(slab), ASIDE, slab.picture_place, 1e-6, 2))
