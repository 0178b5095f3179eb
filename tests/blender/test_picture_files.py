"""What files of pictures say, and Blender ignores, is applied or reported; those that are no whole
picture are refused.
"""

import sys
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest

from extension import loaded
from known.profiles import COLUMNS, fixed, profile
from small_rigs import small_rig

TALL = np.random.default_rng(2).random((24, 16, 3)).astype(np.float32)  # as a person sees it
# chromaticities of ACEScg, and of Rec.709
AP1 = (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)
REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
SRGB = b"para\0\0\0\0\0\3\0\0" + fixed(2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)
# of each orientation: the stored pixels of those that are seen (Exif 2.32, 4.6.4)
STORED = {
    1: lambda seen: seen,
    2: np.fliplr,
    3: lambda seen: np.rot90(seen, 2),
    4: np.flipud,
    5: lambda seen: seen.swapaxes(0, 1),
    6: lambda seen: np.rot90(seen, 1),
    7: lambda seen: np.rot90(seen.swapaxes(0, 1), 2),
    8: lambda seen: np.rot90(seen, -1),
}


def write(path: Path, found: np.ndarray, kind: str = "uint8", **about: object) -> Path:
    spec = oiio.ImageSpec(*found.shape[1::-1], found.shape[2], kind)
    for name, value in about.items():
        if name == "chromaticities":
            spec.attribute(name, "float[8]", value)
        elif name == "ICCProfile":
            numbers = np.frombuffer(value, np.uint8)
            spec.attribute(name, oiio.TypeDesc(f"uint8[{len(value)}]"), numbers)
        else:
            spec.attribute(name, value)
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec), oiio.geterror()
    assert out.write_image(np.ascontiguousarray(found))
    assert out.close()
    return path


@pytest.fixture
def picture(scene) -> bpy.types.Object:
    return small_rig()["PICTURE"]


@pytest.fixture
def linear(kiriko) -> Callable[[bpy.types.Image], np.ndarray]:
    module = loaded("core.blender.read.scene_picture")
    return lambda image: module.read_pixels(image, "the picture")[..., :3]


def opened(picture: bpy.types.Object, path: Path) -> bpy.types.Image:
    bpy.ops.kiriko.open_picture(filepath=str(path))
    return picture.kiriko.image


@pytest.mark.parametrize("orientation", STORED)
@pytest.mark.parametrize(("name", "kind"), [("p.png", "uint8"), ("p.tif", "uint16")])
def test_open_picture_turns_a_photograph_upright(
    picture, linear, tmp_path, orientation, name, kind
):
    """Its pixels are those of the same picture that is stored upright, also when they are loaded
    anew; unpacking it would not take the place of its file.
    """
    # Blender's own conversion of 16-bit rows depends on how long they are
    off = 1e-4
    wanted = linear(bpy.data.images.load(str(write(tmp_path / f"wanted_{name}", TALL, kind))))
    stored = STORED[orientation](TALL)
    path = write(tmp_path / name, stored, kind, Orientation=orientation)
    image = opened(picture, path)
    assert tuple(image.size) == (16, 24)
    assert np.abs(linear(image) - wanted).max() < off
    image.buffers_free()
    assert np.abs(linear(image) - wanted).max() < off
    assert picture.dimensions.y == pytest.approx(1.5 * picture.dimensions.x)
    if orientation != 1:
        assert bpy.path.abspath(image.filepath) != str(path)
    bpy.ops.kiriko.solve()
    assert "turned" not in bpy.context.scene.kiriko.result.notes


def test_viewers_images_are_turned_upright(picture, kiriko, tmp_path):
    images = loaded("operators.viewer_images")
    path = write(tmp_path / "p.png", STORED[6](TALL), Orientation=6)
    images.open_images(bpy.context.scene, str(path))
    assert tuple(bpy.context.scene.kiriko.picture_image.size) == (16, 24)


