"""Renders the rig in Cycles, an independent check of Kiriko's results, without touching the user's
data.

A temporary scene links the user's own objects. Parts are copied as evaluated, curved surfaces as
fine triangles, with materials that obey the same laws. Cycles has one relative index of refraction
per interface, so nested solids get the ratio of the two media; if this is ambiguous, a note says
that the preview is not comparable.
"""

import tempfile
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...base.errors import ImageError
from ...files.picture_file import has_header
from ..data.colour import to_rec709
from ..data.image import image_from_pixels, stored_numbers
from ..data.temporary import mark, remove_leftovers
from ..read.part_roles import Studio
from ..read.scene import Reading, length_of_unit
from .preview_parts import PreviewParts, add_surroundings
from .preview_settings import Options, set_cycles, set_render


class Preview:
    """A temporary scene of the rig for Cycles: a context manager that leaves nothing behind.

    Parameters
    ----------
    scene : the user's scene, with settings in `scene.kiriko`
    reading : the rig by `scene.read`, with its indices of refraction
    source : image datablock on the display; None for the display's own coordinates (u, v, 1)
    options : fields of `Options`

    Attributes
    ----------
    notes : reasons why the render is not comparable
    path : file of the render, linear OpenEXR
    """

    def __init__(
        self,
        scene: bpy.types.Scene,
        reading: Reading,
        source: bpy.types.Image | None,
        **options: Any,
    ) -> None:
        self.notes: list[str] = []
        chosen = Options(**options)
        studio = Studio(source, chosen.fresnel, length_of_unit(scene), mark)
        self._is_colour = source is not None
        self._folder = tempfile.TemporaryDirectory(prefix="kiriko-")
        self.path = Path(self._folder.name) / "preview.exr"
        remove_leftovers()

        try:
            self.scene = mark(bpy.data.scenes.new("Kiriko Preview"))
            self._fill(scene, reading, studio, chosen.surroundings)
            set_render(self.scene, scene, chosen, self.path)
            set_cycles(self.scene, scene, chosen)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> "Preview":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Remove the temporary scene and its data."""
        remove_leftovers()
        self._folder.cleanup()

    @property
    def is_rendered(self) -> bool:
        return self.path.exists()

    def render(self) -> np.ndarray:
        """Render now, wait for it, and return the pixels."""
        bpy.ops.render.render(scene=self.scene.name, write_still=True)
        return self.pixels()

    def pixels(self) -> np.ndarray:
        """The render (h, w, 4) float32, linear Rec.709 or coordinates, row 0 at the top; only the
        border's part if there is a border.
        """
        if not self.is_rendered:
            raise ImageError("Cycles wrote no preview. See the console for the reason.")

        if has_header(self.path):
            image = mark(bpy.data.images.load(str(self.path), check_existing=False))
            pixels = stored_numbers(image)
            bpy.data.images.remove(image)
            # a truncated file has no pixels, and Blender reports no error
            if pixels.size:
                return to_rec709(pixels) if self._is_colour else pixels

        raise ImageError(
            "The preview could not be saved in the temporary folder '{folder}'. Free some disk"
            " space and try again.",
            folder=tempfile.gettempdir(),
        )

    def _fill(
        self, scene: bpy.types.Scene, reading: Reading, studio: Studio, surroundings: bool
    ) -> None:
        """Fill the temporary scene."""
        view_layer = bpy.context.view_layer if bpy.context.scene == scene else scene.view_layers[0]
        view_layer.update()
        depsgraph = view_layer.depsgraph

        parts = PreviewParts(self.scene, reading, studio)
        self.notes += parts.notes
        replaced = parts.add_parts(depsgraph, scene)
        if surroundings:
            add_surroundings(self.scene, scene, view_layer, replaced)

        parts.add_camera(scene, depsgraph)


def render_preview(
    scene: bpy.types.Scene,
    reading: Reading,
    source_image: np.ndarray | bpy.types.Image,
    **options: Any,
) -> np.ndarray:
    """The viewer's image of a source image, rendered by Cycles.

    Parameters
    ----------
    source_image : (H, W, 3) float, linear Rec.709, row 0 at the top; or an image datablock
    options : fields of `Options`

    Returns
    -------
    (h, w, 4) float32, linear Rec.709, row 0 at the top
    """
    made = None
    if not isinstance(source_image, bpy.types.Image):
        made = source_image = image_from_pixels("Kiriko Preview Source", source_image)

    try:
        with Preview(scene, reading, source_image, **options) as preview:
            return preview.render()
    finally:
        if made is not None:
            bpy.data.images.remove(made)


def render_map(scene: bpy.types.Scene, reading: Reading, **options: Any) -> np.ndarray:
    """Landings of the centres of viewer pixels on the display, traced by Cycles with one sample a
    pixel.

    Parameters
    ----------
    options : size, percentage and border, fields of `Options`

    Returns
    -------
    (h, w, 3) float32: u and v of the display (origin bottom left), and 1 if the path arrived, else
    0; row 0 at the top. Good to about 0.002 display pixels of 512.
    """
    with Preview(
        scene, reading, None, **options, samples=1, fresnel=False, filter_width=0.01
    ) as preview:
        carried = preview.render()[..., :3]
    throughput = carried[..., 2:]  # below 1 behind absorbing mirrors
    return np.divide(carried, throughput, out=np.zeros_like(carried), where=throughput > 0)
