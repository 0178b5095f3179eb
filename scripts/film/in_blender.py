"""Runs inside the real Blender: installs Kiriko from a zip, plays the story, and closes Blender."""

from __future__ import annotations

import sys
import traceback
from pathlib import Path

import bpy

from film.record import Recorder
from film.story import story
from manual.player import drive


def main() -> None:
    extension, folder, *_ = sys.argv[sys.argv.index("--") + 1 :]
    view = bpy.context.preferences.view
    view.show_splash = view.show_tooltips = False
    view.smooth_view = 0
    bpy.ops.extensions.package_install_files(
        filepath=extension, repo="user_default", enable_on_install=True, overwrite=True
    )

    def at_end(error: BaseException | None) -> None:
        if error is not None:
            text = "".join(traceback.format_exception(error))
            (Path(folder) / "error.txt").write_text(text, encoding="utf-8")
        bpy.ops.wm.quit_blender()

    drive(story(Recorder(Path(folder))), at_end)


main()