def shown() -> bpy.types.Object:
    """The picture, of whichever file is open."""
    return next(one for one in bpy.context.scene.objects if one.kiriko.role == "PICTURE")


def loaded_from(path: Path) -> bpy.types.Image:
    """By Blender itself, as the picture; which the property alone does not turn."""
    shown().kiriko.image = image = bpy.data.images.load(str(path))
    return image


def reopen(path: Path) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))


def choose(image: bpy.types.Image) -> None:
    bpy.context.view_layer.objects.active = shown()
    library = "" if image.library is None else image.library.filepath
    bpy.ops.kiriko.choose_picture(image=image.name, library=library)


def from_disk(path: Path) -> None:
    bpy.ops.kiriko.open_picture(filepath=str(path))


def loaded_before(path: Path) -> None:
    loaded_from(path)
    bpy.ops.kiriko.open_picture(filepath=str(path))


def packed_before(path: Path) -> None:
    image = loaded_from(path)
    image.pack()
    path.unlink()
    choose(image)


def packed_without_a_path(path: Path) -> None:
    """As a script does it, of data that it has."""
    image, data = bpy.data.images.new("p", 1, 1), path.read_bytes()
    image.pack(data=data, data_len=len(data))
    image.source = "FILE"
    choose(image)


def packed_after(path: Path) -> None:
    choose(loaded_from(path))
    bpy.ops.file.pack_all()


def packed_in_a_saved_file(path: Path) -> None:
    image = loaded_from(path)
    image.pack()
    path.unlink()
    reopen(path.with_suffix(".blend"))
    choose(shown().kiriko.image)
    reopen(path.with_suffix(".blend"))


def loaded_anew(path: Path) -> None:
    bpy.ops.kiriko.open_picture(filepath=str(path))
    shown().kiriko.image.reload()
    reopen(path.with_suffix(".blend"))
    shown().kiriko.image.reload()


def linked_in(path: Path) -> None:
    image = loaded_from(path)
    library = path.with_suffix(".blend")
    bpy.data.libraries.write(str(library), {image}, path_remap="RELATIVE_ALL")
    with bpy.data.libraries.load(str(library), link=True) as (_, wanted):
        wanted.images = [image.name]
    choose(wanted.images[0])


WAYS = (
    from_disk,
    loaded_before,
    packed_before,
    packed_without_a_path,
    packed_after,
    packed_in_a_saved_file,
    loaded_anew,
    linked_in,
)


def source() -> np.ndarray:
    bpy.ops.kiriko.solve()
    result = bpy.context.scene.kiriko.result
    assert "Exif orientation" not in result.notes
    found = np.empty(len(result.source.pixels), np.float32)
    result.source.pixels.foreach_get(found)
    return found


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(
    ("name", "kind", "orientation"),
    [*(("p.png", "uint8", k) for k in (1, 2, 3, 5, 6, 8)), ("p.tif", "uint16", 6)],
)
def test_a_photograph_is_solved_as_if_it_were_stored_upright(
    picture, tmp_path, way, name, kind, orientation
):
    from_disk(write(tmp_path / f"upright_{name}", TALL, kind))
    wanted = source()
    way(write(tmp_path / name, STORED[orientation](TALL), kind, Orientation=orientation))
    assert np.abs(source() - wanted).max() < 1 / 255


@pytest.mark.parametrize("orientation", [1, 6])
def test_what_was_turned_and_saved_in_blender_stays(picture, tmp_path, orientation):
    """Blender saves the orientation of a PNG that it loaded as mere text, which turns nothing."""
    path = write(tmp_path / "p.png", STORED[orientation](TALL), Orientation=orientation)
    image = bpy.data.images.load(str(path))
    image.scale(16, 24)
    image.update()
    image.save()
    bpy.data.images.remove(image)
    image = opened(picture, path)
    assert tuple(image.size) == (16, 24)
    assert image.packed_file is None
    bpy.ops.kiriko.solve()
    assert "Exif orientation" not in bpy.context.scene.kiriko.result.notes


