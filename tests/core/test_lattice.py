"""Lattices in photographs whose points are known, rendered by other code than draws the lattice."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.errors import ImageError
from kiriko.core.lab.calibrate.drawn import Lattice
from kiriko.core.lab.calibrate.file import check, check_way, read_points
from kiriko.core.lab.calibrate.match import match
from kiriko.core.lab.calibrate.misalignment import Bench
from kiriko.core.lab.calibrate.photograph import find_points
from kiriko.core.rig.rig import MirrorArray
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.solution import without_glass
from known.reference_rigs import ball_rig, cube_rig, rig, wavy_slab
from known.work import solve

SEVEN = Lattice(7, 7, 1 / 14)
N = np.arange(49)
GRID = np.stack([N % 7 - 3, N // 7 - 3], axis=1) / 3.0  # of the photographs, -1..1


# Photographs: a map from their pixels to the lattice says which are bright


def bent(size, turn=0.0, scale=1.0, perspective=0.0, bend=0.0, shift=(0, 0)):
    """Map from px (n, 2) to the lattice's -1..1."""
    middle = np.array(size) / 2 + shift
    half = 0.35 * min(size) * scale

    def to_lattice(xy):
        x, y = ((xy - middle) / half).T
        x, y = np.cos(turn) * x + np.sin(turn) * y, np.cos(turn) * y - np.sin(turn) * x
        z = 1 + perspective * (x + 0.5 * y)
        x, y = x / z, y / z
        return np.stack(
            [x + bend * (np.sin(2 * y + 0.3) - x * x), y + bend * (np.cos(2.2 * x) - 1)], axis=1
        )

    return to_lattice


def seen_at(to_lattice, size, wanted=GRID):
    """Where places of the lattice are seen, by Newton's method from the nearest of many pixels."""
    y, x = np.mgrid[0 : size[1] : 8, 0 : size[0] : 8]
    pixels = np.stack([x.ravel(), y.ravel()], axis=1).astype(float)
    there = to_lattice(pixels)
    at = np.array([pixels[((there - place) ** 2).sum(axis=1).argmin()] for place in wanted])
    for _ in range(30):
        j = np.stack(
            [(to_lattice(at + d) - to_lattice(at - d)) / 0.02 for d in ([0.01, 0], [0, 0.01])],
            axis=2,
        )
        at = at + np.linalg.solve(j, (wanted - to_lattice(at))[..., None])[..., 0]
    assert np.abs(to_lattice(at) - wanted).max() < 1e-9
    return at


def photographed(to_lattice, size, radius=0.2, style="dots", level=None, sub=4):
    """Light (h, w) of the lattice: radius of dots or half width
    of lines in spacings, level (49,) of each dot.
    """
    level = np.ones(49) if level is None else level
    y, x = np.mgrid[: size[1], : size[0]]
    light = np.zeros(x.size)
    for dy, dx in np.ndindex(sub, sub):
        u, v = (
            to_lattice(
                np.stack([x.ravel() + (dx + 0.5) / sub, y.ravel() + (dy + 0.5) / sub], axis=1)
            )
            * 3
            + 3
        ).T
        i = np.rint(u).clip(0, 6)
        j = np.rint(v).clip(0, 6)
        if style == "dots":
            light += (np.hypot(u - i, v - j) < radius) * level[(7 * j + i).astype(int)]
        else:
            is_inside = np.maximum(np.abs(u - 3), np.abs(v - 3)) < 3.5
            light += (np.minimum(np.abs(u - i), np.abs(v - j)) < radius) & is_inside

    return light.reshape(size[1], size[0]) / sub**2


def blurred(image, sigma):
    fy = np.fft.fftfreq(image.shape[0])[:, None]
    fx = np.fft.rfftfreq(image.shape[1])
    return np.fft.irfft2(
        np.fft.rfft2(image) * np.exp(-2 * (np.pi * sigma) ** 2 * (fx**2 + fy**2)), image.shape
    )


