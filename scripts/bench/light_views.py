"""Displays that keep the direction of light: a table of `dev.py light`."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from .runner import Row

CASES: dict[str, Callable[[], Iterator[Row]]] = {}
