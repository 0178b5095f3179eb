"""A box of heads, solved for all of its viewers and for its middle: held to closed form."""

import json
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.errors import RigError
from kiriko.core.lab.atlas.heads import evenly, viewer_at
from kiriko.core.lab.measure import head_box as room
from kiriko.core.lab.measure.head_box import as_data, as_svg, check_box, head_box
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.rig.settings import Settings
from known.reference_rigs import ball_rig, box, rig
from known.work import drain

THICKNESS, INDEX, DISTANCE, SIDE = 0.02, 1.49, 0.6, 0.03
SMALL = {"pixels": 64, "display_pixels": 64}
N = room.N_POINTS


def slab_rig(ior=INDEX):
    """A slab so large that nothing is seen beside it; the display is larger than what is shown."""
    slab = box([2.0, THICKNESS, 2.0])
    return rig(slab, viewer_distance=DISTANCE, field=0.06, plate=3.0, display=0.2, ior=ior, **SMALL)


def with_heads(a_rig, counts, sizes, weights=None):
    """Viewers evenly over a box about the rig's own, all of which look at the picture."""
    own = a_rig.viewer
    viewers = [
        replace(viewer_at(own, a_rig.picture_place, offset), name=str(k))
        for k, offset in enumerate(evenly(counts, sizes))
    ]
    weights = weights or [1.0] * len(viewers)
    viewers = (replace(v, weight=w) for v, w in zip(viewers, weights, strict=True))
    return replace(a_rig, viewers=tuple(viewers))


def points_of():
    along = SIDE * ((np.arange(N) + 0.5) / N - 0.5)
    x, z = (grid.ravel() for grid in np.meshgrid(along, -along))
    return np.stack([x, 0 * x, z], axis=1)


def straight_of(eye, shown):
    """The places (n, 3) of the plane in whose direction an eye sees those points of the plane that
    the display's light would meet with no slab: each ray along its face by t (tan a - tan a').
    """
    straight = shown
    for _ in range(12):
        along = (straight - eye) * [1, 0, 1]
        r = np.linalg.norm(along, axis=1, keepdims=True)
        tangent = r / -eye[1]
        sine = tangent / np.sqrt(1 + tangent**2) / INDEX
        shift = THICKNESS * (tangent - sine / np.sqrt(1 - sine**2))
        straight = shown + shift * along / np.where(r > 0, r, 1)
    return straight


def off_by_closed_form(eyes, weights, head):
    """Arcmin (n,) by which a head is off before a display on which each point of the picture stands
    where the eyes' places, by their weights, have it for their mean.
    """
    points = shown = points_of()
    for _ in range(12):
        mean = np.average([straight_of(eye, shown) for eye in eyes], axis=0, weights=weights)
        shown = shown + points - mean
    one, other = points - head, straight_of(head, shown) - head
    across = np.linalg.norm(np.cross(one, other), axis=1)
    return np.degrees(np.arctan2(across, (one * other).sum(axis=1))) * 60


