"""Rigs as Add Rig proposes them around a glass, and the plans of their light."""

from kiriko.core.bench.placement import Wishes, propose, rig_of, viewer_of
from kiriko.core.rig.rig import Rig
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session

PIXELS = 64, 64


def rig_around(glass, **wishes):
    proposal = propose(glass.mesh.bounds, Wishes(**wishes))
    bench = Rig(viewers=(), glasses=(glass,), plates=(), displays=())
    return rig_of(proposal, bench, viewer_of(proposal, PIXELS), PIXELS)


def plan_of():
    session = Session()
    return lambda rig: session.plan(rig, Settings())
