"""GPU batches of the last drawings, cached from frame to frame."""

from collections.abc import Callable
from typing import Any

from ...operators.sketcher import SketchDrawing

N_CACHED = 4  # drawings, one for each scene in a window

_made: list[tuple[SketchDrawing, dict[str, Any]]] = []


def made_once(drawing: SketchDrawing, name: str, make: Callable[[SketchDrawing], Any]) -> Any:
    """Return `make(drawing)`, cached by drawing and name."""
    things = next((things for known, things in _made if known is drawing), None)
    if things is None:
        things = {}
        _made[:] = [*_made[1 - N_CACHED :], (drawing, things)]
    if name not in things:
        things[name] = make(drawing)
    return things[name]


def forget() -> None:
    """Free all batches."""
    _made.clear()
