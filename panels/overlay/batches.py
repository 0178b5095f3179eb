"""What was made for the GPU of the last drawings, to be used in each frame again."""

from collections.abc import Callable
from typing import Any

from ...operators.sketcher import SketchDrawing

KEPT = 4  # drawings, of as many scenes in as many windows

_made: list[tuple[SketchDrawing, dict[str, Any]]] = []


def made_once(drawing: SketchDrawing, name: str, make: Callable[[SketchDrawing], Any]) -> Any:
    """What `make` makes of a drawing, made when it is first asked for."""
    things = next((things for known, things in _made if known is drawing), None)
    if things is None:
        things = {}
        _made[:] = [*_made[1 - KEPT :], (drawing, things)]
    if name not in things:
        things[name] = make(drawing)
    return things[name]


def forget() -> None:
    """Free all of it."""
    _made.clear()