def as_jpeg(image, step=4):
    """8 bits, after the cosines of 8 x 8 blocks have been rounded, the finer ones coarser."""
    h, w = (n // 8 for n in image.shape)
    k = np.arange(8)
    cosines = np.cos(np.pi * (k + 0.5) * k[:, None] / 8) * np.where(k, 0.5, 8**-0.5)[:, None]
    blocks = 255 * image[: 8 * h, : 8 * w].reshape(h, 8, w, 8).transpose(0, 2, 1, 3)
    steps = step * (1 + 0.6 * (k + k[:, None]))
    blocks = cosines.T @ (np.rint(cosines @ blocks @ cosines.T / steps) * steps) @ cosines
    return np.clip(np.rint(blocks.transpose(0, 2, 1, 3).reshape(8 * h, 8 * w)), 0, 255).astype(
        np.uint8
    )


def surroundings(size, random, n_streaks=2, n_blobs=3, n_specks=40):
    """A bright gradient, reflections of edges and lamps, dust."""
    w, h = size
    y, x = np.mgrid[:h, :w] + 0.5
    light = 0.12 + 0.15 * x / w + 0.1 * (y / h) ** 2
    for _ in range(n_streaks):
        a = random.uniform(0, np.pi)
        p = random.uniform(0, size)
        across = (x - p[0]) * np.sin(a) - (y - p[1]) * np.cos(a)
        light += random.uniform(0.2, 0.8) * np.exp(-((across / random.uniform(1, 4)) ** 2))

    for _ in range(n_blobs):
        p = random.uniform(0, size)
        r = random.uniform(0.06, 0.12) * min(size)
        light += random.uniform(0.2, 0.6) * np.exp(-((np.hypot(x - p[0], y - p[1]) / r) ** 4))

    for _ in range(n_specks):
        p = random.uniform(0, size)
        r = random.uniform(0.5, 2.5)
        light += random.uniform(0.2, 1) * (np.hypot(x - p[0], y - p[1]) < r)

    return light


def rms(off):
    return np.sqrt(np.nanmean(off**2))


# Drawn


@pytest.mark.parametrize(
    ("columns", "rows", "size"), [(7, 7, (530, 411)), (5, 3, (530, 371)), (2, 4, (201, 400))]
)
@pytest.mark.parametrize("style", ["dots", "grid"])
def test_what_is_drawn_is_found(columns, rows, size, style):
    """Points stand where uv says, also the larger dots that tell how it is turned.

    Sharp lines to 0.15 px.
    """
    lattice = Lattice(columns, rows, 0.5 / min(columns, rows))
    image = lattice.image(*size, style)
    assert image.shape == (size[1], size[0], 3)
    assert image.dtype == np.float32
    assert (image.min(), image.max()) == (0, 1)
    at = np.stack([lattice.uv[:, 0], 1 - lattice.uv[:, 1]], axis=1) * size
    assert at[1, 0] > at[0, 0]
    assert at[columns, 1] > at[0, 1]
    found = match(find_points(image), at, lattice)
    assert np.abs(found - at).max() < (0.02 if style == "dots" else 0.15)
    for turned in (image[::-1], image[::-1, ::-1], *([image[:, ::-1]] if columns > 2 else [])):
        assert np.abs(turned - image).max() > 0.9


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Lattice(1, 7, 0.1), "Set 2 or more"),
        (lambda: Lattice(7, 7, 0.5), "margin of 0.5"),
        (lambda: Lattice(7, 7, float("nan")), "margin of nan"),
        (lambda: SEVEN.image(30, 30), "do not fit into 30 x 30"),
        (lambda: Lattice(7, 7, 0.01).image(500, 500), "would cut the outer points"),
    ],
)
def test_what_cannot_be_drawn_is_said(make, words):
    with pytest.raises(ImageError, match=words):
        make()


# Found


@pytest.mark.parametrize("style", ["dots", "grid"])
def test_points_are_found_to_a_part_of_a_pixel(style):
    """With 1 % of noise and dots of 15 px: 0.1 px rms is asked for, crossings 0.2.

    A fifth of that is kept.
    """
    size = 340, 330
    to_lattice = bent(size, turn=0.2, perspective=0.03)
    true = seen_at(to_lattice, size)
    image = photographed(to_lattice, size, 0.2 if style == "dots" else 0.05, style, sub=6)
    image = blurred(image, 0.7) + np.random.default_rng(1).normal(0, 0.01, image.shape)
    found = match(find_points(image), true, SEVEN)
    assert np.isfinite(found).all()
    assert rms(found - true) < (0.03 if style == "dots" else 0.05)


@pytest.mark.parametrize(("spacing", "radius"), [(14, 0.18), (40, 0.2), (110, 0.27)])
def test_dots_of_5_to_60_pixels_are_found(spacing, radius):
    size = (8 * spacing + 3, 8 * spacing)
    to_lattice = bent(size, scale=3 * spacing / (0.35 * min(size)), turn=0.1)
    true = seen_at(to_lattice, size)
    image = 0.1 + 0.6 * photographed(to_lattice, size, radius, sub=8 if spacing < 100 else 3)
    image += np.random.default_rng(0).normal(0, 0.01, image.shape)
    found = match(find_points(image), true, SEVEN)
    assert np.isfinite(found).all()
    assert rms(found - true) < 0.05