def test_choosing_turns_a_copy_of_a_photograph(picture, tmp_path):
    """The image that a scene may show elsewhere stays as it is, and its file is never written to,
    also where the copy is unpacked.
    """
    path = write(tmp_path / "p.jpg", STORED[6](TALL), Orientation=6)
    data = path.read_bytes()
    image = bpy.data.images.load(str(path))
    choose(image)
    assert tuple(image.size) == (24, 16)
    assert image.packed_file is None
    for turned in (picture.kiriko.image, opened(picture, path)):
        turned.unpack(method="WRITE_ORIGINAL")
        assert tuple(turned.size) == (16, 24)
        assert path.read_bytes() == data


@pytest.mark.parametrize("is_packed", [False, True])
def test_a_turned_photograph_that_blender_loaded_is_reported(picture, tmp_path, is_packed):
    """With the buttons that turn it; one that is upright is not."""
    for orientation in (1, 6):
        stored = STORED[orientation](TALL)
        path = write(tmp_path / f"{orientation}.jpg", stored, Orientation=orientation)
        image = loaded_from(path)
        if is_packed:
            image.pack()
            path.unlink()
        bpy.ops.kiriko.solve()
        notes = bpy.context.scene.kiriko.result.notes
        assert ("Exif orientation" in notes) == (orientation == 6)
        assert ("choose it again" in notes) == (orientation == 6)


@pytest.mark.parametrize("orientation", [1, 6])
def test_without_openimageio_a_turned_photograph_is_reported(
    picture, tmp_path, monkeypatch, capfd, orientation
):
    """As it is chosen, and in the result; buttons that cannot turn it are not proposed."""
    path = write(tmp_path / "p.jpg", STORED[orientation](TALL), Orientation=orientation)
    monkeypatch.setitem(sys.modules, "OpenImageIO", None)
    capfd.readouterr()
    opened(picture, path)
    words = ": save it upright."
    assert (words in capfd.readouterr().out) == (orientation == 6)
    bpy.ops.kiriko.solve()
    assert (words in bpy.context.scene.kiriko.result.notes) == (orientation == 6)


@pytest.mark.parametrize("columns", COLUMNS)
@pytest.mark.parametrize(("name", "orientation"), [("p.jpg", 6), ("p.png", 1), ("p.tif", 1)])
def test_a_profile_that_blender_does_not_apply_is_reported(
    picture, tmp_path, capfd, name, columns, orientation
):
    """When the picture is opened, and by the result, also of one that is turned; sRGB's own profile
    is not.
    """
    made = profile(COLUMNS[columns], SRGB)
    stored = STORED[orientation](TALL)
    opened(picture, write(tmp_path / name, stored, ICCProfile=made, Orientation=orientation))
    word, is_other = "the colour profile of ", columns != "sRGB"
    assert (word in capfd.readouterr().out) == is_other
    bpy.ops.kiriko.solve()
    assert (word in bpy.context.scene.kiriko.result.notes) == is_other


@pytest.mark.parametrize("is_alike", [False, True])
def test_colours_of_a_file_that_blender_does_not_apply_are_reported(picture, tmp_path, is_alike):
    """Unless they are those that it takes, by itself or because the artist chose them."""
    path = write(tmp_path / "p.exr", TALL, "float", chromaticities=REC709 if is_alike else AP1)
    image = opened(picture, path)
    bpy.ops.kiriko.solve()
    word = "(chromaticities)"
    assert (word in bpy.context.scene.kiriko.result.notes) == (not is_alike)
    if not is_alike:
        image.colorspace_settings.name = "ACEScg"
        bpy.ops.kiriko.solve()
        assert word not in bpy.context.scene.kiriko.result.notes


def cut(path: Path, part: float) -> Path:
    data = path.read_bytes()
    path.write_bytes(data[: int(part * len(data))])
    return path


