"""Draws view maps with the graphics card: source images without painting, and seen images.

A view map is a mesh with two places for each corner, on the display and on the viewer's image.
Drawn on the display and textured with the picture, it is the source image. Drawn on the viewer's
image and textured with the source image, it is the seen image. A pixel reads its whole footprint
around the place shown in its middle. If several parts of the mesh cover a pixel, their colours and
weights add up, and a second pass divides them, as painting does.

A drawn source image replaces the pixels of a result's image until these are painted.
"""

import weakref
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import NamedTuple

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader
from mathutils import Matrix
from numpy.typing import NDArray

from ..core.base.arrays import Floats
from ..core.base.vectors import cross_2d
from ..core.image.inverse_lookup import plane_mapping
from ..core.map.pieces import UNIT_SQUARE
from ..core.map.points import Points
from ..core.map.view_map import ViewMap
from ..core.rig.rig import Picture, Rig, Viewer
from ..core.rig.settings import Settings
from ..core.solve.channel import ChannelMaps
from ..core.solve.disagreement import is_sharp
from ..core.solve.reflected_picture import is_reflected
from ..core.solve.solution import Solution

Image = NDArray[np.float32]
Texture = gpu.types.GPUTexture

# of a corner: display px, viewer px, the derivatives of viewer px by display x and y, throughput
LAYOUT = {"display": 2, "view": 2, "by_display": 4, "throughput": 1}
HALVES = (0, 1, 2), (0, 2, 3)  # of quads
VALUES = sum(LAYOUT.values())
# px between reads. Twice as many of a display gain nothing, as they are exact along its axes.
OF_PICTURE, OF_DISPLAY = 0.45, 1.0
MOST_ROUGH = 0.01  # of the view, limited by facets, unresolved or sampled
MESH_VERTEX = """
void main() {
    bool is_seen = options.x > 0.5;
    float area = by_display.x * by_display.w - by_display.y * by_display.z;
    vec4 by_view = vec4(by_display.w, -by_display.y, -by_display.z, by_display.x) / area;
    vec2 place = is_seen ? view : display;
    at = is_seen ? display : view;
    sides = (is_seen ? by_view : by_display) * pixel.xxyy;
    light = vec2(is_seen ? 1.0 : abs(area) * options.z, options.y > 0.5 ? throughput : 1.0);
    gl_Position = vec4(2.0 * place / size - 1.0, 0.0, 1.0);
}
"""
# A read is a box. Of a picture it is a pixel wide, which is linear interpolation. Pixels of a
# display are squares, so there it is as wide as its part of the footprint.
MESH_FRAGMENT = """
vec3 pixel_at(ivec2 at) {
    return texelFetch(image, clamp(at, ivec2(0), textureSize(image, 0) - 1), 0).rgb;
}

vec3 box_at(vec2 place, vec2 width) {
    vec2 low = floor(place - 0.5);
    vec2 part = clamp((place - low - 1.0) / width + 0.5, 0.0, 1.0);
    ivec2 first = ivec2(low);
    vec3 upper = mix(pixel_at(first), pixel_at(first + ivec2(1, 0)), part.x);
    vec3 lower = mix(pixel_at(first + ivec2(0, 1)), pixel_at(first + ivec2(1, 1)), part.x);
    return mix(upper, lower, part.y);
}

vec2 side_of(vec2 change, vec3 place) {
    vec3 moved = (mapping * vec4(change, 0.0, 0.0)).xyz;
    return (moved.xy - place.xy * moved.z) / place.z;
}

void main() {
    vec3 place = (mapping * vec4(at, 1.0, 0.0)).xyz;
    place.xy /= place.z;
    vec2 along = side_of(sides.xy, place);
    vec2 across = side_of(sides.zw, place);
    float n = clamp(ceil(length(along) / options.w), 2.0, 16.0);
    float m = clamp(ceil(length(across) / options.w), 2.0, 16.0);
    vec2 width = options.x > 0.5 ? clamp(abs(along) / n + abs(across) / m, 0.001, 1.0) : vec2(1.0);

    vec3 total = vec3(0.0);
    vec2 reach = 0.5 * (abs(along) + abs(across));
    bool is_right = all(greaterThan(place.xy + reach, bounds.xy));
    if (place.z > 0.0 && is_right && all(lessThan(place.xy - reach, bounds.zw))) {
        for (float i = 0.5; i < n; i += 1.0) {
            for (float j = 0.5; j < m; j += 1.0) {
                vec2 here = place.xy + (i / n - 0.5) * along + (j / m - 0.5) * across;
                if (all(greaterThanEqual(here, bounds.xy)) && all(lessThanEqual(here, bounds.zw))) {
                    total += box_at(here, width);
                }
            }
        }
    }
    colour = vec4(total / (n * m), light.y) * light.x * light.y;
}
"""
RATIO_VERTEX = "void main() { gl_Position = vec4(pos, 0.0, 1.0); }"
# row 0 of an image of Blender is at the bottom
RATIO_FRAGMENT = """
void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    vec4 sums = texelFetch(image, ivec2(at.x, textureSize(image, 0).y - 1 - at.y), 0);
    colour = vec4(sums.a > 0.0 ? sums.rgb / sums.a : vec3(0.0), 1.0);
}
"""

