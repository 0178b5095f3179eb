"""What is on the screen beside a file, without Blender."""

import json
from pathlib import Path

import pytest

Image = pytest.importorskip("PIL.Image")

from manual.shown import is_shown  # noqa: E402, Pillow may be missing

WINDOW, REGION, SIZE = (40, 30), (4, 2, 33, 26), (11, 8)  # the region's lower left corner


def shown(folder: Path, *, at: tuple[int, int], changed: tuple[int, int] | None = None) -> bool:
    """Is an image at a place of the screen, from its upper left corner, taken for the file's?"""
    pixels = [(3 * n % 256, 7 * n % 256, 255 - n) for n in range(SIZE[0] * SIZE[1])]
    image = Image.new("RGB", SIZE)
    image.putdata(pixels)
    image.save(folder / "source.png")
    window = Image.new("RGB", WINDOW, (200, 0, 0))
    top = WINDOW[1] - REGION[1] - REGION[3]
    window.paste((0, 0, 0), (REGION[0], top, REGION[0] + REGION[2], top + REGION[3]))
    window.paste(image, at)
    if changed is not None:
        r, g, b = window.getpixel(changed)
        window.putpixel(changed, (r, g ^ 1, b))
    (folder / "shown.rgb").write_bytes(window.tobytes())
    told = {"window": WINDOW, "region": REGION}
    (folder / "shown.json").write_text(json.dumps(told), encoding="utf-8")
    return is_shown(folder)


def test_one_pixel_by_one_step_is_told(tmp_path, capsys):
    """In the image and around it; an image that is a pixel aside differs nearly everywhere."""
    place = (15, 11)  # 4 + (33 - 11) // 2; 2 + 9 = 11 rows below of 30, 8 rows of its own
    assert shown(tmp_path, at=place)
    assert "0 of 88 pixels differ; of 770 around it 0 are not black" in capsys.readouterr().out
    assert not shown(tmp_path, at=place, changed=(20, 15))
    assert "1 of 88 pixels differ; of 770 around it 0 are" in capsys.readouterr().out
    assert not shown(tmp_path, at=place, changed=(36, 3))
    assert "0 of 88 pixels differ; of 770 around it 1 are" in capsys.readouterr().out
    assert not shown(tmp_path, at=(16, 11))
    assert int(capsys.readouterr().out.split(": ")[1].split()[0]) > 80
