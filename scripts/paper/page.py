"""The results as tables and as one page."""

from __future__ import annotations

import html

from environments import machine

from .figure_5 import ABOUT_TIMES
from .figures_7_and_8 import ABOUT_LATTICE
from .published import HALF, PLAIN, SOURCE
from .tables import Table, html_table

STYLE = """
body { font: 15px sans-serif; max-width: 1200px; margin: 2em auto }
td, th { padding: 3px 9px; border-bottom: 1px solid #ccc; text-align: right }
figure { display: inline-block; margin: 6px }
img { width: 270px }
img.plot { width: 720px }
"""


def figures(names: dict[str, str]) -> str:
    """Pictures side by side: files and their captions."""
    return "".join(
        f'<figure><img src="{file}" alt="{text}"><figcaption>{text}</figcaption></figure>'
        for file, text in names.items()
    )


def page(times: Table, lattice: Table, bench: dict[str, dict[str, Table]], spp: int) -> str:
    """index.html. bench : tables by their headings, in sections."""
    parts = [
        "<!doctype html><meta charset=utf-8><title>The paper's results beside ours</title>"
        f"<style>{STYLE}</style>",
        "<h1>The paper's results beside ours</h1>",
        *ball_section(times, spp),
        *cube_section(lattice),
        *(bench_section(title, tables) for title, tables in bench.items()),
        "",
    ]
    return "\n".join(parts)


def ball_section(times: Table, spp: int) -> list[str]:
    """Pictures and table of the ball's source image."""
    shown = {
        "figure_5_ideal_plate_splat.png": f"ideal plate, splat, {spp} spp",
        "figure_5_ideal_plate_kiriko.png": "ideal plate, Kiriko",
        "figure_5_mirror_array_splat.png": f"mirror array, splat, {spp} spp",
        "figure_5_mirror_array_kiriko.png": "mirror array, Kiriko",
    }
    return [
        "<h2>Figure 5: the ball's source image, and the times</h2>",
        figures(shown),
        html_table(times),
        f"<p>{html.escape(ABOUT_TIMES)} Ours: {html.escape(machine())}.</p>",
    ]


def cube_section(lattice: Table) -> list[str]:
    """Pictures, table and plot of the lattice in the cube."""
    seen = {
        "figure_7_ideal.png": "ideal image",
        "figure_7_plain.png": f"{PLAIN}, by Cycles",
        "figure_7_infloasion.png": f"{HALF}, by Cycles",
        "figure_7_source.png": f"{SOURCE}, by Cycles",
    }
    on_display = {
        "display_plain.png": f"what the display shows: {PLAIN} and {HALF}",
        "display_source.png": f"what it shows: {SOURCE}",
    }

    return [
        "<h2>Figures 7 and 8: the cube, in four conditions</h2>",
        figures(seen),
        html_table(lattice),
        f"<p>{html.escape(ABOUT_LATTICE)}</p>",
        '<p><a href="lattice.csv">All points (CSV)</a></p>'
        '<img class="plot" src="figure_8.svg" alt="figure 8">',
        figures(on_display),
    ]


def bench_section(title: str, tables: dict[str, Table]) -> str:
    """Tables under their headings, as one section."""
    shown = (f"<p>{html.escape(about)}:</p>{html_table(table)}" for about, table in tables.items())
    return f"<h2>{html.escape(title)}</h2>" + "".join(shown)