# by points of a map; None for a map without light on the display
_meshes: weakref.WeakKeyDictionary[Points, gpu.types.GPUBatch | None] = weakref.WeakKeyDictionary()
_textures: list[tuple[weakref.ref[Image], Texture]] = []  # of images that exist
_canvas: list[gpu.types.GPUOffScreen] = []  # of sums, at most one
_drawn: dict[int, gpu.types.GPUOffScreen] = {}  # by session uid of the image


def can_draw(rig: Rig, settings: Settings) -> bool:
    """Whether a source image can be drawn: there is a window, and each pixel depends on its light
    alone.
    """
    return (
        has_shaders()
        and settings.margin == 0
        and settings.suppress_glare == 0
        and settings.ghosts == "mean"
        and not settings.sharpen
        and not any(display.black_level for display in rig.displays)
        and not rig.projectors
        and not is_reflected(rig)
        and not rig.disperses
        and rig.display.views is None
        and not is_sharp(rig, settings)
        and all(plane_mapping(rig.place_of(viewer), viewer) for viewer in rig.viewers)
        and max(rig.display.width, rig.display.height, *_picture_sizes(rig))
        <= gpu.capabilities.max_texture_size_get()
    )


def is_faithful(solution: Solution) -> bool:
    """Whether drawn images equal painted ones: parts smaller than a pixel, as of facets, may not be
    drawn, a coarse display has more in a pixel than is read, and pupils are not drawn.
    """
    display, first = solution.rig.display, solution.first
    error, viewer = first.map_error, first.viewer
    is_fine = display.width * display.height >= viewer.width * viewer.height
    is_fine &= display.views is None and not viewer.pupil
    return is_fine and error.facet_limited + error.unresolved + error.sampled <= MOST_ROUGH


@cache
def has_shaders() -> bool:
    """Whether there is a window with a graphics card that compiles the shaders. Software renderers
    draw no faster than the kernel paints.
    """
    if bpy.app.background or gpu.platform.device_type_get() == "SOFTWARE":
        return False
    try:
        _mesh_shader()
        _ratio_shader()
    except Exception:  # of this very class
        return False
    return True


def _picture_sizes(rig: Rig) -> list[int]:
    return [n for viewer in rig.viewers for n in rig.picture_of(viewer).image.shape[:2]]


def show(image: bpy.types.Image, rig: Rig, settings: Settings, maps: ChannelMaps) -> bool:
    """Draw a source image in place of the pixels of an image, until `forget`; false if the display
    stays dark.
    """
    if all(_mesh_of_map(view_map) is None for _, view_map in maps):
        return False
    _drawn[image.session_uid] = _draw_source(tuple(image.size), rig, settings, maps)
    return True


def texture_for(image: bpy.types.Image) -> Texture | None:
    """The texture drawn for an image, linear, row 0 at the bottom; None if its pixels count."""
    found = _drawn.get(image.session_uid)
    return None if found is None else found.texture_color


def forget() -> None:
    """Show the pixels of all images again."""
    _drawn.clear()


def source_image(rig: Rig, settings: Settings, maps: ChannelMaps) -> Image:
    """The source image (H, W, 3), linear, row 0 at the top."""
    size = rig.display.width, rig.display.height
    return np.ascontiguousarray(_read(_draw_source(size, rig, settings, maps))[::-1])


def seen_image(view_map: ViewMap, light: Image, settings: Settings) -> Image:
    """The seen image (h, w, 3), linear, of the display's light (H, W, 3); row 0 at the top."""
    bounds = 0, 0, *light.shape[1::-1]
    options = 1, settings.brightness, 1, OF_DISPLAY
    canvas = _empty(view_map.view_size)
    placing = Placing(np.eye(3), bounds, view_map.view_size, (1, 1), options)
    _add(canvas, _mesh_of_map(view_map), light, placing)
    return _read(canvas)


def ideal_image(picture: Picture, viewer: Viewer) -> Image | None:
    """The picture seen without glass: (h, w, 3) linear, row 0 at the top; None if it is not
    flat.
    """
    mapping = plane_mapping(picture.place, viewer)
    if mapping is None:
        return None
    size = viewer.width, viewer.height
    image = (UNIT_SQUARE * size)[None].astype(float)
    corners = [_triangles(image[:, some], image[:, some], np.ones(1)) for some in HALVES]
    canvas = _empty(size)
    placing = Placing(
        mapping.there, (*mapping.low, *mapping.high), size, (1, 1), (0, 0, 1, OF_PICTURE)
    )
    _add(canvas, _mesh_of(np.concatenate(corners)), picture.image, placing)
    return _read(canvas)


