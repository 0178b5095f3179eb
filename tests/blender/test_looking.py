"""Which events pass a modal operator at work; that the real ones do, only a window can show."""

from collections.abc import Callable
from types import ModuleType, SimpleNamespace

import pytest

from extension import loaded

VIEW = {
    "MIDDLEMOUSE": "view3d.rotate",
    "WHEELUPMOUSE": "view3d.zoom",
    "NUMPAD_1": "view3d.view_axis",
}
EDITS = {
    "G": "transform.translate",
    "NUMPAD_SLASH": "view3d.localview",
    "LEFTMOUSE": "view3d.select",
}


@pytest.fixture
def looking(kiriko) -> ModuleType:
    return loaded("operators.long_work")


@pytest.fixture
def passes(looking, monkeypatch) -> Callable[..., bool]:
    """Does an event pass, over a viewport of 100 x 100 with a
    sidebar over its right half, by these keymaps?
    """
    space = SimpleNamespace(lock_camera=False)
    main, sidebar = (
        SimpleNamespace(type=kind, x=x, y=0, width=w, height=100) for kind, x, w in SIDES
    )
    area = SimpleNamespace(
        type="VIEW_3D", regions=[main, sidebar], spaces=SimpleNamespace(active=space)
    )
    window = SimpleNamespace(screen=SimpleNamespace(areas=[area]))
    scene = SimpleNamespace(camera=object())
    context = SimpleNamespace(window=window, window_manager=None, scene=scene)

    def ask(
        type: str,
        x: int = 10,
        found: str = "",
        has_lock: bool = False,
        camera: object = scene,
        **keys: bool,
    ) -> bool:
        space.lock_camera, scene.camera = has_lock, camera
        monkeypatch.setattr(looking, "meant", lambda *_: {found} if found else set())
        held = {key: keys.get(key, False) for key in ("ctrl", "alt", "shift", "oskey")}
        return looking.only_looks(
            context, SimpleNamespace(type=type, mouse_x=x, mouse_y=10, **held)
        )

    return ask


SIDES = (("WINDOW", 0, 100), ("UI", 50, 50))


def test_the_view_turns_and_nothing_is_edited(passes):
    """Over the viewport all passes that its keymaps make a view of, and nothing else."""
    assert all(passes(type, found=found) for type, found in VIEW.items())
    assert not any(passes(type, found=found) for type, found in EDITS.items())
    assert not passes("MIDDLEMOUSE", found="transform.translate")  # as some keymaps have it
    # a gizmo may be under it, which moves objects
    assert not passes("LEFTMOUSE", found="view3d.rotate")
    assert not passes("WHEELUPMOUSE", found="screen.frame_offset", alt=True)
    assert passes("MIDDLEMOUSE")  # a press that becomes a drag
    assert not passes("NUMPAD_ENTER")


def test_the_sidebar_scrolls_and_no_number_changes(passes):
    """Over buttons the plain wheel scrolls; with a modifier it changes the button under it."""
    # keymaps of the viewport do not count there
    assert passes("WHEELDOWNMOUSE", x=60, found="transform.translate")
    assert passes("TRACKPADPAN", x=60)
    assert not passes("WHEELDOWNMOUSE", x=60, ctrl=True)
    assert not passes("NUMPAD_1", x=60, found="view3d.view_axis")
    assert not passes("LEFTMOUSE", x=60)
    assert not passes("WHEELDOWNMOUSE", x=200)


def test_a_view_that_takes_the_camera_along_stays(passes):
    """With Lock Camera to View turning moves the viewer.

    Without a camera Numpad 0 would choose one.
    """
    assert not any(passes(type, found=found, has_lock=True) for type, found in VIEW.items())
    assert passes("NUMPAD_0", found="view3d.view_camera")
    assert not passes("NUMPAD_0", found="view3d.view_camera", camera=None)
    assert passes("WHEELDOWNMOUSE", x=60, has_lock=True)


def test_moves_and_timers_pass(passes):
    """Views turn smoothly by timers of their own, drags by moves."""
    for type in ("MOUSEMOVE", "INBETWEEN_MOUSEMOVE", "TIMER1", "TIMER_REPORT", "WINDOW_DEACTIVATE"):
        assert passes(type)
