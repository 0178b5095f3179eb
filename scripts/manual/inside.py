"""Runs inside the real Blender: installs Kiriko from a zip, plays some plays, and closes Blender.

`program.py` starts it, with the zip, the folder for pictures and accounts, and the plays' names.
"""

from __future__ import annotations

import json
import sys
import traceback
from collections.abc import Iterator
from pathlib import Path

import bpy

from manual.player import Player, StuckError, drive
from manual.plays import PLAYS
from manual.steps import Shot


def play_all(names: list[str], folder: Path) -> Iterator[float]:
    """Each play from Blender's startup file on; its account of clicks goes into a file."""
    for name in names:
        bpy.ops.wm.read_homefile(use_factory_startup=True, load_ui=True)
        yield 1.0
        set_preferences()
        player = Player(folder)
        yield 1.0
        try:
            yield from player.play(PLAYS[name])
        except StuckError as error:
            yield from player.shot(Shot("stuck", of="*"))
            raise StuckError(f"{name}: {error}") from error
        account = {
            "clicks": player.clicks,
            "keys": player.keys,
            "scrolls": player.scrolls,
            "seconds": player.seconds,
        }
        (folder / f"{name}.account.json").write_text(json.dumps(account), encoding="utf-8")
        print(f"played {name}: {len(player.clicks)} clicks", flush=True)


def set_preferences() -> None:
    """What a window has to be like for its pictures to be alike on any machine."""
    preferences = bpy.context.preferences
    preferences.view.show_splash = False
    preferences.view.show_tooltips = False  # they would stand before the buttons
    preferences.view.smooth_view = 0
    preferences.view.filebrowser_display_type = "SCREEN"
    preferences.view.render_display_type = "NONE"
    preferences.view.ui_scale = 1.0


def main() -> None:
    extension, folder, *names = sys.argv[sys.argv.index("--") + 1 :]
    set_preferences()
    bpy.ops.extensions.package_install_files(
        filepath=extension, repo="user_default", enable_on_install=True, overwrite=True
    )

    def at_end(error: BaseException | None) -> None:
        if error is not None:
            text = str(error) if isinstance(error, StuckError) else traceback.format_exc()
            (Path(folder) / "error.txt").write_text(text, encoding="utf-8")
        bpy.ops.wm.quit_blender()

    drive(play_all(names, Path(folder)), at_end)


main()
