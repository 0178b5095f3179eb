"""Scores source images and maps of kiriko-bench: `python score.py FOLDER`. Needs numpy only.

FOLDER has a source image `<rig>.npy`, (512, 512, 3) floats, linear, row 0 at the top; or a map
`<rig>.map.npy`, (h, w, 2), the display pixel (x, y) shown at the centre of each pixel of a viewer's
image of any resolution, NaN without one. Rigs without a file are left out.
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
SIDE = 192  # samples along each side of the viewer's image
RINGS = 24  # of the picture, each colour
FADE = 0.1  # of its side, along its border
# steps of an even sequence in a square: inverse powers of the plastic number
STEPS = np.array([0.7548776662466927, 0.5698402909980532])


def samples(size):
    """Places (192 * 192, 2), viewer px, of the reference landings: one in each of 192 x 192 equal
    blocks of the viewer's image, row by row.
    """
    n = np.arange(SIDE * SIDE)
    block = np.stack([n % SIDE, n // SIDE], axis=1)
    return (block + (n[:, None] * STEPS) % 1) * np.array(size) / SIDE


def picture():
    """The picture (1024, 1024, 3), linear: rings in each colour that get finer outward, and fade to
    black at the border, or its jump would be most of the error.
    """
    y, x = (np.mgrid[:1024, :1024] + 0.5) / 1024 - 0.5
    phase = np.pi * RINGS * (x * x + y * y)
    inward = np.clip((0.5 - np.maximum(abs(x), abs(y))) / FADE, 0, 1)
    fade = inward * inward * (3 - 2 * inward)
    return np.stack([fade * (0.5 + 0.5 * np.cos(phase + shift)) for shift in (0, 2, 4)], axis=2)


def names():
    """Names of the rigs."""
    return sorted(path.name for path in (HERE / "rigs").iterdir())


def numbers(name):
    """A rig without its mesh."""
    return json.loads((HERE / "rigs" / name / "rig.json").read_text(encoding="utf-8"))


def load(name):
    """A rig, and its reference landings (192 * 192, 2), display px, NaN for none."""
    return numbers(name), np.load(HERE / "rigs" / name / "landings.npy")


def ideal(rig):
    """The picture without glass at the samples, (192 * 192, 3), linear; black beside it."""
    viewer = rig["viewer"]
    left, right, bottom, top = viewer["window"]
    x, y = (samples(viewer["pixels"]) / viewer["pixels"]).T
    across = np.stack([left + (right - left) * x, top + (bottom - top) * y, np.ones_like(x)], 1)
    directions = across @ np.array(viewer["axes"])
    corner, u, v = plane(rig["picture"]["corners"])
    normal = np.cross(u, v)
    t = ((corner - viewer["position"]) @ normal) / (directions @ normal)
    at = viewer["position"] + t[:, None] * directions - corner
    return lookup(picture(), at @ u / (u @ u), 1 - at @ v / (v @ v))


def plane(corners):
    """Lower left corner of a rectangle, and its sides to the right and up."""
    corner, lower_right, _, upper_left = np.array(corners)
    return corner, lower_right - corner, upper_left - corner


def lookup(image, x, y):
    """Bilinear values (n, 3) of an image (h, w, 3) at x, y in 0..1, right and down; black outside
    of it.
    """
    height, width = image.shape[:2]
    is_inside = (x >= 0) & (x <= 1) & (y >= 0) & (y <= 1)  # and no NaN
    column, row = np.where(is_inside, x, 0) * width - 0.5, np.where(is_inside, y, 0) * height - 0.5
    at_left, at_top = np.floor(column).astype(int), np.floor(row).astype(int)
    found = np.zeros((len(x), 3))
    for dy in (0, 1):
        for dx in (0, 1):
            weight = np.abs(1 - dx - (column - at_left)) * np.abs(1 - dy - (row - at_top))
            rows = np.clip(at_top + dy, 0, height - 1)
            found += weight[:, None] * image[rows, np.clip(at_left + dx, 0, width - 1)]
    return found * is_inside[:, None]


def seen(rig, landings, source):
    """A source image (H, W, 3) at the samples, (192 * 192, 3): bilinear, at each landing."""
    height, width = source.shape[:2]
    return lookup(source, *(landings / [width, height]).T)


def score_image(rig, landings, source):
    """RMSE and PSNR of the seen image over samples with a landing, and SSIM of the whole, in which
    the others are black.
    """
    wanted, found = ideal(rig), seen(rig, landings, np.clip(source[..., :3], 0, 1))
    is_lit = np.isfinite(landings[:, 0])
    rmse = np.sqrt(np.mean((found - wanted)[is_lit] ** 2))
    images = [np.where(is_lit[:, None], one, 0).reshape(SIDE, SIDE, 3) for one in (wanted, found)]
    return {"rmse": rmse, "psnr dB": -20 * np.log10(rmse), "ssim": ssim(*images)}


def score_map(rig, landings, found):
    """Distances of a map from the landings, display px, and the share of light that it misses."""
    height, width = found.shape[:2]
    at = samples(rig["viewer"]["pixels"]) / rig["viewer"]["pixels"] * [width, height] - 0.5
    first = np.clip(np.floor(at).astype(int), 0, [width - 2, height - 2])
    x, y = (at - first).T[..., None]
    column, row = first.T
    lower, upper = (
        found[row + k, column] * (1 - x) + found[row + k, column + 1] * x for k in (1, 0)
    )
    distance = np.linalg.norm(upper * (1 - y) + lower * y - landings, axis=1)
    is_lit = np.isfinite(landings[:, 0])
    both = distance[np.isfinite(distance)]
    both = both if both.size else np.array([np.nan])
    return {
        "median px": np.median(both),
        "95 % px": np.quantile(both, 0.95),
        "within 0.1 px %": 100 * np.mean(both < 0.1),
        "missed %": 100 * np.mean(~np.isfinite(distance[is_lit])),
    }


def ssim(one, other):
    """Mean structural similarity of two images (h, w, 3) with values 0..1 (Wang et al. 2004, doi
    10.1109/TIP.2003.819861), by even windows of 7 x 7 samples, as scikit-image does by default.
    """

    def mean(values):
        sums = np.cumsum(np.cumsum(np.pad(values, ((1, 0), (1, 0), (0, 0))), axis=0), axis=1)
        return (sums[7:, 7:] - sums[:-7, 7:] - sums[7:, :-7] + sums[:-7, :-7]) / 49

    a, b = mean(one), mean(other)
    variance = mean(one**2) - a**2 + mean(other**2) - b**2
    covariance = mean(one * other) - a * b
    c1, c2 = 0.01**2, 0.03**2
    found = (2 * a * b + c1) * (2 * covariance + c2) / ((a**2 + b**2 + c1) * (variance + c2))
    return found.mean()


def read(path, size=None):
    """A source image of some size (width, height), or a map, from a file; exits with the reason why
    it is none.
    """
    try:
        values = np.load(path)
    except (OSError, ValueError):
        sys.exit(f"{path} is no array of numbers: write it with numpy.save.")
    shape = values.shape
    if values.dtype.kind != "f":
        sys.exit(f"{path} has values of type {values.dtype}: write floats, with white as 1.")
    if size and (shape[:2] != tuple(size[::-1]) or shape[2:] not in ((3,), (4,))):
        sys.exit(f"{path} has the shape {shape}: write ({size[1]}, {size[0]}, 3).")
    if size and not np.isfinite(values).all():
        sys.exit(f"{path} has values that are not finite: write numbers.")
    if not size and (len(shape) != 3 or shape[2] != 2 or min(shape) < 2):
        sys.exit(f"{path} has the shape {shape}: write (h, w, 2).")
    return values.astype(float)


def scores(folder):
    """A row of scores for each file of a rig in a folder."""
    for name in names():
        rig, landings = load(name)
        if (file := Path(folder, f"{name}.npy")).exists():
            yield name, score_image(rig, landings, read(file, rig["display"]["pixels"]))
        if (file := Path(folder, f"{name}.map.npy")).exists():
            yield name, score_map(rig, landings, read(file))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder")
    place = parser.parse_args().folder
    rows = list(scores(place))
    if not rows:
        sys.exit(f"{place} is no folder with a file named after a rig: see README.md.")
    for name, row in rows:
        print(f"{name:20}" + "".join(f"  {key} {value:.5f}" for key, value in row.items()))
