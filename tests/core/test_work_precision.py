"""The report measures known errors: ones put in by hand, Monte Carlo's slope, closed forms.

Its files agree.
"""

import csv
import io
import json
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.errors import RigError
from kiriko.core.lab.drawing.svg import BOTTOM, HEIGHT, LEFT
from kiriko.core.lab.measure import reference, work_precision
from kiriko.core.lab.measure.cost_report import as_csv, as_json, as_svg, plate_csv, plate_svg, table
from kiriko.core.lab.measure.reference import quantisation
from kiriko.core.lab.measure.work_precision import Ladders, WorkPrecision, measure
from kiriko.core.rig.rig import MirrorArray
from kiriko.core.rig.settings import LEAST_TOLERANCE, Settings
from kiriko.core.solve.session import Session
from kiriko.core.solve.solution import cost
from known.reference_rigs import cube_rig
from known.work import drain

SIZE = 0.05  # m, side of the display of the reference rigs
TOLERANCES = (1.0, 0.3, 0.1, 0.03)
SPPS = (1, 4, 16, 64, 100_000)
SVG = "{http://www.w3.org/2000/svg}"


def small_rig():
    return cube_rig(pixels=64, display_pixels=48)


class Shifted(Session):
    """A session whose results are off by the tolerance: it
    solves with the display moved by that many pixels.
    """

    def solve(self, rig, settings=None):
        mesh = rig.display.mesh
        step = settings.tolerance * SIZE / rig.display.width
        moved = replace(
            rig.display, mesh=replace(mesh, vertices=mesh.vertices + step * np.eye(3)[0])
        )
        return (yield from super().solve(replace(rig, displays=(moved,)), settings))


@pytest.fixture(scope="module")
def found() -> WorkPrecision:
    """A report on a solver whose error is known, and on the true splat."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (work_precision, reference):
            patch.setattr(module, "Session", Shifted)
        return drain(
            measure(
                small_rig(),
                Settings(tolerance=0.1),
                ladders=Ladders(TOLERANCES, SPPS, runs=2, budget=60.0),
            )
        )


def ladder(found):
    return [rung for rung in found.rungs if rung.method == "adaptive"]


def splats(found):
    return [rung for rung in found.rungs if rung.method == "splat" and rung.seconds]


def test_the_maps_error_is_the_one_that_was_put_in(found):
    """A map that is off by the tolerance everywhere has that
    rms and that percentile, and all of the image.
    """
    assert [rung.setting for rung in ladder(found)] == list(TOLERANCES)
    for rung in [*ladder(found), found.reference]:
        assert rung.maps[0].rms == pytest.approx(rung.setting, rel=0.02, abs=2e-3)
        assert rung.maps[0].percentile == pytest.approx(rung.setting, rel=0.02, abs=4e-3)
        # a shift takes a strip at one border and gives one at the other
        assert rung.maps[0].overlap > 1 - 2.5 * rung.setting / 48


def test_image_errors_fall_along_the_ladder(found):
    """A smaller shift is a smaller error of the source image and of the seen one.

    The dots move by the shift.
    """
    rmse = [rung.image.source_rmse for rung in ladder(found)]
    assert (np.diff(rmse) < 0).all()
    assert rmse[0] > 5 * rmse[2]
    assert (np.diff([rung.image.channels[0].seen_psnr for rung in ladder(found)]) > 0).all()
    assert all(rung.image.holes == 0 for rung in ladder(found))
    assert all(rung.image.channels[0].lattice_seen == 49 for rung in ladder(found))
    # one display pixel is 64 / 48 viewer pixels; the dots are about 3 pixels wide
    assert ladder(found)[0].image.channels[0].lattice_shift == pytest.approx(64 / 48, rel=0.1)
    assert found.reference.image.channels[0].lattice_shift < 0.1


def test_the_splat_converges_as_monte_carlo_does_and_fills_its_holes(found):
    """RMSE falls as samples^-1/2 once there are no holes,
    time grows with the samples, holes get fewer.
    """
    spp = np.array([rung.setting for rung in splats(found)])
    assert list(spp) == [1, 4, 16, 64]
    rmse = np.array([rung.image.source_rmse for rung in splats(found)])
    assert -0.65 < np.polyfit(np.log(spp[1:]), np.log(rmse[1:]), 1)[0] < -0.4, rmse
    holes = [rung.image.holes for rung in splats(found)]
    assert holes == sorted(holes, reverse=True)
    assert holes[-1] == 0
    assert splats(found)[-1].seconds > 4 * splats(found)[0].seconds


def test_what_exceeds_the_budget_is_listed_with_its_time(found):
    """A rung that was not run has no numbers but the time it
    would take: that of the one before, by its samples.
    """
    rung = found.rungs[-1]
    assert (rung.method, rung.setting, rung.seconds, rung.image) == ("splat", 100_000, None, None)
    assert rung.predicted_seconds == pytest.approx(splats(found)[-1].seconds * 100_000 / 64)
    assert f"not run: would take about {rung.predicted_seconds:.0f} s" in table(found)


def test_the_splats_time_to_an_error_lies_on_its_curve(found):
    """At a rung's error it is the rung's time, between two it lies between.

    A tenth of the last takes 100 times it.
    """
    first, *_, last = splats(found)
    assert found.splat_seconds(last.image.source_rmse) == pytest.approx(last.seconds)
    assert found.splat_seconds(last.image.source_rmse / 10) == pytest.approx(100 * last.seconds)
    between = found.splat_seconds((first.image.source_rmse * last.image.source_rmse) ** 0.5)
    assert first.seconds < between < last.seconds
    assert found.splat_seconds(0.0) is None
    with_holes = replace(found, rungs=tuple(splats(found)[:1]))
    assert first.image.holes > 0
    assert (
        with_holes.splat_seconds(first.image.source_rmse / 2) is None
    )  # it falls faster: no law to go by
    assert replace(found, rungs=tuple(ladder(found))).splat_seconds(0.01) is None


@pytest.mark.parametrize("tolerance", [1.0, 0.1, 0.01])
def test_the_view_map_keeps_its_promise(tolerance):
    """The true session: 99.9 % of the map's errors are within the tolerance."""
    ladders = Ladders((), (), runs=1)
    result = drain(measure(small_rig(), Settings(tolerance=tolerance), ladders=ladders))
    assert result.own.maps[0].percentile <= tolerance
    assert result.own.maps[0].overlap > 0.999


