"""The 49 points of each condition as a drawing: figure 8 of the paper."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .figures_7_and_8 import Condition
from .published import HALF, PLAIN, SOURCE

COLOURS = {"ideal": "#888888", PLAIN: "#c8501e", HALF: "#3f7d20", SOURCE: "#0b6e99"}


def figure_8(conditions: Sequence[Condition]) -> str:
    """Where the 49 points stand in each condition, as SVG: px from the middle of the ideal grid."""
    ideal = conditions[0].ideal
    sets = {
        "ideal": ideal,
        **{condition.name: condition.ideal + condition.in_core.shift for condition in conditions},
    }
    middle = ideal.mean(axis=(0, 1))
    every = np.concatenate([points.reshape(-1, 2) for points in sets.values()]) - middle
    size, margin = 720, 60
    reach = 100 * np.ceil(np.nanmax(np.abs(every)) / 100)
    scale = (size - 2 * margin) / (2 * reach)

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{size}" height="{size + 40}" viewBox="0 0'
        f' {size} {size + 40}"'
        ' font-family="Helvetica, Arial, sans-serif" font-size="13">',
        f'<rect width="{size}" height="{size + 40}" fill="white"/>',
    ]
    for tick in np.arange(-reach, reach + 1, 200):
        at = size / 2 + scale * tick
        parts += [
            f'<path d="M{at:.1f} {margin}V{size - margin}M{margin} {at:.1f}H{size - margin}"'
            f' stroke="#e5e5e5"/>',
            f'<text x="{at:.1f}" y="{size - margin + 18}" text-anchor="middle">{tick:.0f}</text>',
            f'<text x="{margin - 8}" y="{at + 4:.1f}" text-anchor="end">{tick:.0f}</text>',
        ]

    parts.append(
        f'<text x="{size / 2}" y="{size - 16}" text-anchor="middle">x, camera px (y'
        f" downward)</text>"
    )

    # a shift is nearly as long as from dot to dot: lines tell which point is which
    for way in np.moveaxis(
        size / 2 + scale * (np.stack(list(sets.values())) - middle), 0, 2
    ).reshape(-1, len(sets), 2):
        line = " ".join(f"{x:.2f},{y:.2f}" for x, y in way[np.isfinite(way[:, 0])])
        parts.append(f'<polyline points="{line}" fill="none" stroke="#bbbbbb"/>')

    for n, (name, points) in enumerate(sets.items()):
        colour = COLOURS[name]
        radius = 6 if name == "ideal" else 3.5
        look = (
            f'fill="none" stroke="{colour}" stroke-width="1.5"'
            if name == "ideal"
            else f'fill="{colour}"'
        )
        for x, y in size / 2 + scale * (points.reshape(-1, 2) - middle):
            if np.isfinite(x):
                parts.append(f'<circle cx="{x:.2f}" cy="{y:.2f}" r="{radius}" {look}/>')
        parts += [
            f'<circle cx="{margin + 160 * n}" cy="{size + 16}" r="{radius}" {look}/>',
            f'<text x="{margin + 160 * n + 12}" y="{size + 20}">{name}</text>',
        ]

    return "\n".join([*parts, "</svg>", ""])
