"""A cut pixel in four panels: cells, pieces, their images, the shares of a display pixel."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from kiriko.core.base.arrays import Floats
from kiriko.core.image.flat_picture import view_of_picture

from .solved import DISPLAY_PX, VIEW_PX, Solved
from .svg import Panel, line

PANEL_LEFTS = (25, 312, 599, 886)  # px of the drawing
AROUND_PX = 0.35  # of the viewer or display: so much is shown around a pixel
LEAST_LABELLED_PX2 = 0.03  # smaller shares have no room for their area

MARK = "#d00000"  # around the pixel that the next panel shows larger
MARKED = f'fill="none" stroke="{MARK}" stroke-width="2.5"'


def panels(found: Solved) -> Iterator[str]:
    """The four panels, of which the second and the last show a pixel of the one before larger."""
    zero = np.zeros(2)
    around = 1 + 2 * AROUND_PX
    view = Panel(PANEL_LEFTS[0], zero, VIEW_PX)
    cut = Panel(PANEL_LEFTS[1], found.pixel - AROUND_PX, around)
    display = Panel(PANEL_LEFTS[2], zero, DISPLAY_PX)
    shown = Panel(PANEL_LEFTS[3], found.display_pixel - AROUND_PX, around)

    notes = notes_on(found)
    yield from view.drawn("On the viewer's image: cells", next(notes), of_view(found, view))
    yield from cut.drawn("A cut pixel: pieces", next(notes), of_cut(found, cut))
    yield from display.drawn(
        "On the display: their images", next(notes), of_display(found, display)
    )
    yield from shown.drawn("A display pixel: shares", next(notes), of_shares(found, shown))
    yield from beams(view, found.pixel, cut)
    yield from beams(display, found.display_pixel, shown)


def notes_on(found: Solved) -> Iterator[str]:
    """The words below each panel."""
    areas = [sum(polygon.area for polygon in some) for _, some in found.by_branch(found.cut)]
    one, other = (some[0].display.mean(axis=0) for _, some in found.by_branch(found.cut))
    yield (
        "A colour is a branch: light by way of the same surfaces. Pixels that a border runs through"
        " are cut, and so are cells along the outline of the picture (dashed). Small squares are"
        " samples, where light is chaotic."
    )
    yield (
        f"An edge of the cube divides it: {areas[0]:.2f} of it are one branch, {areas[1]:.2f} the"
        " other. Numbers are areas, px\u00b2. Dots are traced rays. The black ones are on the"
        " border, where bisection found them: one ray on each side."
    )
    yield (
        f"The two parts of the cut pixel (black) land {np.linalg.norm(one - other):.0f} pixels"
        " apart. Were it not cut, its image would lie across all pixels between them."
    )
    yield (
        f"Each of its {len(found.shares)} parts is a share. It has an area a on the viewer's image"
        " (the number, px\u00b2), a throughput T, and the colour c that the picture has there. The"
        " pixel shows \u03a3\u00a0a\u00a0T\u00a0c\u00a0/\u00a0\u03a3\u00a0a\u00a0T\u00b2."
        " The viewer sees nothing of the white part."
    )


def of_view(found: Solved, panel: Panel) -> Iterator[str]:
    """All cells, by branch, and the picture's outline."""
    for colour, some in found.by_branch(found.polygons):
        yield panel.polygons((polygon.view for polygon in some), filled(colour, 0.22))
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    outline = view_of_picture(found.rig.picture_place, found.channel.viewer, corners)
    yield panel.polygon(outline, 'fill="none" stroke="black" stroke-dasharray="5 3"')
    yield panel.pixel(found.pixel, MARKED)


def of_cut(found: Solved, panel: Panel) -> Iterator[str]:
    """The pieces around the cut pixel, and the points that were traced."""
    for colour, some in found.by_branch(found.polygons):
        yield panel.polygons((polygon.view for polygon in some), filled(colour, 0.12))
    for colour, some in found.by_branch(found.cut):
        yield panel.polygons((polygon.view for polygon in some), filled(colour, 0.45))
        for polygon in some:
            yield panel.label(polygon.view.mean(axis=0), f"{polygon.area:.2f}")
    yield panel.pixel(found.pixel, MARKED)

    for view, colour in found.traced_in_pixel():
        yield panel.dot(view, 4, f'fill="{colour}"')


def of_display(found: Solved, panel: Panel) -> Iterator[str]:
    """The images of all cells; those of the cut pixel stand out."""
    for colour, some in found.by_branch(found.polygons):
        yield panel.polygons((polygon.display for polygon in some), filled(colour, 0.15))
    for colour, some in found.by_branch(found.cut):
        style = f'fill="{colour}" stroke="black" stroke-width="1.5"'
        yield panel.polygons((polygon.display for polygon in some), style)
    yield panel.pixel(found.display_pixel, MARKED)


def of_shares(found: Solved, panel: Panel) -> Iterator[str]:
    """The images of pieces on a display pixel, each of which makes a share of it."""
    for colour, some in found.by_branch(found.polygons):
        yield panel.polygons((polygon.display for polygon in some), filled(colour, 0.2))
    for colour, some in found.by_branch(found.cut):
        yield panel.polygons((polygon.display for polygon in some), filled(colour, 0.4))
    yield panel.pixel(found.display_pixel, MARKED)

    places = found.channel.view_map.display_from_view(found.shares.view_xy)
    for place, area in zip(places, found.shares.area, strict=True):
        if area >= LEAST_LABELLED_PX2:
            yield panel.label(place, f"{area:.2f}")


def filled(colour: str, opacity: float) -> str:
    """The style of polygons of a branch."""
    return (
        f'fill="{colour}" fill-opacity="{opacity}" stroke="{colour}" stroke-width="0.8"'
        ' stroke-linejoin="round"'
    )


def beams(panel: Panel, pixel: Floats, larger: Panel) -> Iterator[str]:
    """Lines from a marked pixel to the panel that shows it larger."""
    from_pixel = panel.at(pixel + np.array([[1, 0], [1, 1]]))
    into_panel = larger.at(pixel + np.array([[0, 0], [0, 1]]))
    for ends in np.stack([from_pixel, into_panel], axis=1):
        yield line(ends, MARK, 'stroke-width="0.8" stroke-opacity="0.6"')
