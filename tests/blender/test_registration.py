import addon_utils
import bpy
import pytest

from extension import EXTENSION

pytestmark = pytest.mark.every_blender


def kiriko_classes() -> set[str]:
    """Names of the registered Blender classes that Kiriko defines."""
    kinds = (
        bpy.types.Operator,
        bpy.types.Panel,
        bpy.types.PropertyGroup,
        bpy.types.AddonPreferences,
    )
    return {
        c.__name__
        for kind in kinds
        for c in kind.__subclasses__()
        if c.is_registered and EXTENSION in c.__module__
    }


def test_registration_is_undone(blender):
    """Disabling takes back everything that enabling
    added, and enabling again brings all of it back.
    """
    before = kiriko_classes()
    bpy.ops.preferences.addon_disable(module=EXTENSION)
    assert not kiriko_classes()
    assert not hasattr(bpy.types.Scene, "kiriko")
    assert not hasattr(bpy.types.Object, "kiriko")
    bpy.ops.preferences.addon_enable(module=EXTENSION)
    assert kiriko_classes() == before


def test_enabled_extension_breaks_no_policy(blender):
    """Blender has no complaint about the enabled extension,
    such as a module outside its own package.
    """
    assert addon_utils._extensions_warnings_get() == {}


def test_scene_is_empty_and_kiriko_stays_enabled(scene):
    """A test begins with an empty scene, in which Kiriko's settings are there."""
    assert len(scene.objects) == 0
    assert EXTENSION in bpy.context.preferences.addons
