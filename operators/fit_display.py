"""Fit display: make the display as large as the picture's light needs."""

import bpy

from ..core.bench.part_sizes import fit_display
from . import fitting


class KIRIKO_OT_fit_display(fitting.FitsPart, bpy.types.Operator):
    """Make the display as large as the light of the picture needs that comes to its plane"""

    bl_idname = "kiriko.fit_display"
    bl_label = "Fit Display"
    bl_options = {"REGISTER", "UNDO"}

    role = "DISPLAY"
    share: fitting.share(1.0)

    @staticmethod
    def fit(rig, plan_of, wanted, number):
        return fit_display(rig, plan_of, wanted)
