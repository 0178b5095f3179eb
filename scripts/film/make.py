"""Records the README's film in the real Blender: a star bent by a glass ball, Add Rig, Solve, and
the wipe from before to after.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from environments import ROOT, ToolError
from manual.program import add_options, play

SIZE = 720, 480  # px of the window and of the film
QUALITY = 80
CAPTIONS = (
    "Glass bends a picture.",
    "Select the glass. Add a rig.",
    "Solve.",
    "Compare: before and after.",
    "Look through the glass.",
)
WITH_MOUSE = 1, 2, 3  # scenes
CAPTION = 26, 442  # px, upper left corner of its text
ARROW = ((0, 0), (0, 17), (4, 13), (7, 20), (10, 19), (7, 12), (12, 12))


def captioned(raw: Path, frame: dict) -> object:
    """A frame with its caption, and the mouse, which no grab contains."""
    from PIL import Image, ImageDraw, ImageFont  # dev.py reads the options without Pillow

    image = Image.frombytes("RGB", tuple(frame["size"]), raw.read_bytes())
    canvas = ImageDraw.Draw(image, "RGBA")
    font = ImageFont.load_default(19)
    text = CAPTIONS[frame["scene"]]
    left, top, right, bottom = canvas.textbbox(CAPTION, text, font=font)
    canvas.rounded_rectangle((left - 10, top - 8, right + 10, bottom + 8), 6, fill=(0, 0, 0, 170))
    canvas.text(CAPTION, text, font=font, fill=(255, 255, 255, 255))
    if frame["scene"] in WITH_MOUSE:
        x, y = frame["mouse"]
        if frame["is_pressed"]:
            canvas.ellipse((x - 13, y - 13, x + 13, y + 13), outline=(255, 150, 30, 255), width=3)
        arrow = [(x + a, y + b) for a, b in ARROW]
        canvas.polygon(arrow, fill=(255, 255, 255, 255), outline=(0, 0, 0, 255))
    return image


def cut(folder: Path, path: Path) -> float:
    """Write the film; its length in seconds."""
    frames = json.loads((folder / "frames.json").read_text(encoding="utf-8"))
    frames.sort(key=lambda frame: frame["scene"])  # stable: within a scene as they were taken
    images = [captioned(folder / frame["file"], frame) for frame in frames]
    times = [round(1000 * frame["seconds"]) for frame in frames]
    images[0].save(
        path, save_all=True, append_images=images[1:], duration=times, loop=0, quality=QUALITY,
        method=4,
    )  # fmt: skip
    return sum(times) / 1000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    add_options(parser)
    to = ROOT / "docs" / "pictures" / "kiriko.webp"
    parser.add_argument("--out", type=Path, default=to, metavar="FILE")
    arguments = parser.parse_args()
    try:
        folder = play(
            [], arguments.blender, arguments.extension, inside="film/in_blender.py", size=SIZE
        )
    except ToolError as error:
        sys.exit(str(error))
    seconds = cut(folder, arguments.out)
    print(f"{arguments.out}: {seconds:.1f} s, {arguments.out.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
