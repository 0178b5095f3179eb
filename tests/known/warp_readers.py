"""What other programs make of warp maps, written anew from their own documents: the judges
of the files that Kiriko writes.

Images are (h, w, c), row 0 at the top. Pixels that a map leaves out are NaN.
"""

import numpy as np


def sampled(picture, st):
    """An STMap as Nuke reads one, bilinear: (s, t) from the lower left, pixel centres at + 0.5."""
    h, w = picture.shape[:2]
    return bilinear(picture, st[..., 0] * w - 0.5, (1 - st[..., 1]) * h - 0.5)


def bilinear(picture, x, y):
    """As cv2.remap reads maps with INTER_LINEAR: whole numbers are the middles of pixels."""
    h, w = picture.shape[:2]
    is_there = (x > -1) & (x < w) & (y > -1) & (y < h)
    x = np.clip(np.where(is_there, x, 0), 0, w - 1)
    y = np.clip(np.where(is_there, y, 0), 0, h - 1)
    i = np.minimum(x.astype(int), max(w - 2, 0))
    j = np.minimum(y.astype(int), max(h - 2, 0))
    a = (x - i)[..., None]
    b = (y - j)[..., None]
    right = np.minimum(i + 1, w - 1)
    below = np.minimum(j + 1, h - 1)
    upper = (1 - a) * picture[j, i] + a * picture[j, right]
    lower = (1 - a) * picture[below, i] + a * picture[below, right]
    return np.where(is_there[..., None], (1 - b) * upper + b * lower, np.nan)


def pgm(path):
    """A plain grey map (h, w) of 16 bits, the high byte first, as netpbm defines it."""
    data = path.read_bytes()
    fields = data.split(maxsplit=4)
    assert fields[0] == b"P5"
    width, height, top = (int(field) for field in fields[1:4])
    assert top == 65535
    assert len(data) >= 2 * width * height
    return np.frombuffer(data[len(data) - 2 * width * height :], ">u2").reshape(height, width)


def remapped(picture, x, y, times):
    """ffmpeg's chain: the picture made larger (bilinear here), the nearest pixel, the mean."""
    h, w = picture.shape[:2]
    larger = bilinear(
        picture,
        *np.meshgrid(
            (np.arange(w * times) + 0.5) / times - 0.5, (np.arange(h * times) + 0.5) / times - 0.5
        ),
    )
    is_there = (x < w * times) & (y < h * times)
    out = np.where(
        is_there[..., None], larger[np.where(is_there, y, 0), np.where(is_there, x, 0)], np.nan
    )
    rows, columns = out.shape[0] // times, out.shape[1] // times
    return out.reshape(rows, times, columns, times, -1).mean(axis=(1, 3))


def obj(path):
    """Triangles of an OBJ: places (n, 3, 2) and UV (n, 3, 2)."""
    v, vt, faces = [], [], []
    for line in path.read_text().splitlines():
        kind, *rest = line.split() or [""]
        if kind == "v":
            v.append([float(x) for x in rest])
        elif kind == "vt":
            vt.append([float(x) for x in rest])
        elif kind == "f":
            faces.append([[int(k) - 1 for k in corner.split("/")] for corner in rest])
    faces = np.array(faces, int).reshape(-1, 4, 2)
    triangles = np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])
    places = np.array(v, float).reshape(-1, 3)
    assert (places[:, 2] == 0).all()
    return places[triangles[..., 0], :2], np.array(vt, float).reshape(-1, 2)[triangles[..., 1]]


def data(path):
    """Triangles of Paul Bourke's planar .data, likewise: of cells all of whose nodes are drawn."""
    kind, size, *lines = path.read_text().splitlines()
    assert kind == "2"
    columns, rows = map(int, size.split())
    nodes = np.array([[float(x) for x in line.split()] for line in lines])
    nodes = nodes.reshape(rows, columns, 5)
    corners = [nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, 1:], nodes[1:, :-1]]
    cells = np.stack(corners, axis=2).reshape(-1, 4, 5)
    cells = cells[(cells[..., 4] >= 0).all(axis=1)]
    triangles = np.concatenate([cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]])
    return triangles[..., :2], triangles[..., 2:4]


def drawn(picture, places, uv, size):
    """A mesh drawn as a graphics card does, seen by an orthographic camera over y from -1 to 1:
    an image (h, w, c) of a size, the picture on it read bilinearly.
    """
    width, height = size
    xy = np.stack(
        [(places[..., 0] * height / width + 1) / 2 * width, (1 - places[..., 1]) / 2 * height], -1
    )
    st = np.full((height, width, 2), np.nan)
    for corners, of_corners in zip(xy, uv, strict=True):
        low = np.maximum(np.ceil(corners.min(axis=0) - 0.5 - 1e-9), 0).astype(int)
        high = np.minimum(np.floor(corners.max(axis=0) - 0.5 + 1e-9), (width - 1, height - 1))
        columns = np.arange(low[0], int(high[0]) + 1)
        rows = np.arange(low[1], int(high[1]) + 1)
        if not len(columns) or not len(rows):
            continue
        x, y = np.meshgrid(columns + 0.5, rows + 0.5)
        (ax, ay), (bx, by) = corners[1:] - corners[0]
        det = ax * by - ay * bx
        u = ((x - corners[0, 0]) * by - (y - corners[0, 1]) * bx) / det
        v = ((y - corners[0, 1]) * ax - (x - corners[0, 0]) * ay) / det
        inside = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9)
        value = (
            of_corners[0]
            + u[..., None] * (of_corners[1] - of_corners[0])
            + v[..., None] * (of_corners[2] - of_corners[0])
        )
        st[rows[:, None], columns] = np.where(inside[..., None], value, st[rows[:, None], columns])
    return sampled(picture, np.nan_to_num(st, nan=-1e3))


def ramp(width, height):
    """A picture (h, w, 4) whose red and green are the places of its pixels, px from the upper
    left: the colour that a map fetches tells the place that it fetched.
    """
    picture = np.ones((height, width, 4), np.float32)
    picture[..., 0] = np.arange(width) + 0.5
    picture[..., 1] = np.arange(height)[:, None] + 0.5
    picture[..., 2] = 0
    return picture