def _draw_source(
    size: tuple[int, int], rig: Rig, settings: Settings, maps: ChannelMaps
) -> gpu.types.GPUOffScreen:
    """A source image, row 0 at the bottom. The maps may be those of a smaller display."""
    canvas = _empty(size)
    for key, view_map in maps:
        picture = rig.picture_of(key.viewer)
        mapping = plane_mapping(picture.place, key.viewer)
        placing = Placing(
            mapping=mapping.there,
            bounds=(*mapping.low, *mapping.high),
            size=view_map.display_size,
            pixel=tuple(np.divide(view_map.display_size, size)),
            options=(0, settings.brightness, key.viewer.weight, OF_PICTURE),
        )
        _add(canvas, _mesh_of_map(view_map), picture.image, placing)

    found = gpu.types.GPUOffScreen(*size, format="RGBA16F")
    with found.bind(), _blended("NONE"):
        shader = _ratio_shader()
        shader.bind()
        shader.uniform_sampler("image", canvas.texture_color)
        corners = {"pos": np.float32(2 * UNIT_SQUARE - 1)}
        batch_for_shader(shader, "TRIS", corners, indices=HALVES).draw(shader)
    return found


class Placing(NamedTuple):
    """Where a mesh is drawn; names and values are those of the shader.

    mapping : (3, 3) from the places to read to pixels of the texture
    bounds : left, upper, right and lower end of the texture's part to show, px
    size, pixel : of the canvas, and of one of its pixels, in pixels of the map
    options : whether the canvas is the viewer's image, whether throughput counts, the weight, and
        the distance between reads, px of the texture
    """

    mapping: Floats
    bounds: Sequence[float]
    size: Sequence[float]
    pixel: Sequence[float]
    options: Sequence[float]


def _add(
    canvas: gpu.types.GPUOffScreen, mesh: gpu.types.GPUBatch | None, image: Image, placing: Placing
) -> None:
    """Add the colours and weights of a mesh to a canvas, textured with an image."""
    if mesh is None:
        return
    matrix = np.eye(4)
    matrix[:3, :3] = placing.mapping
    texture = _texture_of(image)
    with canvas.bind(), _blended("ADDITIVE_PREMULT"):
        shader = _mesh_shader()
        shader.bind()
        for name, value in placing._replace(mapping=Matrix(matrix))._asdict().items():
            shader.uniform_float(name, value)
        shader.uniform_sampler("image", texture)
        mesh.draw(shader)


@contextmanager
def _blended(mode: str) -> Iterator[None]:
    """Blend in a mode, whatever is drawn around it."""
    before = gpu.state.blend_get(), gpu.state.depth_test_get()
    try:
        gpu.state.blend_set(mode)
        gpu.state.depth_test_set("NONE")
        gpu.state.face_culling_set("NONE")
        yield
    finally:
        gpu.state.blend_set(before[0])
        gpu.state.depth_test_set(before[1])


def _empty(size: tuple[int, int]) -> gpu.types.GPUOffScreen:
    """The cleared canvas of sums: in half floats, because not every backend blends others."""
    if not _canvas or (_canvas[0].width, _canvas[0].height) != size:
        _canvas[:] = [gpu.types.GPUOffScreen(*size, format="RGBA16F")]
    with _canvas[0].bind():
        gpu.state.active_framebuffer_get().clear(color=(0.0, 0.0, 0.0, 0.0))
    return _canvas[0]


def _read(canvas: gpu.types.GPUOffScreen) -> Image:
    """Colours (h, w, 3), row 0 first."""
    size = canvas.width, canvas.height
    with canvas.bind():
        frame = gpu.state.active_framebuffer_get()
        # numpy misreads a buffer of several dimensions of Blender 4.3
        numbers = gpu.types.Buffer("FLOAT", 4 * size[0] * size[1])
        frame.read_color(0, 0, *size, 4, 0, "FLOAT", data=numbers)
    return np.array(numbers, np.float32).reshape(*size[::-1], 4)[..., :3]


def _texture_of(image: Image) -> Texture:
    """The texture of an image (h, w, 3 or 4), row 0 first."""
    for known, texture in _textures:
        if known() is image:
            return texture
    pixels = np.ones((*image.shape[:2], 4), np.float32)
    pixels[..., :3] = image[..., :3]
    numbers = gpu.types.Buffer("FLOAT", pixels.size, pixels.ravel())
    texture = gpu.types.GPUTexture(image.shape[1::-1], format="RGBA16F", data=numbers)
    there = [one for one in _textures if one[0]() is not None]
    _textures[:] = [*there, (weakref.ref(image), texture)]
    return texture


