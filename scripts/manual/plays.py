"""The plays: the steps of the manual, each with its picture, and the counted tasks."""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass

from environments import ROOT
from manual.steps import (
    Choose,
    Do,
    Key,
    Measure,
    Open,
    Press,
    Shot,
    Step,
    Still,
    Tab,
    Unfold,
    Until,
    does,
)

# the name of a language's texts in languages/
LANGUAGE = {"ja": "ja_JP"}


def translations(locale: str) -> dict[str, str]:
    """The interface's texts in a language, by the English ones; none where it has no file."""
    path = ROOT / "languages" / f"{locale}.po"
    if not path.exists():
        return {}
    texts: dict[str, str] = {}
    entry = {"msgid": "", "msgstr": ""}
    field = ""
    for line in path.read_text(encoding="utf-8").splitlines():
        head, quote, rest = line.partition('"')
        if line.startswith("#") or not quote:
            continue
        if head.strip():
            field = head.strip()
            entry[field] = ""
        entry[field] = entry.get(field, "") + ast.literal_eval(quote + rest)
        if field == "msgstr":
            texts[entry["msgid"]] = entry["msgstr"]
    return texts


def named(name: str) -> str:
    """Pattern of a name in the language of Blender's interface."""
    others = (translations(locale).get(name, name) for locale in LANGUAGE.values())
    return f"({'|'.join(map(re.escape, (name, *others)))})"


IN_THE_GLASS = does("kiriko.add_rig", "IN_GLASS")
BEHIND_THE_GLASS = does("kiriko.add_rig", "BEHIND_GLASS")
LOOK = does("kiriko.look_through")
SOLVE = does("kiriko.solve")
EXPORT = does("kiriko.export")
DISPLAY = named("Kiriko Display")
TWO_EYES = does("kiriko.two_eyes")
EYE_BOX = does("kiriko.eye_box")
PICTURE = does("kiriko.open_picture")
TAKE_FILE = Press(does("file.execute"), area="FILE_BROWSER", region="EXECUTE")
SIDEBAR = [Key("N"), Tab("Kiriko")]
OWN_PICTURE = [Press(PICTURE), Open("seaside.png"), TAKE_FILE, Until("has_seaside")]
DISPLAY_LINE = f"{does('kiriko.select_part')}{DISPLAY}"
DISPLAY_PRODUCT = Press(DISPLAY_LINE, up=-0.8)
IPHONE = [
    DISPLAY_PRODUCT,
    Choose("kiriko.display_preset", "iPhone 15"),
    Until("is_telephone"),
]
RENDERED = Still(15.0)  # longer than a sample takes on a busy machine


def panel(name: str) -> list[Step]:
    """A picture of one panel of the sidebar."""
    wanted = f"VIEW3D_PT_kiriko_{name}"
    return [Unfold(wanted), Shot(f"panel_{name}", region="UI", panel=wanted)]


FIRST_PICTURE: list[Step] = [
    Do("ball"),
    Do("seaside"),
    Key("NUMPAD_PERIOD"),
    *SIDEBAR,
    Shot("first_tab", region="UI", at=IN_THE_GLASS),
    Press(IN_THE_GLASS),
    Until("has_rig"),
    Shot("first_rig", region="WINDOW"),
    Press(PICTURE),
    Open("seaside.png"),
    TAKE_FILE,
    Until("has_seaside"),
    Shot("first_picture", region="UI", at=PICTURE, near=150),
    Press(LOOK),
    Until("is_seen", 400),
    RENDERED,
    Shot("first_seen", region="WINDOW"),
]

GOBLET: list[Step] = [
    Do("goblet"),
    Key("NUMPAD_PERIOD"),
    *SIDEBAR,
    Press(IN_THE_GLASS),
    Until("has_rig"),
    Shot("goblet_rig", region="WINDOW"),
    Press(SOLVE),
    Until("is_solved", 400),
    Until("is_quiet", 400),
    Press(LOOK),
    Until("is_seen", 400),
    RENDERED,
    Shot("goblet_seen", region="WINDOW"),
]

PHONE: list[Step] = [
    Do("ball"),
    Do("seaside"),
    *SIDEBAR,
    Press(BEHIND_THE_GLASS),
    Until("has_rig"),
    Shot("phone_rig", region="WINDOW"),
    *IPHONE,
    *OWN_PICTURE,
    Press(LOOK),
    Until("is_seen", 400),
    RENDERED,
    Shot("phone_seen", region="WINDOW"),
]

VIEWERS: list[Step] = [
    Do("ball"),
    Do("nothing_else"),
    *SIDEBAR,
    Press(IN_THE_GLASS),
    Until("has_rig"),
    Unfold("VIEW3D_PT_kiriko_viewers"),
    Press(TWO_EYES),
    Press(EYE_BOX),
    Until("has_eye_box", 400),
    Key("HOME"),
    Shot("viewers_eye_box", region="WINDOW"),
]

PANELS: list[Step] = [
    Do("ball"),
    *SIDEBAR,
    Press(IN_THE_GLASS),
    Until("has_rig"),
    Press(SOLVE),
    Until("is_solved", 400),
    Until("is_quiet", 400),
    *panel("main"),
    *panel("result"),
    *panel("rig"),
    *panel("export"),
    *panel("check"),
    *panel("viewers"),
    *panel("more_exports"),
    *panel("calibration"),
    *panel("advanced"),
]