@pytest.mark.parametrize(("counts", "weights"), [
    ((2, 1, 1), None),
    ((3, 1, 1), [1.0, 4.0, 2.0]),
    ((2, 2, 1), None),
    ((2, 1, 2), None),
])  # fmt: skip
def test_behind_a_slab_it_is_that_of_closed_form(counts, weights):
    """Numbers over the box, in its middle and along each axis, for all and for the middle."""
    sizes = (0.2, 0.12, 0.1)
    a_rig = with_heads(slab_rig(), counts, sizes, weights)
    found = drain(head_box(compile_plan(a_rig, Settings())))
    size = [s if n > 1 else 0.0 for n, s in zip(counts, sizes, strict=True)]
    assert found.size_m == pytest.approx(size, abs=1e-12)
    assert found.n_viewers == len(a_rig.viewers)

    own = slab_rig().viewer
    eyes = [viewer.position for viewer in a_rig.viewers]
    strengths = [viewer.weight for viewer in a_rig.viewers]
    axes = [k for k in range(3) if counts[k] > 1]
    n_over = room.N_OVER[len(axes)]
    grid = evenly([n_over if n > 1 else 1 for n in counts], size)
    assert found.n_heads == len(grid)
    for served, of, by in (
        (found.for_all, eyes, strengths),
        (found.for_middle, [own.position], [1.0]),
    ):
        places = [own.position + np.array(offset) @ own.axes for offset in grid]
        off = np.concatenate([off_by_closed_form(of, by, place) for place in places])
        assert served.mean_arcmin == pytest.approx(off.mean(), abs=1e-5)
        assert served.largest_arcmin == pytest.approx(off.max(), abs=1e-5)
        assert served.coverage == 1.0
        middle = off_by_closed_form(of, by, own.position)
        assert served.middle_mean_arcmin == pytest.approx(middle.mean(), abs=1e-5)
        assert served.middle_largest_arcmin == pytest.approx(middle.max(), abs=1e-5)
        assert [curve.axis for curve in served.curves] == [room.AXES[k] for k in axes]
        for axis, curve in zip(axes, served.curves, strict=True):
            assert curve.distance_m == pytest.approx(np.linspace(0, size[axis], room.N_ALONG))
            for k, distance in enumerate(curve.distance_m):
                place = own.position + (distance - size[axis] / 2) * own.axes[axis]
                off = off_by_closed_form(of, by, place)
                assert curve.mean_arcmin[k] == pytest.approx(off.mean(), abs=1e-5)
                assert curve.largest_arcmin[k] == pytest.approx(off.max(), abs=1e-5)

    # which says by how much the middle is worse, solved for all
    assert found.for_middle.middle_largest_arcmin < 1e-6
    assert found.worse_at_middle_arcmin == pytest.approx(found.for_all.middle_mean_arcmin, abs=1e-6)
    assert found.worse_at_middle_arcmin > 1e-3 or weights


def test_with_index_one_nobody_is_off():
    a_rig = with_heads(slab_rig(ior=1.0), (2, 2, 2), (0.1, 0.1, 0.1))
    found = drain(head_box(compile_plan(a_rig, Settings())))
    assert found.n_heads == 27
    assert found.for_all.largest_arcmin < 1e-6
    assert found.for_middle.largest_arcmin < 1e-6


def test_its_data_and_drawing_tell_the_same():
    """Numbers are JSON's; each axis has a diagram, with a curve for each way, mean and largest."""
    a_rig = with_heads(ball_rig(3, **SMALL), (3, 1, 2), (0.06, 0.0, 0.05))
    found = drain(head_box(compile_plan(a_rig, Settings())))
    data = json.loads(json.dumps(as_data(found)))
    assert data["for_all"]["mean_arcmin"] == found.for_all.mean_arcmin
    assert data["worse_at_middle_arcmin"] == found.worse_at_middle_arcmin
    assert [curve["axis"] for curve in data["for_middle"]["curves"]] == ["right", "forward"]

    drawing = ET.fromstring(as_svg(found))
    space = "{http://www.w3.org/2000/svg}"
    diagrams = drawing.findall(f"{space}svg")
    assert len(diagrams) == 2
    for diagram in diagrams:
        names = [
            one.find(f"{space}title").text for one in diagram.iter() if one.get("class") == "curve"
        ]
        assert names == [
            f"{way}, {kind}"
            for way in ("for all", "for the middle")
            for kind in ("largest", "mean")
        ]
    words = " ".join(drawing.itertext())
    assert "from the left of the box" in words
    assert "from the far end of the box" in words


def test_a_box_that_cannot_be_is_refused_in_one_sentence():
    one_place = with_heads(slab_rig(), (1, 1, 1), (0.0, 0.0, 0.0))
    with pytest.raises(RigError, match="at the same position"):
        check_box(one_place)
    flat = slab_rig()
    flat = with_heads(flat, (2, 1, 1), (0.1, 0.0, 0.0))
    first = replace(flat.viewers[0], projection="orthographic")
    with pytest.raises(RigError, match="is orthographic"):
        check_box(replace(flat, viewers=(first, flat.viewers[1])))


def test_places_that_nobody_sees_are_told_as_none(monkeypatch):
    """A display of a tenth of a millimetre shows none of four points beside the middle."""
    monkeypatch.setattr(room, "N_POINTS", 2)
    a_rig = with_heads(ball_rig(3, display=1e-4, **SMALL), (2, 1, 1), (0.3, 0.0, 0.0))
    found = drain(head_box(compile_plan(a_rig, Settings())))
    assert found.for_all.mean_arcmin is None
    assert found.for_all.coverage == 0.0
    assert found.worse_at_middle_arcmin is None
    ET.fromstring(as_svg(found))