def test_a_rig_that_cannot_be_solved_is_one_sentence():
    """No report on a rig without a display, or with a tolerance that cannot be kept."""
    with pytest.raises(RigError, match="no display"):
        drain(measure(replace(small_rig(), displays=())))
    with pytest.raises(RigError, match="Tolerance"):
        drain(measure(small_rig(), Settings(tolerance=0.0)))
    with pytest.raises(RigError, match="Raise its resolution"):
        drain(measure(cube_rig(pixels=32, display_pixels=2)))


def test_quantisation_is_a_step_over_the_root_of_twelve():
    """Values spread evenly over the encoded range are off by an even spread of +- half a step."""
    even = np.random.default_rng(3).random(200_000)
    linear = np.where(even <= 0.04045, even / 12.92, ((even + 0.055) / 1.055) ** 2.4)
    rms = quantisation(linear)
    for name, top in (("8 bit", 255), ("10 bit", 1023), ("16 bit", 65535)):
        assert rms[name] == pytest.approx(1 / top / 12**0.5, rel=0.01)
    assert rms["half float"] < rms["10 bit"]


def test_costs_follow_the_ladder_or_else_the_order_of_interpolation():
    """Half the tolerance: by the ladder's own ratio; without one, 2^(1/2) times as many cells."""
    seconds = {"plan": 1.0, "tracing": 2.0, "shares": 1.0, "painting": 0.5}
    assert cost(seconds, 0.1, 0.05) == pytest.approx(1.5 + 3.0 * 2**0.5)
    assert cost(seconds, 0.1, 0.2) == pytest.approx(1.5 + 3.0 / 2**0.5)
    measured = [(1.0, 1.0), (0.01, 100.0)]  # seconds go as 1 / tolerance
    assert cost(seconds, 0.1, 0.05, measured) == pytest.approx(1.0 + 2 * 3.5)
    assert cost({"painting": 1.0}, 0.1, 0.05) is None
    assert cost(seconds, LEAST_TOLERANCE, LEAST_TOLERANCE / 2) is None


