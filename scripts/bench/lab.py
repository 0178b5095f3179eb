"""A lab's measurements of the plate: where its image
stands, how sharp and how bright it is: `dev.py lab`.

Runs inside Blender, which is imported only where Cycles is
asked: measurements in core run without.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

import kiriko
from kiriko.core.base.arrays import Floats
from kiriko.core.base.steps import finish
from kiriko.core.base.vectors import dot, normalise
from kiriko.core.bench.placement import frame, lattice
from kiriko.core.image.seen_image import dot_centroids
from kiriko.core.image.simulation import simulate
from kiriko.core.light.compile_plan import make_plan
from kiriko.core.light.optics import reflect
from kiriko.core.light.plate import STRAY_PATHS, PlatePath, light_by_angle
from kiriko.core.light.trace import trace_all
from kiriko.core.rig.rig import PRESETS, MirrorArray, Rig, Viewer
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session

if TYPE_CHECKING:
    import bpy

DISTANCES = (0.4, 0.45, 0.5, 0.55, 0.6)  # m, from the plate to the display
# m and px of the display; so many that each of the 7 x 7 dots has the same
CHART = 0.04
CHART_PIXELS = 1400
FIELD = 1.1 * CHART  # m, the viewer's field around the image
# m, between the two viewers, and from the image to where they stand
APART = 0.05
AWAY = 1.0
NO_GLASS = Settings(only_through_glass=False, tolerance=1e-3)

TILT = np.radians(5.0)  # of the edge
PARTS = 4  # of a pixel, by which the edge is sampled
REACH = 3e-3  # m, beyond which the edge has no effect
PADDED = 1 << 14  # samples of the spread edge, filled up with zeros: frequencies closer together

ANGLES = np.arange(10.0, 61.0, 5.0)  # degrees
STRAY = (PlatePath.STRAY_1, PlatePath.STRAY_2)
CLASSES = {"mid-air": (PlatePath.IMAGED,), "stray": STRAY, "through": (PlatePath.THROUGH,)}
# shares by geometry alone, of a plate with h / p = 2.5 and n =
# 1.52, as they are told in the plate's description
TOLD = {
    10.0: (0.041, 0.324, 0.635),
    30.0: (0.379, 0.473, 0.148),
    45.0: (0.863, 0.132, 0.005),
    48.4: (0.998, 0.002, 0.0),
    65.0: (0.472, 0.430, 0.098),
}


def with_mirrors(rig: Rig, array: MirrorArray) -> Rig:
    """The rig with a mirror array for its plate."""
    return replace(rig, plates=(replace(rig.plates[0], array=array),))


def plate_normal(rig: Rig) -> Floats:
    """Unit normal (3,) of the plate."""
    a, b, c = rig.plates[0].mesh.corners[0]
    return normalise(np.cross(b - a, c - a))


def sideways_shift(rig: Rig) -> float:
    """By how much the layers' thickness moves the image sideways, m: h tan(angle in the glass)."""
    array = rig.plates[0].array
    cosine = rig.viewer.axes[2] @ plate_normal(rig)
    sine = np.sqrt(1 - cosine**2) / array.ior
    return float(array.height * sine / np.sqrt(1 - sine**2))


# Where the image stands


def two_viewers(viewer: Viewer) -> list[Viewer]:
    """Two of them, side by side, who look at the same point."""
    right, up, forward = viewer.axes
    both = []
    for k in (-0.5, 0.5):
        ahead = normalise(AWAY * forward - k * APART * right)
        axes = np.stack([np.cross(ahead, up), up, ahead])
        both.append(replace(viewer, position=viewer.position + k * APART * right, axes=axes))
    return both


def triangulate(viewers: list[Viewer], seen: list[Floats]) -> Floats:
    """Points (n, 3) in the middle between two viewers' rays
    through the pixels (n, 2) at which they see them.
    """
    (a, u), (b, v) = (viewer.rays(xy) for viewer, xy in zip(viewers, seen, strict=True))
    along_u = dot(b - a, u)
    along_v = dot(b - a, v)
    cosine = dot(u, v)
    s = (along_u - cosine * along_v) / (1 - cosine**2)
    t = (cosine * along_u - along_v) / (1 - cosine**2)
    return 0.5 * (a + s[:, None] * u + b + t[:, None] * v)