CUT = [
    (name, kind, part)
    for name, kind in (
        ("p.png", "uint8"),
        ("p.png", "uint16"),
        ("p.jpg", "uint8"),
        ("p.tif", "uint8"),
        ("p.tif", "uint16"),
        ("p.exr", "half"),
        ("p.hdr", "float"),
        ("p.webp", "uint8"),
    )
    for part in (0.02, 0.99)
]


@pytest.mark.parametrize(("name", "kind", "part"), CUT)
def test_a_picture_that_is_cut_off_is_refused(picture, tmp_path, name, kind, part):
    """By Open Picture, and by Solve where Blender loaded it or its file was cut since."""
    noise = np.random.default_rng(4).random((256, 256, 3)).astype(np.float32)
    path = write(tmp_path / name, noise, kind)
    before = picture.kiriko.image, len(bpy.data.images)
    whole = path.read_bytes()
    cut(path, part)
    words = r"is incomplete|is missing or broken"
    with pytest.raises(RuntimeError, match=words) as caught:
        bpy.ops.kiriko.open_picture(filepath=str(path))
    assert path.name in str(caught.value)
    assert (picture.kiriko.image, len(bpy.data.images)) == before
    picture.kiriko.image = bpy.data.images.load(str(path))
    with pytest.raises(RuntimeError, match=words):
        bpy.ops.kiriko.solve()

    path.write_bytes(whole)
    picture.kiriko.image.reload()
    bpy.ops.kiriko.solve()


def test_a_packed_picture_needs_no_file(picture, tmp_path):
    path = write(tmp_path / "p.jpg", TALL)
    image = opened(picture, path)
    image.pack()
    cut(path, 0.5)
    bpy.ops.kiriko.solve()


@pytest.mark.parametrize("kind", ["layers", "views"])
def test_images_of_several_layers_are_named(picture, tmp_path, kind):
    """As what they are, and with what to do, not as broken."""
    scene = bpy.data.scenes.new("render")
    scene.collection.objects.link(bpy.data.objects.new("eye", bpy.data.cameras.new("eye")))
    scene.camera = scene.collection.objects[0]
    render, form = scene.render, scene.render.image_settings
    render.engine, scene.cycles.samples = "CYCLES", 1
    render.resolution_x = render.resolution_y = 16
    render.filepath = str(tmp_path / "p.exr")
    if hasattr(form, "media_type"):
        form.media_type = "MULTI_LAYER_IMAGE" if kind == "layers" else "IMAGE"
    form.file_format = "OPEN_EXR_MULTILAYER" if kind == "layers" else "OPEN_EXR"
    if kind == "views":
        render.use_multiview, form.views_format = True, "MULTIVIEW"
    bpy.ops.render.render(scene=scene.name, write_still=True)

    with pytest.raises(RuntimeError, match="has several layers or views") as caught:
        opened(picture, tmp_path / "p.exr")
    assert "broken" not in str(caught.value)
    assert "Image > Save As" in str(caught.value)


LONG = "x" * 300


@pytest.mark.parametrize("path", [f"/tmp/{LONG}.png", f"/tmp/{LONG}/p.png"])
def test_a_path_that_is_too_long_is_one_sentence(picture, tmp_path, capfd, path):
    """By each button that takes a path; nothing is printed but that."""
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "p.blend"))
    bpy.ops.kiriko.solve()
    ours = bpy.ops.kiriko
    for call in (
        lambda: ours.open_picture(filepath=path),
        lambda: ours.export(filepath=path),
        lambda: ours.export_maps(directory=path),
        lambda: ours.calibrate(filepath=path),
        lambda: ours.preview(filepath=path),
        lambda: ours.save_comparison(filepath=path),
        lambda: ours.open_pictures(filepath=path),
    ):
        with pytest.raises(RuntimeError, match=r"cannot hold a file|no file|cannot be"):
            call()
        told = capfd.readouterr()
        assert "Traceback" not in told.out + told.err