def test_csv_and_json_agree_and_know_all_rungs(found):
    """The same numbers in both, to the last digit.

    An unknown value is empty in one and null in the other.
    """
    whole = json.loads(as_json(found, {"blender": "none"}))
    lines = list(csv.DictReader(io.StringIO(as_csv(found))))
    rows = [whole["reference"], *whole["rungs"]]
    assert len(lines) == len(rows) == 1 + len(found.rungs)
    for line, row in zip(lines[1:], rows[1:], strict=True):
        for name, text in line.items():
            value = row.get(name)
            assert text == ("" if value is None else str(value)), name
    assert rows[1]["map_rms_display_px"] == ladder(found)[0].maps[0].rms
    assert rows[-1]["seconds"] is None
    assert whole["quantisation_rms_encoded"]["8 bit"] > 0


def ticks(root, axis):
    """Positions of an axis's grid lines and the values written beside them."""
    other = {"x": "y", "y": "x"}[axis]
    lines = [
        line for line in root.iter(f"{SVG}line") if line.get(f"{axis}1") == line.get(f"{axis}2")
    ]
    texts = [text for text in root.iter(f"{SVG}text") if text.get("class") == f"{axis} tick"]
    assert len({text.get(other) for text in texts}) == 1
    pairs = zip(lines, texts, strict=True)
    return np.array([[float(line.get(f"{axis}1")), float(text.text)] for line, text in pairs])


def drawn(root, group):
    """Positions of a curve's points."""
    line = group.find(f"{SVG}polyline").get("points")
    return np.array([[float(c) for c in point.split(",")] for point in line.split()])


def test_the_diagram_parses_and_its_points_lie_where_the_numbers_say(found):
    """Read back by its own ticks, each point is at its seconds
    and its error, to the digits that are written.
    """
    root = ET.fromstring(as_svg(found))
    curves = [group for group in root.iter(f"{SVG}g") if group.get("class") == "curve"]
    assert len(curves) == 2
    for group, rungs in zip(curves, (ladder(found), splats(found)), strict=True):
        points = drawn(root, group)
        wanted = np.array([[rung.seconds, rung.image.source_rmse] for rung in rungs])
        for k, axis in enumerate("xy"):
            at, value = ticks(root, axis).T
            np.testing.assert_allclose(
                np.diff(np.log10(value)), 1, atol=1e-9
            )  # powers of ten, one after another
            slope, start = np.polyfit(at, np.log10(value), 1)
            np.testing.assert_allclose(
                slope * points[:, k] + start, np.log10(wanted[:, k]), atol=1e-3
            )
            assert (value.min() <= wanted[:, k]).all()
            assert (wanted[:, k] <= value.max()).all()


def test_the_diagram_of_a_plate_has_the_table_in_four_curves():
    """One affine map takes all points of the CSV to those of the SVG.

    Stray light is that of both layers together.
    """
    array = MirrorArray(crossing_error=0.1)
    rows = list(csv.DictReader(io.StringIO(plate_csv(array))))
    light = {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
    assert np.abs(light["stray_1"] - light["stray_2"]).max() > 0.05

    expected = {
        "mid-air image": light["imaged"],
        "stray light, one layer alone": light["stray_1"] + light["stray_2"],
        "straight through": light["through"],
        "reflected by the glass": light["reflected"],
    }
    svg = ET.fromstring(plate_svg(array, "A & B"))
    name = "{http://www.w3.org/2000/svg}"
    curves = {
        group.find(f"{name}title").text: np.array(
            [
                [float(x) for x in point.split(",")]
                for point in group.find(f"{name}polyline").get("points").split()
            ]
        )
        for group in svg.iter(f"{name}g")
        if group.get("class") == "curve"
    }

    assert list(curves) == list(expected)
    assert any("'A & B'" in (text.text or "") for text in svg.iter(f"{name}text"))
    at = np.concatenate(list(curves.values()))
    told = np.stack(
        [np.tile(light["incidence_degrees"], 4), np.concatenate(list(expected.values()))], axis=1
    )

    for axis in (0, 1):
        slope, start = np.polyfit(told[:, axis], at[:, axis], 1)
        assert (slope > 0) == (axis == 0)  # y runs down
        assert (
            np.abs(slope * told[:, axis] + start - at[:, axis]).max() < 0.011
        )  # two digits after the point
        assert start == pytest.approx((LEFT, HEIGHT - BOTTOM)[axis], abs=0.01)