def dots_off(rig: Rig, viewers: list[Viewer], images: list[Floats], chart: Floats) -> Floats:
    """How far dots (n, 3) seen by two viewers stand from
    the mirror images of those on the display, m.

    Right, up and away for the rig's viewer, who stands
    between them. Each dot is known by its colour.
    """
    plane = make_plan(rig, NO_GLASS).display.plane
    on_plate = rig.plates[0].mesh.vertices[0]
    on_display = (
        plane.corner
        + (dot_centroids(chart).reshape(-1, 2) - plane.origin) @ np.linalg.pinv(plane.pixels).T
    )
    mirrored = on_plate + reflect(on_display - on_plate, plate_normal(rig)[None])
    seen = [dot_centroids(image).reshape(-1, 2) for image in images]
    return (triangulate(viewers, seen) - mirrored) @ rig.viewer.axes.T


def off_in_core(rig: Rig, chart: Floats) -> Floats:
    """As `dots_off`, as the view map shows the mid-air image: of
    a mirror array it is the mean over all phases.
    """
    viewers = two_viewers(rig.viewer)
    seen = [
        finish(Session().solve(replace(rig, viewers=(viewer,)), NO_GLASS)).seen(chart)
        for viewer in viewers
    ]
    return dots_off(rig, viewers, seen, chart)


def build(distance: float, pixels: int) -> None:
    """A rig without glass in the way, in a new file.

    The image stands as far from the plate as the display does.
    """
    import bpy

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.mesh.primitive_cube_add(size=0.05)
    glass = bpy.context.object
    bpy.ops.kiriko.add_rig(
        distance=distance,
        field=FIELD,
        viewer_distance=AWAY,
        viewer_resolution=pixels,
        plate_size=0.488,
        display_size=CHART,
        display_resolution=(CHART_PIXELS, CHART_PIXELS),
    )
    glass.location.x = 2.0


def off_in_cycles(scene: bpy.types.Scene, chart: Floats, samples: int) -> tuple[Rig, Floats]:
    """The rig as read, and `dots_off` as Cycles renders the display by way of the ideal plate.

    Moves the camera.
    """
    import bpy
    from mathutils import Matrix

    from kiriko.core.blender import scene as blender_scene
    from kiriko.core.blender.preview import render_preview

    def read() -> blender_scene.Reading:
        bpy.context.view_layer.update()
        return blender_scene.read(bpy.context.evaluated_depsgraph_get(), scene)

    rig = read().rig
    viewers = []
    images = []
    for viewer in two_viewers(rig.viewer):
        scene.camera.matrix_world = Matrix(frame(*viewer.axes[:2], viewer.position))
        reading = read()
        viewers.append(reading.rig.viewer)
        images.append(render_preview(scene, reading, chart, samples=samples, fresnel=False))

    return rig, dots_off(rig, viewers, images, chart)


def print_distances(pixels: int, samples: int) -> Rig:
    """Stereo matching at each distance; the last rig."""
    import bpy

    from demo import quiet  # which registers Kiriko

    apart = f"{1e3 * APART:g} mm apart, {AWAY:g} m from the image"
    print(f"Image distance by stereo matching: two viewers {apart}, {pixels} px, {samples} samples")
    print(
        f"{'plate, mm':<20} {'display':>9} {'image':>9} {'mean error':>10} {'largest':>8}"
        f" {'sideways':>9} {'up':>8}"
    )
    chart = lattice(CHART_PIXELS)

    for distance in DISTANCES:
        with quiet():
            build(distance, pixels)
            rig, in_cycles = off_in_cycles(bpy.context.scene, chart, samples)
            real = with_mirrors(rig, PRESETS["ASKA3D-488"])
            in_core = off_in_core(real, chart)
        for name, off in (("ideal, in Cycles", in_cycles), ("ASKA3D-488, in core", in_core)):
            right, up, away = 1e3 * off.T
            # the display faces the plate along the viewers' way to it: all of it is as far away
            print(
                f"{name:<20} {1e3 * distance:9.3f} {1e3 * distance - away.mean():9.3f}"
                f" {np.abs(away).mean():10.4f}"
                f" {np.abs(away).max():8.4f} {right.mean():9.4f} {up.mean():8.4f}",
                flush=True,
            )

    print(f"Sideways by the layers' thickness, closed form: {1e3 * sideways_shift(real):.4f} mm")
    return rig


# How sharp it is


def edge_image(pixels: int) -> NDArray[np.float32]:
    """A square display's image: in red the tilted edge, in
    green white, which is the edge's flat field.
    """
    x, y = np.meshgrid(*2 * [np.arange(pixels) + 0.5 - pixels / 2])
    edge = x * np.cos(TILT) + y * np.sin(TILT) > 0
    return np.stack([edge, np.ones_like(edge), np.zeros_like(edge)], axis=2).astype(np.float32)