@pytest.mark.parametrize("style", ["dots", "grid"])
@pytest.mark.parametrize("seed", range(2))
def test_a_bad_photograph_will_do(style, seed):
    """Bent, turned, in perspective, dim at the rim, 0.2 to 1
    bright, with reflections, dust, noise, as JPEG.

    No point is taken for another; half of them are as good as
    the noise lets them be, those on a reflection less.
    """
    size = 560, 500
    random = np.random.default_rng(seed)
    turn, scale, perspective, bend = random.uniform([-0.7, 0.75, -0.1, -0.1], [0.7, 1.0, 0.1, 0.1])
    to_lattice = bent(size, turn, scale, perspective, bend)
    true = seen_at(to_lattice, size)
    image = photographed(
        to_lattice,
        size,
        0.15 if style == "dots" else 0.04,
        style,
        random.uniform(0.2, 1, 49),
        sub=2,
    )
    y, x = np.mgrid[: size[1], : size[0]]
    image *= 1 - 0.6 * ((x / size[0] - 0.5) ** 2 + (y / size[1] - 0.5) ** 2)
    image = blurred(image + surroundings(size, random), 1.0) + random.normal(0, 0.02, image.shape)
    planned = GRID * 0.3 * size[1] + np.array(size) / 2 + [20, -10]
    found = match(find_points(as_jpeg(np.clip(image, 0, 1))), planned, SEVEN)
    off = np.linalg.norm(found - true, axis=1)

    assert np.isfinite(off).sum() >= 36
    assert np.nanmax(off) < 8  # a tenth of a spacing
    assert np.nanmedian(off) < 0.3


def test_what_is_dark_is_missing():
    """A lattice of which two columns and a corner are dark: the others are found, and
    told apart.
    """
    size = 400, 400
    to_lattice = bent(size)
    true = seen_at(to_lattice, size)
    is_dark = (N % 7 < 2) | (N >= 47)
    image = photographed(to_lattice, size, level=np.where(is_dark, 0.0, 1.0))
    found = match(find_points(image), true + 4.0, SEVEN)
    assert np.array_equal(np.isnan(found).all(axis=1), is_dark)
    assert np.abs(found - true)[~is_dark].max() < 0.1


def patches(random, size=(400, 450), n=300):
    y, x = np.mgrid[: size[0], : size[1]]
    image = np.zeros(size)
    for _ in range(n):
        px, py = random.uniform(0, size[::-1])
        r = random.choice([3, 5, 8, 14, 25])
        image += random.uniform(-0.4, 0.5) * np.exp(-((x - px) ** 2 + (y - py) ** 2) / (2 * r * r))
    return image


@pytest.mark.parametrize(
    "make",
    [
        lambda random: np.zeros((300, 300)),
        lambda random: np.full((300, 300, 3), 255, np.uint8),
        lambda random: random.normal(0.5, 0.1, (400, 500)),
        lambda random: random.integers(0, 255, (400, 500, 3)).astype(np.uint8),
        lambda random: blurred(random.normal(0.5, 1, (400, 500)), 3),
        lambda random: (blurred(random.normal(0, 1, (400, 500)), 3) > 0.17) * 1.0,
        lambda random: patches(random),
        lambda random: surroundings((500, 400), random, n_specks=100),
        lambda random: np.full((300, 300), np.nan),
    ],
)
def test_a_photograph_without_a_lattice_is_refused(make):
    with pytest.raises(ImageError, match="No lattice of bright dots or crossing lines was found"):
        find_points(make(np.random.default_rng(0)))


# Told apart


