"""What is measured of a viewer's light, and goes into no picture: it may come after that."""

from collections.abc import Callable, Generator
from dataclasses import dataclass

from ..image.glare import LightBeside, look_beside
from ..image.simulation import PlateView, plate_view
from ..light.landings import Reason
from ..light.plan import Plan
from ..map.view_map import ViewMap
from ..steps import at
from .accuracy import Accuracy, measure


@dataclass(frozen=True, eq=False)
class Measured:
    """Numbers about the light of one viewer.

    plate : brightness and blur by a plate's mirrors, None where it is ideal
    beside : a sample of light beside the glass; None where that carries the picture, too
    """

    accuracy: Accuracy
    plate: PlateView | None
    beside: LightBeside | None


def measuring(
    plan: Plan, view_map: ViewMap, lap: Callable[[str], None]
) -> Generator[float, None, Measured]:
    """Measure a view map of a plan; yields progress 0..1.

    lap : called with the name of the work just done
    """
    is_cut_off = bool((view_map.points.reason == Reason.CUT_OFF).any())
    accuracy = yield from measure(plan, is_cut_off)
    lap("tessellation error")

    plate = yield from at(1.0, plate_view(plan))
    if plate is not None:
        lap("brightness and blur")

    beside = (yield from at(1.0, look_beside(plan))) if plan.settings.only_through_glass else None
    lap("glare")
    return Measured(accuracy, plate, beside)