def edge_rig(rig: Rig, field: float, pixels: int) -> Rig:
    """The rig with a distant viewer: one who sees parallel
    light, `field` m of it, and the image at its own scale.
    """
    half = 0.5 * field
    viewer = replace(
        rig.viewer,
        projection="orthographic",
        window=(-half, half, -half, half),
        width=pixels,
        height=pixels,
    )
    return replace(rig, viewers=(viewer,))


def measured_mtf(rig: Rig, phases: int, seed: int) -> tuple[Floats, Floats]:
    """Frequencies (n,) in 1 / m and the contrast of the
    mid-air image there, by its tilted edge (ISO 12233).

    In the mean over phases x phases places of the mirrors, so that all of the edge meets all of
    them alike, and divided by the contrast that the square pixels of viewer and display leave.
    """
    viewer = rig.viewer
    plate = rig.plates[0]
    display = rig.display
    source = edge_image(display.width)
    pixel = (viewer.window[1] - viewer.window[0]) / viewer.width
    x, y = np.meshgrid(np.arange(viewer.width), np.arange(viewer.height))
    away = (x + 0.5 - viewer.width / 2) * np.cos(TILT) + (y + 0.5 - viewer.height / 2) * np.sin(
        TILT
    )
    reach = round(REACH / pixel * PARTS)
    part = np.floor(away * PARTS).astype(int).ravel() + reach
    is_near = (part >= 0) & (part < 2 * reach)
    light = np.zeros((2, 2 * reach))
    random = np.random.default_rng(seed)

    for k in np.ndindex(phases, phases):
        phase = tuple((np.array(k) + random.random(2)) / phases)
        real = with_mirrors(rig, replace(plate.array, phase=phase))
        found = finish(
            simulate(make_plan(real, NO_GLASS), source, 1, int(random.integers(1 << 32)))
        )
        if any(found.luminance[path] for path in STRAY_PATHS):
            raise ValueError("stray light reaches the display: it belongs farther from the plate")
        for channel in (0, 1):
            light[channel] += np.bincount(
                part[is_near], found.image[..., channel].ravel()[is_near], 2 * reach
            )

    line = np.diff(light[0] / light[1])
    frequencies = np.fft.rfftfreq(PADDED, pixel / PARTS)
    size = np.ptp(display.mesh.vertices, axis=0).max() / display.width
    across = np.cos(TILT) * frequencies
    down = np.sin(TILT) * frequencies
    pixels = np.prod(
        [np.sinc(side * along) for side in (pixel, size) for along in (across, down)], axis=0
    )

    return frequencies, np.abs(np.fft.rfft(line, PADDED)) / pixels


def mtf_by_formula(rig: Rig, frequencies: Floats) -> Floats:
    """Contrast (n,) at frequencies (n,) in 1 / m across the edge, for a distant viewer.

    At each of its two mirrors light comes out beside its place by
    a value that is uniform in +- p P(r) along their normal.
    """
    array = rig.plates[0].array
    (mirrors,) = make_plan(rig, NO_GLASS).arrays
    right, up, ahead = rig.viewer.axes
    depth = np.sqrt(1 - (1 - (ahead @ mirrors.axes[2]) ** 2) / array.ior**2)
    contrast = np.ones(len(frequencies))

    for sign in (1, -1):
        mirror = (mirrors.axes[0] + sign * mirrors.axes[1]) / np.sqrt(2)
        crossed = abs(ahead @ mirror) * array.height / (array.ior * depth * array.pitch)
        most = (
            array.pitch
            * (1 - abs(crossed % 2 - 1))
            * (mirror @ (np.cos(TILT) * right - np.sin(TILT) * up))
        )
        contrast *= np.abs(np.sinc(2 * most * frequencies))

    return contrast


def at_half(frequencies: Floats, contrast: Floats) -> float:
    """Lowest frequency at which the contrast is 50 %, 1 / m."""
    k = int(np.argmax(contrast < 0.5))
    return float(np.interp(0.5, contrast[[k, k - 1]], frequencies[[k, k - 1]]))