@pytest.mark.parametrize("seed", range(25))
def test_points_are_told_apart(seed):
    """Shuffled, shifted, scaled, turned and bent, some inner
    ones missing, a few extra: each keeps its number.
    """
    random = np.random.default_rng(seed)
    scale, turn, bend, perspective = random.uniform([0.5, -0.7, -0.1, -0.1], [2.0, 0.7, 0.1, 0.1])
    size = 900, 900
    true = seen_at(
        bent(size, turn, scale, perspective, bend, shift=random.uniform(-300, 300, 2)), (900, 900)
    )
    points = true + random.normal(0, 0.5, true.shape)
    inner = np.flatnonzero((N % 7 % 6 > 0) & (N // 7 % 6 > 0))
    missing = random.choice(inner, 5, replace=False)
    kept = np.delete(points, missing, axis=0)
    low = kept.min(axis=0)
    high = kept.max(axis=0)
    extra = random.uniform(low - 100, high + 100, (3, 2))
    far = np.linalg.norm(extra[:, None] - true, axis=2).min(axis=1) > 0.4 * scale * 105
    found = match(random.permutation(np.concatenate([kept, extra[far]])), GRID * 315 + 450, SEVEN)

    assert np.isfinite(found).all(axis=1).sum() >= 42
    off = np.linalg.norm(found - points, axis=1)
    assert not np.nanmax(off) > 0


def test_what_cannot_be_told_apart_is_said():
    random = np.random.default_rng(0)
    turn = np.array([[1, 1], [-1, 1]]) * 0.5**0.5
    with pytest.raises(ImageError, match="rotated by about 45 degrees"):
        match(GRID * 300 @ turn, GRID * 300, SEVEN)
    with pytest.raises(ImageError, match="do not fit the lattice of 3 x 3"):
        match(GRID * 300, GRID[:9] * 300, Lattice(3, 3, 0.1))
    with pytest.raises(ImageError, match="do not form the lattice"):
        match(GRID[:3] * 300, GRID * 300, SEVEN)
    with pytest.raises(ImageError, match="sees too little of the lattice"):
        match(GRID * 300, GRID * np.nan, SEVEN)
    with pytest.raises(ImageError):
        match(random.uniform(-300, 300, (49, 2)), GRID * 300, SEVEN)


# Read


def written(tmp_path, text, encoding="utf-8"):
    path = tmp_path / "points.csv"
    path.write_bytes(text.encode(encoding))
    return path


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_a_file_says_which_point_is_which(tmp_path, delimiter):
    """In any order, columns too, with a byte order mark,
    blank lines, blanks for points that were not measured.
    """
    lines = ["y,Row,x,column", "10.5,1,20,2", "", "1e2,3,7.25,7", ",2,,2"]
    path = written(tmp_path, "\r\n".join(lines).replace(",", delimiter), "utf-8-sig")
    found = read_points(path, SEVEN, GRID)
    assert found[1].tolist() == [20, 10.5]
    assert found[20].tolist() == [7.25, 100]
    assert np.isfinite(found).all(axis=1).sum() == 2


def test_a_file_of_places_alone_is_matched(tmp_path):
    at = np.random.default_rng(0).permutation(GRID * 300 + [30, 10])
    lines = ["x;y", *(f"{x:.3f};{y:.3f}".replace(".", ",") for x, y in at)]
    found = read_points(written(tmp_path, "\n".join(lines)), SEVEN, GRID * 300)
    assert np.abs(found - GRID * 300 - [30, 10]).max() < 1e-3


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "has no header"),
        ("1,2\n3,4", "has no header"),
        ("column,x,y\n1,2,3", "has no header"),
        ("x,y\n", "has no points"),
        ("column,row,x,y\n1,1,,", "has no points"),
        ('x,y\n1,"2', "not a valid CSV file. Correct line 2"),
        ("x,y\n1,2\n3", "Line 3 of .* has 1 of 2 columns"),
        ("x,y\n1,two", "Line 2 of .* has 'two' instead of a number"),
        ("x,y\nnan,2", "Line 2 of .* has 'nan' instead of a number"),
        ("x,y\n1,inf", "Line 2 of .* has 'inf' instead of a number"),
        (
            "column,row,x,y\n0,1,5,5",
            r"Line 2 of .* has a point \(0, 1\), but columns run from 1 to 7",
        ),
        (
            "column,row,x,y\n1,8,5,5",
            r"Line 2 of .* has a point \(1, 8\), but columns run from 1 to 7",
        ),
        ("column,row,x,y\n1.5,1,5,5", r"Line 2 of .* has a point \(1.5, 1\)"),
        (
            "column,row,x,y\n1,2,5,5\n\n1,2,6,6",
            r"Line 4 of .* repeats the point \(1, 2\) of line 2",
        ),
    ],
)
def test_what_is_wrong_in_a_file_is_said(tmp_path, text, words):
    with pytest.raises(ImageError, match=words):
        read_points(written(tmp_path, text), SEVEN, GRID)


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(ImageError, match="cannot be read"):
        read_points(tmp_path / "none.csv", SEVEN, GRID)
    (tmp_path / "binary.csv").write_bytes(bytes(range(256)))
    with pytest.raises(ImageError, match="not a text file"):
        read_points(tmp_path / "binary.csv", SEVEN, GRID)


