"""Cuts, scales and packs what was grabbed, for the manual's pages."""

from __future__ import annotations

import json
from pathlib import Path

from PIL import Image, ImageDraw

WIDEST = 1000  # px
QUALITY = 70  # labels stay sharp, and the pictures of all languages fit into a megabyte
RING = (255, 122, 0)
RADIUS = 15.0  # px
WIDTH = 3


def pack(raw: Path, folder: Path) -> None:
    """Write the wanted part of a grabbed window as a WebP, with a ring where one is wanted."""
    told = json.loads(raw.with_suffix(".json").read_text(encoding="utf-8"))
    width, height = told["size"]
    image = Image.frombytes("RGB", (width, height), raw.read_bytes())
    left, bottom, across, up = told["box"]
    top = height - bottom - up
    image = image.crop((int(left), int(top), int(left + across), int(top + up)))
    scale = min(1.0, WIDEST / image.width)
    if scale < 1:
        size = round(image.width * scale), round(image.height * scale)
        image = image.resize(size, Image.Resampling.LANCZOS)

    if told["ring"]:
        x = (told["ring"][0] - left) * scale
        y = (height - told["ring"][1] - top) * scale
        corners = [x - RADIUS, y - RADIUS, x + RADIUS, y + RADIUS]
        ImageDraw.Draw(image).ellipse(corners, outline=RING, width=WIDTH)
    image.save(folder / f"{raw.stem}.webp", quality=QUALITY, method=6)
