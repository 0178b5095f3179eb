"""Where the mid-air image of an ideal plate stands, measured
in Cycles as a lab would: `dev.py lab` in small.
"""

import bpy
import numpy as np
import pytest


@pytest.mark.parametrize("distance", [0.4, 0.6])
def test_the_image_stands_as_far_from_the_plate_as_the_display(kiriko, scene, distance):
    """A chart of dots seen by two viewers 50 mm apart, 1 m away:
    on average right to 0.05 mm, and sideways to 1 um.
    """
    from bench import lab
    from kiriko.core.bench.placement import lattice

    lab.build(distance, pixels=400)
    a_rig, off = lab.off_in_cycles(bpy.context.scene, lattice(lab.CHART_PIXELS), samples=8)
    plate, display = (part.mesh.vertices.mean(axis=0) for part in (a_rig.plates[0], a_rig.display))
    assert np.linalg.norm(plate - display) == pytest.approx(distance, abs=1e-6)
    assert np.abs(off[:, 2]).mean() < 0.05e-3
    assert np.abs(off.mean(axis=0))[:2].max() < 1e-6
