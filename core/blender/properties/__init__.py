"""The user's settings: roles on objects, settings and last result on each rig's collection, display
options on the window manager.

`scene.kiriko` is a Python property: the settings of the active rig.
"""

import bpy
from bpy.props import PointerProperty

from ...base.messages import CONTEXT
from ..data import overridden
from ..data.rigs import active_settings
from ..data.translation_context import in_own_words
from . import view
from .calibration_settings import KirikoCalibration
from .light import KirikoDisplay, KirikoPicture, KirikoViews
from .object_settings import (
    KirikoElement,
    KirikoMaterial,
    KirikoObject,
    KirikoPlate,
    KirikoSlot,
    show_image,
)
from .result_record import KirikoResult
from .rig_settings import KirikoRig, KirikoScene, KirikoSight, is_camera
from .view import KirikoView
from .viewers import KirikoViewer, turn_on

classes = (
    KirikoElement,
    KirikoPlate,
    KirikoPicture,
    KirikoDisplay,
    KirikoViews,
    KirikoSlot,
    KirikoObject,
    KirikoMaterial,
    KirikoViewer,
    KirikoResult,
    KirikoCalibration,
    KirikoSight,
    KirikoRig,
    KirikoScene,
    KirikoView,
)
# settings of objects and rigs, which library overrides can also change
OVERRIDABLE = (
    KirikoElement,
    KirikoPlate,
    KirikoPicture,
    KirikoDisplay,
    KirikoViews,
    KirikoSlot,
    KirikoObject,
    KirikoViewer,
    KirikoResult,
    KirikoCalibration,
    KirikoSight,
    KirikoRig,
)


def register() -> None:
    """Give objects and scenes their Kiriko settings."""
    for cls in OVERRIDABLE:
        overridden.be_overridable(cls)
    for cls in classes:
        bpy.utils.register_class(in_own_words(cls))
    # An annotation with a Python callback crashes the 4.2 module at exit, even after the class is
    # unregistered. A property added and removed by hand does not.
    KirikoObject.image = PointerProperty(
        name="Image",
        translation_context=CONTEXT,
        type=bpy.types.Image,
        update=show_image,
        override=overridden.OVERRIDE,
    )
    KirikoRig.viewer = PointerProperty(
        name="Viewer",
        translation_context=CONTEXT,
        description="Camera from which the picture looks undistorted; the scene's camera if empty",
        type=bpy.types.Object,
        poll=is_camera,
        update=turn_on,
        override=overridden.OVERRIDE,
    )
    KirikoViewer.camera = PointerProperty(
        name="Camera",
        translation_context=CONTEXT,
        description="Camera of this viewer; if the first entry is empty, the rig's viewer is used",
        type=bpy.types.Object,
        poll=is_camera,
        override=overridden.OVERRIDE,
    )
    view.add()
    _attach()
    overridden.register()


def _attach() -> None:
    """Give Blender's types their groups of settings."""
    bpy.types.Object.kiriko = PointerProperty(type=KirikoObject, override=overridden.OVERRIDE)
    bpy.types.Material.kiriko = PointerProperty(type=KirikoMaterial)
    bpy.types.Collection.kiriko = PointerProperty(type=KirikoRig, override=overridden.OVERRIDE)
    bpy.types.Scene.kiriko_scene = PointerProperty(type=KirikoScene)
    bpy.types.Scene.kiriko = property(
        active_settings, doc="Settings, viewers and result of the scene's active rig"
    )
    bpy.types.WindowManager.kiriko = PointerProperty(type=KirikoView)


def unregister() -> None:
    """Remove the settings."""
    overridden.unregister()
    del bpy.types.WindowManager.kiriko
    del bpy.types.Scene.kiriko
    del bpy.types.Scene.kiriko_scene
    del bpy.types.Collection.kiriko
    del bpy.types.Material.kiriko
    del bpy.types.Object.kiriko
    view.take_away()
    del KirikoViewer.camera
    del KirikoRig.viewer
    del KirikoObject.image
    for cls in reversed(classes):
        bpy.utils.unregister_class(cls)
