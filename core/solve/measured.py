"""What is measured of a viewer's light, and goes into no picture: it may come after that."""

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace

from ..base.fingerprint import fingerprint
from ..base.steps import at
from ..image.glare import LightBeside, look_beside
from ..image.simulation import PlateView, plate_view
from ..light.plan import Plan
from ..light.rays import Reason
from ..map.view_map import ViewMap
from .accuracy import Accuracy, measure


@dataclass(frozen=True, eq=False)
class Measured:
    """Numbers about the light of one viewer.

    picture : key of the place of the picture, whose light the accuracy is in part about
    plate : brightness and blur by a plate's mirrors, None where it is ideal
    beside : a sample of light beside the glass; None where that carries the picture, too
    """

    picture: str
    accuracy: Accuracy
    plate: PlateView | None
    beside: LightBeside | None


def measuring(
    plan: Plan, view_map: ViewMap, lap: Callable[[str], None], elsewhere: Measured | None
) -> Generator[float, None, Measured]:
    """Measure a view map of a plan; yields progress 0..1.

    elsewhere : the same with the picture elsewhere, if that was measured
    lap : called with the name of the work just done
    """
    is_cut_off = bool((view_map.points.reason == Reason.CUT_OFF).any())
    picture = fingerprint(plan.rig.picture_place)
    accuracy = yield from measure(plan, is_cut_off, elsewhere and elsewhere.accuracy)
    lap("tessellation error")
    if elsewhere is not None:
        return replace(elsewhere, picture=picture, accuracy=accuracy)

    plate = yield from at(1.0, plate_view(plan))
    if plate is not None:
        lap("brightness and blur")

    beside = (yield from at(1.0, look_beside(plan))) if plan.settings.only_through_glass else None
    lap("glare")
    return Measured(picture, accuracy, plate, beside)
