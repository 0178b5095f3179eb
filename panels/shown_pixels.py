"""Draws the source image into show windows, one image pixel to a screen pixel, on black.

Blender draws an image through the view transform, in half floats, and scaled by the zoom. Here a
shader fetches the numbers of the exported 8-bit file, whatever the scale of the interface.
"""

from typing import NamedTuple

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader
from numpy.typing import NDArray

from ..core.blender.data.image import pixels_from_image
from ..core.files.encoding import Curve, Encoding, quantised
from ..core.rig.joined_display import Section
from ..operators import map_drawing, show_window
from ..operators.export import gamma_of

TOP = 255  # largest number of 8 bits
# Of a texture: the file's numbers, or linear light, to be encoded as sRGB or with a gamma.
NUMBERS, SRGB = -1.0, 0.0
FRAGMENT = """
void main() {
    vec3 light = clamp(texelFetch(image, ivec2(floor(at)), 0).rgb, 0.0, 1.0);
    vec3 shown = light;
    if (encoded == 0.0) {
        vec3 curved = 1.055 * pow(light, vec3(1.0 / 2.4)) - 0.055;
        shown = mix(curved, 12.92 * light, vec3(lessThanEqual(light, vec3(0.0031308))));
    }
    else if (encoded > 0.0) {
        shown = pow(light, vec3(1.0 / encoded));
    }
    colour = vec4(shown, 1.0);
}
"""


class DrawnPixels(NamedTuple):
    """The image drawn last.

    pixels : (h, w, 4) float32, as Blender stores them
    """

    uid: int
    gamma: Curve
    pixels: NDArray[np.float32]
    texture: object


_shown: list[DrawnPixels] = []  # at most one
_shaders: list[object] = []


def draw() -> None:
    """Draw into a show window. Blender calls it for every text editor."""
    context = bpy.context
    if not show_window.is_ours(context.window):
        return

    size = context.region.width, context.region.height
    gpu.state.scissor_set(0, 0, *size)
    gpu.state.active_framebuffer_get().clear(color=(0.0, 0.0, 0.0, 1.0))
    scene = context.window.scene
    image = show_window.shown_result(scene).source
    if image is not None and min(image.size) > 0:
        section = show_window.shown_section(context.window, image)
        _draw(image, section, gamma_of(scene, section.name), size)
    # Blender draws the marks of hidden headers last, into this region's own buffer
    gpu.state.scissor_set(0, 0, 0, 0)


def numbers_of(pixels: NDArray[np.float32], gamma: Curve) -> NDArray[np.float32]:
    """The numbers 0..1 (h, w, 4) of the exported file, in steps of 8 bits, row 0 at the bottom."""
    opaque = np.ones_like(pixels)
    opaque[..., :3] = quantised(pixels[::-1, :, :3], "uint8", gamma) / np.float32(TOP)
    return opaque


def corner_of(size: tuple[int, int], region: tuple[int, int]) -> tuple[int, int]:
    """The place of the lower left pixel of an image in the middle of a region, px."""
    return (region[0] - size[0]) // 2, (region[1] - size[1]) // 2


def _draw(image: bpy.types.Image, section: Section, gamma: Curve, region: tuple[int, int]) -> None:
    size = section.width, section.height
    low = image.size[1] - section.top - section.height
    x, y = corner_of(size, region)
    # in units of the region, -1 to 1: Blender's matrices are off by fractions of a pixel
    left, right = (2 * place / region[0] - 1 for place in (x, x + size[0]))
    below, above = (2 * place / region[1] - 1 for place in (y, y + size[1]))
    corners = [(left, below), (right, below), (right, above), (left, above)]
    places = [(0, low), (size[0], low), (size[0], low + size[1]), (0, low + size[1])]

    shader = _shader()
    batch = batch_for_shader(
        shader, "TRIS", {"pos": corners, "place": places}, indices=[(0, 1, 2), (0, 2, 3)]
    )
    before = gpu.state.blend_get(), gpu.state.depth_test_get()
    try:
        gpu.state.blend_set("NONE")
        gpu.state.depth_test_set("NONE")
        # the shader has the curves of single colours only
        texture = None if isinstance(gamma, Encoding) else map_drawing.texture_for(image)
        encoded = NUMBERS if texture is None else SRGB if gamma is None else gamma
        shader.bind()
        shader.uniform_float("encoded", encoded)
        shader.uniform_sampler("image", texture or _texture(image, gamma))
        batch.draw(shader)
    finally:
        gpu.state.blend_set(before[0])
        gpu.state.depth_test_set(before[1])


def _texture(image: bpy.types.Image, gamma: Curve) -> object:
    """The image as a texture, created again if a pixel has changed."""
    pixels = pixels_from_image(image)
    for shown in _shown:
        is_same = (shown.uid, shown.gamma) == (image.session_uid, gamma)
        if is_same and np.array_equal(shown.pixels, pixels):
            return shown.texture

    numbers = numbers_of(pixels, gamma)
    buffer = gpu.types.Buffer("FLOAT", numbers.size, np.ascontiguousarray(numbers).ravel())
    texture = gpu.types.GPUTexture(tuple(image.size), format="RGBA8", data=buffer)
    _shown[:] = [DrawnPixels(image.session_uid, gamma, pixels, texture)]
    return texture


def _shader() -> object:
    if not _shaders:
        between = gpu.types.GPUStageInterfaceInfo("kiriko_shown_pixels")
        between.smooth("VEC2", "at")
        info = gpu.types.GPUShaderCreateInfo()
        info.vertex_in(0, "VEC2", "pos")
        info.vertex_in(1, "VEC2", "place")
        info.vertex_out(between)
        info.push_constant("FLOAT", "encoded")
        info.sampler(0, "FLOAT_2D", "image")
        info.fragment_out(0, "VEC4", "colour")
        info.vertex_source("void main() { at = place; gl_Position = vec4(pos, 0.0, 1.0); }")
        info.fragment_source(FRAGMENT)
        _shaders.append(gpu.shader.create_from_info(info))
    return _shaders[0]


_handles: list[object] = []


def register() -> None:
    """Add the draw handler."""
    add = bpy.types.SpaceTextEditor.draw_handler_add
    _handles.append(add(draw, (), "WINDOW", "POST_PIXEL"))


def unregister() -> None:
    """Remove the draw handler."""
    while _handles:
        bpy.types.SpaceTextEditor.draw_handler_remove(_handles.pop(), "WINDOW")
    _shown.clear()
    _shaders.clear()