def _mesh_of_map(view_map: ViewMap) -> gpu.types.GPUBatch | None:
    """The mesh of a map, from the cache if it is there; None without light on the display."""
    if view_map.points not in _meshes:
        _meshes[view_map.points] = _mesh_of(corners_of(view_map))
    return _meshes[view_map.points]


def corners_of(view_map: ViewMap) -> Image:
    """Corners (t, 3, VALUES) of a map's triangles on the display, in the order of LAYOUT."""
    found = [np.empty((0, 3, VALUES), np.float32)]
    for piece in view_map.pieces(parts=view_map.parts_within_tolerance):
        low, high = piece.display.min(axis=1), piece.display.max(axis=1)
        view, display, throughput, *_ = piece.at(
            ((high > 0) & (low < view_map.display_size)).all(axis=1)
        )
        for half in HALVES[: view.shape[1] - 2]:
            found.append(_triangles(view[:, half], display[:, half], throughput))
    return np.concatenate(found)


def _triangles(view: Floats, display: Floats, throughput: Floats) -> Image:
    """Triangles (n, 3, VALUES) with corners (n, 3, 2); those without area are left out."""
    (a, b), (u, v) = ((corner[:, 1:] - corner[:, :1]).swapaxes(0, 1) for corner in (display, view))
    with np.errstate(divide="ignore", invalid="ignore"):
        area = cross_2d(a, b)[:, None]
        by_x = (u * b[:, 1:] - v * a[:, 1:]) / area
        by_y = (v * a[:, :1] - u * b[:, :1]) / area
    each = np.concatenate([by_x, by_y, throughput[:, None]], axis=1)[:, None].repeat(3, axis=1)
    found = np.concatenate([display, view, each], axis=2).astype(np.float32)
    return found[np.isfinite(found).all(axis=(1, 2)) & (cross_2d(by_x, by_y) != 0)]


def _mesh_of(corners: Image) -> gpu.types.GPUBatch | None:
    """The mesh of triangles' corners (t, 3, VALUES) on the graphics card; None if there are
    none.
    """
    if not len(corners):
        return None
    layout = gpu.types.GPUVertFormat()
    for name, n in LAYOUT.items():
        layout.attr_add(id=name, comp_type="F32", len=n, fetch_mode="FLOAT")
    buffer = gpu.types.GPUVertBuf(layout, 3 * len(corners))
    ends = np.cumsum(list(LAYOUT.values()))
    columns = np.split(corners.reshape(-1, VALUES), ends[:-1], axis=1)
    for name, values in zip(LAYOUT, columns, strict=True):
        buffer.attr_fill(name, np.ascontiguousarray(values))
    return gpu.types.GPUBatch(type="TRIS", buf=buffer)


@cache
def _mesh_shader() -> gpu.types.GPUShader:
    between = gpu.types.GPUStageInterfaceInfo("kiriko_drawn_mesh")
    for kind, name in (("VEC2", "at"), ("VEC4", "sides"), ("VEC2", "light")):
        between.smooth(kind, name)
    info = gpu.types.GPUShaderCreateInfo()
    for k, (name, n) in enumerate(LAYOUT.items()):
        info.vertex_in(k, f"VEC{n}" if n > 1 else "FLOAT", name)
    info.vertex_out(between)
    for kind, name in (
        ("MAT4", "mapping"), ("VEC4", "bounds"), ("VEC4", "options"), ("VEC2", "size"),
        ("VEC2", "pixel"),
    ):  # fmt: skip
        info.push_constant(kind, name)
    return _compiled(info, MESH_VERTEX, MESH_FRAGMENT)


@cache
def _ratio_shader() -> gpu.types.GPUShader:
    info = gpu.types.GPUShaderCreateInfo()
    info.vertex_in(0, "VEC2", "pos")
    return _compiled(info, RATIO_VERTEX, RATIO_FRAGMENT)


def _compiled(
    info: gpu.types.GPUShaderCreateInfo, vertex: str, fragment: str
) -> gpu.types.GPUShader:
    """A shader that colours what an image shows."""
    info.sampler(0, "FLOAT_2D", "image")
    info.fragment_out(0, "VEC4", "colour")
    info.vertex_source(vertex)
    info.fragment_source(fragment)
    return gpu.shader.create_from_info(info)


def unregister() -> None:
    """Free the memory of the graphics card."""
    for cached in (_meshes, _textures, _canvas, _drawn):
        cached.clear()
    for found in (has_shaders, _mesh_shader, _ratio_shader):
        found.cache_clear()