@pytest.mark.parametrize(
    "data",
    [
        b"sep=;\r\ncolumn;row;x;y\r\n2;3;1,5;2,5\r\n",
        "column\trow\tx\ty\n2\t3\t1.5\t2.5\n".encode("utf-16"),
        "note,column,row,x,y\nS\xe4ule,2,3,1.5,2.5\n".encode("latin-1"),
    ],
    ids=["spreadsheet", "utf-16", "latin-1"],
)
def test_files_of_spreadsheets_are_read(tmp_path, data):
    (tmp_path / "points.csv").write_bytes(data)
    found = read_points(tmp_path / "points.csv", SEVEN, GRID)
    assert found[2 * 7 + 1].tolist() == [1.5, 2.5]
    assert np.isnan(found).sum() == 2 * 48


def test_mirrored_and_turned_numbers_are_refused():
    for way in (np.diag([-1.0, 1]), np.diag([1.0, -1]), -np.eye(2), np.array([[0.0, 1], [1, 0]])):
        with pytest.raises(ImageError, match="mirrored or rotated"):
            check_way(GRID @ way.T, GRID)
    turn = np.radians(30)
    check_way(
        1.7 * GRID @ np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) + 300,
        GRID,
    )


# On the bench


def lattice_bench(a_rig, **settings):
    """The rig with the lattice, 30 mm wide from border to border, as its picture."""
    a_rig = replace(a_rig, plates=(replace(a_rig.plates[0], array=MirrorArray()),))
    u, v = SEVEN.uv.T - 0.5
    return Bench(
        a_rig, Settings(**settings), a_rig.viewer.project(0.03 * np.stack([u, 0 * u, v], axis=1))
    )


@pytest.mark.parametrize(
    "make",
    [
        lambda: cube_rig(pixels=1600),
        lambda: ball_rig(4, pixels=1600, display=0.1),
        lambda: rig(wavy_slab(amplitude=0.0002), pixels=1600, display=0.1),
    ],
)
def test_smooth_light_is_no_mistake_and_mistakes_are_named(make):
    """Uncompensated, with parts off by much and 1 px of noise nothing is said.

    Of two swapped points both are named.
    """
    a_rig = make()
    bench = lattice_bench(a_rig)
    random = np.random.default_rng(0)
    plain = lattice_bench(without_glass(a_rig), only_through_glass=False)

    n_checked = 0
    for k in range(4):
        amounts = random.normal(0, 0.3, len(bench.parameters)) * [
            p.unit in ("mm", "deg") for p in bench.parameters
        ]
        display = bench.display if k % 2 else plain.display
        seen = bench.seen(amounts, display=display)
        if np.isfinite(seen).all(axis=1).sum() < 20:
            continue
        n_checked += 1
        seen += random.normal(0, 1, seen.shape)
        check(seen, SEVEN)
        one, other = random.choice(np.flatnonzero(np.isfinite(seen[:, 0])), 2, replace=False)
        if k % 2:  # the compensated picture is straight: nothing else can be meant
            wrong = seen.copy()
            wrong[[one, other]] = seen[[other, one]]
            names = sorted([one, other])
            with pytest.raises(ImageError) as said:
                check(wrong, SEVEN)
            assert f"{SEVEN.name(names[0])} and {SEVEN.name(names[1])} seem swapped" in str(
                said.value
            )
            wrong = seen.copy()
            wrong[one] += [80, -30]
            with pytest.raises(ImageError, match="pixels from its expected position") as said:
                check(wrong, SEVEN)
            assert SEVEN.name(one) in str(said.value)

    assert n_checked >= 3


def test_points_of_another_lattice_are_refused():
    with pytest.raises(ImageError, match="lattice of 7 x 7 in this order"):
        check(np.random.default_rng(0).permutation(GRID) * 300, SEVEN)
    check(np.where((N < 3)[:, None], GRID, np.nan), SEVEN)


def test_a_lattice_seen_through_the_cube_is_measured():
    """The drawn lattice, solved for, seen by core and found
    in the image: where Bench has it, to 0.1 px.
    """
    image = np.concatenate([SEVEN.image(1024, 1024), np.ones((1024, 1024, 1), np.float32)], axis=2)
    a_rig = cube_rig(pixels=400, image=image)
    u, v = SEVEN.uv.T - 0.5
    bench = Bench(a_rig, Settings(), a_rig.viewer.project(0.03 * np.stack([u, 0 * u, v], axis=1)))
    plain = solve(without_glass(a_rig), only_through_glass=False)
    solution = solve(a_rig)
    straight = Bench(without_glass(a_rig), Settings(only_through_glass=False), bench.view).display

    for source, display in ((solution.source, bench.display), (plain.source, straight)):
        true = bench.seen(np.zeros(len(bench.parameters)), display=display)
        found = match(find_points(solution.seen(source)), bench.view, SEVEN)
        assert np.isfinite(true).all()
        assert np.isfinite(found).all()
        assert np.linalg.norm(found - true, axis=1).max() < 0.1