def print_sharpness(rig: Rig, runs: int) -> None:
    """MTF50 and contrast, measured and by formula, with the measured ones' standard error."""
    rig = edge_rig(with_mirrors(rig, PRESETS["ASKA3D-488"]), 0.024, 600)
    # the faces have no part in the blur
    rig = with_mirrors(rig, replace(rig.plates[0].array, has_fresnel=False))
    found = [measured_mtf(rig, 4, seed) for seed in range(runs)]
    frequencies = found[0][0]
    each = np.array([contrast for _, contrast in found])
    measured = each.mean(axis=0)
    error = each.std(axis=0, ddof=1) / np.sqrt(runs)
    formula = mtf_by_formula(rig, frequencies)
    halves = [at_half(frequencies, contrast) for contrast in each]
    counts = frequencies <= at_half(frequencies, formula)
    degrees = f"{np.degrees(TILT):g} degrees"
    print(
        f"\nSharpness of the mid-air image: edge tilted by {degrees}, seen at 45; {runs} runs of"
        f" 16 phases"
    )
    print(f"{'cycles / mm':>11} {'measured':>9} {'+-':>7} {'formula':>8}")
    for wanted in np.arange(0.1, 1.05, 0.1):
        k = int(np.argmin(np.abs(frequencies - 1e3 * wanted)))
        print(f"{1e-3 * frequencies[k]:11.3f} {measured[k]:9.4f} {error[k]:7.4f} {formula[k]:8.4f}")

    half = 1e-3 * np.mean(halves)
    half_error = 1e-3 * np.std(halves, ddof=1) / np.sqrt(runs)
    print(
        f"MTF50: measured {half:.4f} +- {half_error:.4f} cycles / mm, by formula"
        f" {1e-3 * at_half(frequencies, formula):.4f}; largest difference in contrast up to there"
        f" {np.abs(measured - formula)[counts].max():.4f}"
    )


# How bright it is


def traced_shares(rig: Rig, angle: float, n: int, seed: int) -> dict[str, tuple[float, float]]:
    """Mean share of light of each class, and its standard error,
    of n rays that come to the plate at an angle, rad.
    """
    plan = make_plan(rig, replace(NO_GLASS, brightness=True))
    (mirrors,) = plan.arrays
    ahead = np.sin(angle) * mirrors.axes[1] + np.cos(angle) * mirrors.axes[2]
    places = (
        mirrors.centre + np.random.default_rng(seed).uniform(-0.1, 0.1, (n, 2)) @ mirrors.axes[:2]
    )
    landings = trace_all(
        plan, places - 0.05 * ahead, np.broadcast_to(ahead, places.shape), light="folded"
    )
    found = {}
    for name, paths in CLASSES.items():
        shares = landings.throughput * np.isin(landings.plate_path, paths)
        found[name] = float(shares.mean()), float(shares.std() / np.sqrt(n))

    return found


def shares_by_formula(array: MirrorArray, angles: Floats) -> dict[str, Floats]:
    """Share (n,) of light of each class at angles (n,), rad."""
    found = light_by_angle(array, angles)
    return {name: sum(found[path] for path in paths) for name, paths in CLASSES.items()}


def print_brightness(rig: Rig, n: int) -> None:
    """Shares of light by angle: by formula and by rays, and by geometry alone beside
    what is told.
    """
    array = PRESETS["ASKA3D-488"]
    rig = with_mirrors(rig, array)
    print(
        f"\nLuminance against angle, of a white display's: reflectance {array.reflectance:g},"
        f" Fresnel, {n:g} rays"
    )
    print(f"{'degrees':>7} " + " ".join(f"{name:>9} {'by rays':>18}" for name in CLASSES))
    formula = shares_by_formula(array, np.radians(ANGLES))

    for k, angle in enumerate(ANGLES):
        traced = traced_shares(rig, np.radians(angle), n, k)
        cells = (
            f"{formula[name][k]:9.4f} {traced[name][0]:7.4f} +- {traced[name][1]:.5f}"
            for name in CLASSES
        )
        print(f"{angle:7.1f} " + " ".join(cells))

    print("\nBy geometry alone (reflectance 1, no Fresnel)")
    print(f"{'degrees':>7} " + " ".join(f"{name:>9} {'told':>6}" for name in CLASSES))
    angles = np.union1d(ANGLES, list(TOLD))
    formula = shares_by_formula(
        replace(array, reflectance=1.0, has_fresnel=False), np.radians(angles)
    )

    for k, angle in enumerate(angles):
        told = [f"{share:.3f}" for share in TOLD[angle]] if angle in TOLD else [""] * len(CLASSES)
        cells = (
            f"{formula[name][k]:9.4f} {word:>6}" for name, word in zip(CLASSES, told, strict=True)
        )
        print(f"{angle:7.1f} " + " ".join(cells).rstrip())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--pixels", type=int, default=800, help="of the viewers who match dots, a side (800)"
    )
    parser.add_argument("--samples", type=int, default=16, help="of Cycles, a pixel (16)")
    parser.add_argument("--runs", type=int, default=4, help="of the tilted edge (4)")
    parser.add_argument("--rays", type=int, default=100_000, help="for each angle (100000)")
    arguments = parser.parse_args()
    rig = print_distances(arguments.pixels, arguments.samples)
    print_sharpness(rig, arguments.runs)
    print_brightness(rig, arguments.rays)
    kiriko.unregister()


if __name__ == "__main__":
    main()
