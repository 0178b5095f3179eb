"""The share of a picture that arrives, by rays through a grid of its places and nothing else."""

import numpy as np

from kiriko.core.light.trace import trace_all
from kiriko.core.rig.rig import Rig
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session


def share_arrived(rig: Rig, n: int = 60) -> float:
    """Share of a rectangular picture of four vertices, its corners and edges with it."""
    low, right, _, up = rig.picture_place.mesh.vertices
    u, v = np.stack(np.meshgrid(*[np.linspace(0, 1, n)] * 2)).reshape(2, -1, 1)
    points = low + u * (right - low) + v * (up - low)
    directions = points - rig.viewer.position
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    plan = Session().plan(rig, Settings())
    origins = np.broadcast_to(rig.viewer.position, points.shape)
    return float(trace_all(plan, origins, directions).has_arrived.mean())
