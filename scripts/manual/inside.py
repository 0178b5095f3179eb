"""Runs inside the real Blender: installs Kiriko from a zip, plays some plays, and closes Blender.

`program.py` starts it, with the zip, the folder for pictures and accounts, the language of the
interface, and the plays' names.
"""

from __future__ import annotations

import json
import sys
import traceback
from collections.abc import Iterator
from pathlib import Path

import bpy

from manual import scenes
from manual.player import Player, StuckError, drive
from manual.plays import MANUAL, PLAYS, words_only
from manual.steps import Shot

ENGLISH = "en_US"


def play_all(names: list[str], folder: Path, language: str) -> Iterator[float]:
    """Each play from Blender's startup file on; its account of clicks goes into a file."""
    set_preferences(language)  # the splash screen would come before the first play
    for name in names:
        scenes.stop_live()
        bpy.ops.wm.read_homefile(use_factory_startup=True, load_ui=True)
        yield 1.0
        set_preferences(language)
        player = Player(folder)
        yield 1.0
        steps = PLAYS[name]
        if name in MANUAL and language != ENGLISH:
            steps = words_only(steps)
        try:
            yield from player.play(steps)
        except StuckError as error:
            yield from player.shot(Shot("stuck", of="*"))
            raise StuckError(f"{name}: {error}") from error
        account = {
            "clicks": player.clicks,
            "n_clicks": player.n_clicks,
            "keys": player.keys,
            "scrolls": player.scrolls,
            "places": player.places,
            "seconds": player.seconds,
        }
        (folder / f"{name}.account.json").write_text(json.dumps(account), encoding="utf-8")
        print(f"played {name}: {player.n_clicks} clicks", flush=True)


def set_preferences(language: str) -> None:
    """Settings of a window for equal pictures on any machine."""
    preferences = bpy.context.preferences
    preferences.view.show_splash = False
    preferences.view.show_tooltips = False  # they would cover the buttons
    preferences.view.smooth_view = 0
    preferences.view.filebrowser_display_type = "SCREEN"
    preferences.view.render_display_type = "NONE"
    preferences.view.ui_scale = 1.0
    preferences.system.use_region_overlap = False  # no scene shines through the sidebar
    try:
        preferences.view.language = language
    except TypeError:  # a Blender without any translation has no language to choose
        if language != ENGLISH:
            raise StuckError(
                f"This Blender has no language {language}: name another one by --blender, or leave"
                " the language out of --languages."
            ) from None


def main() -> None:
    extension, folder, language, *names = sys.argv[sys.argv.index("--") + 1 :]
    bpy.ops.extensions.package_install_files(
        filepath=extension, repo="user_default", enable_on_install=True, overwrite=True
    )

    def at_end(error: BaseException | None) -> None:
        if error is not None:
            text = str(error) if isinstance(error, StuckError) else traceback.format_exc()
            (Path(folder) / "error.txt").write_text(text, encoding="utf-8")
        bpy.ops.wm.quit_blender()

    drive(play_all(names, Path(folder), language), at_end)


main()