# each is a picture of the extension site's page: docs/listing/listing.md
LISTING: dict[str, list[Step]] = {
    "checklist": [
        Do("only_viewport"),
        Do("model", "goblet"),
        *SIDEBAR,
        Press(IN_THE_GLASS),
        Until("has_rig"),
        Do("face_rig"),
        Still(5.0),
        Shot("checklist", of="*"),
    ],
    "paths": [
        Do("only_viewport"),
        Do("exhibit", "bottle"),
        *SIDEBAR,
        Press(SOLVE),
        Until("is_solved", 400),
        Until("is_quiet", 400),
        Do("face_rig"),
        Still(5.0),
        Shot("paths", of="*"),
    ],
    "look": [
        Do("only_viewport"),
        Do("exhibit", "goblet"),
        Do("furnish", "goblet"),
        *SIDEBAR,
        Press(LOOK),
        Until("is_seen", 900),
        RENDERED,
        Shot("look", of="*"),
    ],
    "before_after": [
        Do("only_viewport"),
        Do("ball"),
        *SIDEBAR,
        Press(BEHIND_THE_GLASS),
        Until("has_rig"),
        Do("star"),
        Press(SOLVE),
        Until("is_solved", 400),
        Until("is_quiet", 400),
        Press(does("kiriko.before_after")),
        Until("is_compared", 400),
        Still(5.0),
        Shot("before_after", of="*"),
    ],
    "export": [
        Do("only_viewport"),
        Do("exhibit", "text"),
        Do("furnish", "text"),
        *SIDEBAR,
        Press(SOLVE),
        Until("is_solved", 400),
        Until("is_quiet", 400),
        Do("show_source"),
        Press(LOOK),
        Until("is_seen", 900),
        Unfold("VIEW3D_PT_kiriko_export"),
        Key("HOME", area="IMAGE_EDITOR"),
        RENDERED,
        Shot("export", of="*"),
    ],
}

# each is a page's pictures, and those of the panels, which all pages use
MANUAL = {
    "first_picture": FIRST_PICTURE,
    "goblet": GOBLET,
    "phone": PHONE,
    "viewers": VIEWERS,
    "panels": PANELS,
}


def words_only(steps: list[Step]) -> list[Step]:
    """The steps without views of the scene, which are alike in all languages and taken once."""
    views = (Press(LOOK), Until("is_seen", 400), RENDERED)
    is_view = lambda step: isinstance(step, Shot) and step.region == "WINDOW"  # noqa: E731
    return [step for step in steps if step not in views and not is_view(step)]


def see(glass: str, kind: str) -> list[Step]:
    """From selected glass, with the sidebar closed, to the picture in it."""
    return [
        Do(glass),
        *SIDEBAR,
        Press(kind),
        Until("has_rig"),
        Press(LOOK),
        Until("is_seen"),
    ]


EXPORTED: list[Step] = [Press(EXPORT), TAKE_FILE, Until("is_exported"), Do("remove_exported")]


@dataclass(frozen=True)
class Way:
    """Steps from glass to the wanted, and the clicks they may take."""

    steps: list[Step]
    at_most: int


SEE, SEE_AND_EXPORT = 3, 5
COUNTED = {
    f"{what}: {name}": Way(see("ball", kind) + more, at_most)
    for name, kind in (
        ("ball in the glass", IN_THE_GLASS),
        ("ball before a display", BEHIND_THE_GLASS),
    )
    for what, more, at_most in (("see", [], SEE), ("export", EXPORTED, SEE_AND_EXPORT))
}
# the whole way of somebody who is new, to an exported file
TASKS = {
    "task: default cube": Way(
        [
            *SIDEBAR,
            Press(IN_THE_GLASS),
            Until("has_rig"),
            Press(does("kiriko.make_glass")),
            Press(LOOK),
            Until("is_seen"),
            *EXPORTED,
        ],
        SEE_AND_EXPORT + 1,
    ),
    "task: goblet": Way(see("goblet", IN_THE_GLASS) + EXPORTED, SEE_AND_EXPORT),
    "task: telephone": Way(
        [
            Do("seaside"),
            Do("ball"),
            *SIDEBAR,
            Press(BEHIND_THE_GLASS),
            Until("has_rig"),
            *IPHONE,
            *OWN_PICTURE,
            Press(LOOK),
            Until("is_seen"),
            *EXPORTED,
        ],
        10,
    ),
}

LIVE = does("kiriko.live")


def steady(state: str) -> Measure:
    """The main buttons, which no state may move."""
    return Measure(state, (SOLVE, LIVE, LOOK, PICTURE))


STEADY = {
    "steady: default cube": Way(
        [
            *SIDEBAR,
            Press(IN_THE_GLASS),
            Until("has_rig"),
            steady("no glass"),
            Press(does("kiriko.make_glass")),
            Still(2.0),
            steady("too large"),
            Press(does("kiriko.rescale_scene")),
            Still(2.0),
            steady("ready"),
            Press(LIVE),
            steady("Live works"),
            Until("is_up_to_date", 400),
            steady("Live is up to date"),
            Press(LIVE),
            steady("Live is off"),
            Press(SOLVE),
            steady("Solve works"),
            Until("is_solved", 400),
            Until("is_quiet", 400),
            steady("solved"),
        ],
        7,
    ),
}

WAYS = {**COUNTED, **TASKS, **STEADY}
# for a comparison with the screen (shown.py)
SHOWN: list[Step] = [
    Do("ball"),
    Do("seaside"),
    *SIDEBAR,
    Press(IN_THE_GLASS),
    Until("has_rig"),
    Do("small_display"),
    *OWN_PICTURE,
    Press(SOLVE),
    Until("is_solved"),
    Until("is_quiet"),
    Press(EXPORT),
    TAKE_FILE,
    Until("is_exported"),
    Do("show_window"),
    Still(1.0),
    Do("keep_shown"),
]
PLAYS = {**MANUAL, **LISTING, "shown": SHOWN, **{name: way.steps for name, way in WAYS.items()}}
