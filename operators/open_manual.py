"""Manual: opens the bundled pages in the browser, without network.

F1 over a button or a setting, and Online Manual in its menu, open the matching place.
"""

from pathlib import Path

import bpy

from ..core.base.errors import KirikoError
from ..core.base.messages import Message
from . import needed, reporting

# `dev.py build` makes it from docs/manual, with a folder for each language but English.
FOLDER = Path(__file__).resolve().parent.parent / "manual"
PLACES = "at"  # folder with a redirecting page for each button and setting
NOT_BUILT = Message("The manual is missing: install Kiriko from its zip")


def language() -> str:
    """Language of the interface, without its country."""
    return bpy.app.translations.locale.partition("_")[0]


def pages() -> Path:
    """The manual's folder in the language of the interface, otherwise in English."""
    own = FOLDER / language()
    return own if own.joinpath("index.html").is_file() else FOLDER


def places() -> tuple[str, list[tuple[str, str]]]:
    """For Blender's own lookup: URL prefix, and pairs of a button's or setting's name and its URL.

    Each has its own page, because Windows and macOS drop the fragment of a file URL.
    """
    folder = pages() / PLACES
    return f"{folder.as_uri()}/", [(path.stem, path.name) for path in folder.glob("*.html")]


class KIRIKO_OT_open_manual(bpy.types.Operator):
    """Open Kiriko's manual; F1 over a button opens its entry"""

    bl_idname = "kiriko.open_manual"
    bl_label = "Manual"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(cls, [] if FOLDER.is_dir() else [NOT_BUILT])

    def execute(self, context: bpy.types.Context) -> set[str]:
        import webbrowser

        page = pages() / "index.html"
        with reporting.errors_reported(self):
            if not webbrowser.open(page.as_uri()):
                raise KirikoError("No browser was found: open the file '{page}'.", page=page)
            return {"FINISHED"}
        return {"CANCELLED"}


def register() -> None:
    """Register the lookup of buttons and settings."""
    bpy.utils.register_manual_map(places)


def unregister() -> None:
    """Unregister it."""
    bpy.utils.unregister_manual_map(places)
