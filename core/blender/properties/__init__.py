"""The user's settings: roles on objects, settings and the last result
on the scene, what is shown on the window manager.
"""

import bpy
from bpy.props import CollectionProperty, PointerProperty

from ...base.messages import CONTEXT
from .. import overridden
from ..translation_context import in_own_words
from . import view
from .calibration import KirikoCalibration
from .light import KirikoDisplay, KirikoPicture
from .objects import KirikoObject, KirikoPlate, show_image
from .result import KirikoResult
from .rig import KirikoMaterial, KirikoRig
from .scene import KirikoOther, KirikoScene, is_camera
from .view import KirikoView
from .viewers import KirikoViewer, turn_on

classes = (
    KirikoPlate,
    KirikoPicture,
    KirikoDisplay,
    KirikoObject,
    KirikoMaterial,
    KirikoViewer,
    KirikoRig,
    KirikoResult,
    KirikoCalibration,
    KirikoScene,
    KirikoOther,
    KirikoView,
)
OF_OBJECTS = (KirikoPlate, KirikoPicture, KirikoDisplay, KirikoObject)


def register() -> None:
    """Give objects and scenes their Kiriko settings."""
    for cls in OF_OBJECTS:
        overridden.be_overridable(cls)
    for cls in classes:
        bpy.utils.register_class(in_own_words(cls))
    # An annotation with a Python callback crashes the 4.2 module at exit, even when the class has
    # been unregistered; a property that is added and taken away by hand does not.
    KirikoObject.image = PointerProperty(
        name="Image",
        translation_context=CONTEXT,
        description="The picture, which the plane's material shows, too",
        type=bpy.types.Image,
        update=show_image,
        override=overridden.OVERRIDE,
    )
    KirikoScene.viewer = PointerProperty(
        name="Viewer",
        translation_context=CONTEXT,
        description="Camera from which the picture shall look undistorted; the scene's camera when"
        " empty. In a list of viewers it is the first: setting it turns that on and chooses it, and"
        " the others stay as they are",
        type=bpy.types.Object,
        poll=is_camera,
        update=turn_on,
    )
    KirikoViewer.camera = PointerProperty(
        name="Camera",
        translation_context=CONTEXT,
        description="Camera that looks at the display, too; the first entry is the rig's viewer"
        " when empty",
        type=bpy.types.Object,
        poll=is_camera,
    )
    view.add()
    bpy.types.Object.kiriko = PointerProperty(
        name="Kiriko",
        description="This object's part in the rig",
        type=KirikoObject,
        override=overridden.OVERRIDE,
    )
    bpy.types.Material.kiriko = PointerProperty(
        name="Kiriko", description="What Kiriko keeps of the material", type=KirikoMaterial
    )
    bpy.types.Collection.kiriko = PointerProperty(
        name="Kiriko", description="The rig that the collection holds", type=KirikoRig
    )
    bpy.types.Scene.kiriko = PointerProperty(
        name="Kiriko",
        description="How the scene's active rig is solved and exported",
        type=KirikoScene,
    )
    bpy.types.Scene.kiriko_others = CollectionProperty(
        name="Kiriko's Other Rigs",
        description="Settings and results of the scene's rigs that are not active",
        type=KirikoOther,
    )
    bpy.types.WindowManager.kiriko = PointerProperty(
        name="Kiriko", description="What the interface shows of a rig", type=KirikoView
    )
    overridden.register()


def unregister() -> None:
    """Take the settings away again."""
    overridden.unregister()
    del bpy.types.WindowManager.kiriko
    del bpy.types.Scene.kiriko_others
    del bpy.types.Scene.kiriko
    del bpy.types.Collection.kiriko
    del bpy.types.Material.kiriko
    del bpy.types.Object.kiriko
    view.take_away()
    del KirikoViewer.camera
    del KirikoScene.viewer
    del KirikoObject.image
    for cls in reversed(classes):
        bpy.utils.unregister_class(cls)
