"""Fit plate: make a plate as large as the picture's light needs."""

import bpy

from ..core.bench.part_sizes import fit_plate
from . import fitting


class KIRIKO_OT_fit_plate(fitting.FitsPart, bpy.types.Operator):
    """Make the plate as large as the light of the picture needs that it sends to the display"""

    bl_idname = "kiriko.fit_plate"
    bl_label = "Fit Plate"
    bl_options = {"REGISTER", "UNDO"}

    role = "PLATE"
    share: fitting.share(1.0)
    fit = staticmethod(fit_plate)
