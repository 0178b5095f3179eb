"""An object's part in the rig."""

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    IntVectorProperty,
    PointerProperty,
    StringProperty,
)

from ...rig.catalogue import PLATES
from ...rig.rig import MOST_CROSSING_ERROR, ROLES
from ..read.plane import show
from .light import KirikoDisplay, KirikoPicture

# None, then the roles by their numbers, which Blender's files keep
ROLE_ITEMS = (
    ("NONE", "None", "No part of the rig: light passes as if it were not there", "X", 0),
    *sorted(
        (
            (role.name, role.label, role.tip, role.icon, role.number)
            for role in ROLES
            if role.number is not None
        ),
        key=lambda item: item[-1],
    ),
)
PLATE_MODELS = (
    (
        "IDEAL",
        "Ideal",
        "A law without mirrors: every ray goes to the mirror image of its origin",
    ),
    (
        "CROSSED",
        "Two Layers (MMAP)",
        "Two layers of mirrors, crossed at right angles, as in ASKA3D plates",
    ),
    (
        "HOLES",
        "Square Holes (DCRA)",
        "Holes with mirrors in both directions on their walls, in one layer",
    ),
    (
        "RADIAL",
        "Radial Holes (DCRA)",
        "Such holes, turned with the azimuth about the plate's origin",
    ),
)
SURFACES = (
    (
        "AUTOMATIC",
        "Automatic",
        "Smooth where the mesh is regular enough to tell the curved surface, between both where it"
        " is irregular, as drawn elsewhere",
        "NONE",
        2,
    ),
    (
        "SMOOTH",
        "Smooth",
        "The curved surface that smooth shading stands for; flat faces and sharp edges stay as"
        " drawn",
        "NONE",
        0,
    ),
    (
        "FACETS",
        "As Drawn",
        "The facets of the mesh as they are: smooth shading only interpolates their normals",
        "NONE",
        1,
    ),
)


def show_image(ours: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    """The plane shows the image that is chosen as the picture, too.
    The plane's size is left to whoever chooses.
    """
    ours.is_image_shown = False
    if ours.image is not None and ours.role == "PICTURE":
        ours.is_image_shown = show(ours.id_data, ours.image)


class KirikoPlate(bpy.types.PropertyGroup):
    """A plate's make."""

    model: EnumProperty(
        name="Model",
        description="The plate's make: mirrors bring stray light, dimness and blur",
        items=PLATE_MODELS,
        default="IDEAL",
    )
    pitch: FloatProperty(
        name="Pitch",
        description="From mirror to mirror, in millimetres whatever the scene's unit",
        default=1e3 * PLATES["ASKA3D-488"].array.pitch,
        min=1e-3,
        soft_min=0.1,
        soft_max=5.0,
        precision=3,
        step=1,
        unit="CAMERA",
    )
    height: FloatProperty(
        name="Height",
        description="Height of one layer's mirrors, in pitches: it sets the angle at which the"
        " plate is brightest",
        default=2.5,
        min=0.01,
        soft_max=10.0,
        max=1000.0,
        precision=2,
        step=1,
    )
    ior: FloatProperty(
        name="IOR",
        description="Index of refraction of the glass between the mirrors",
        default=1.52,
        min=1.0,
        soft_max=2.5,
        max=10.0,
        precision=3,
        step=1,
    )
    reflectance: FloatProperty(
        name="Reflectance",
        description="Share of light that a mirror reflects",
        default=0.87,
        min=0.001,
        max=1.0,
        subtype="FACTOR",
    )
    crossing_error: FloatProperty(
        name="Crossing Error",
        description="Angle by which the layers are crossed beyond 90 degrees; the image turns"
        " by twice as much",
        default=0.0,
        min=-MOST_CROSSING_ERROR,
        max=MOST_CROSSING_ERROR,
        precision=4,
        step=1,
        subtype="ANGLE",
    )
    fresnel: BoolProperty(
        name="Glass Reflections",
        description="The plate's two faces reflect a part of the light",
        default=True,
    )
    phase: FloatVectorProperty(
        name="Phase",
        description="Distance of the mirrors of each direction from the object's origin, in"
        " pitches",
        size=2,
        default=(0.0, 0.0),
        soft_min=0.0,
        soft_max=1.0,
        subtype="XYZ",
    )


class KirikoSlot(bpy.types.PropertyGroup):
    """A material slot as it was before Make It Glass."""

    link: StringProperty(name="Link", description="To the object or its data", options={"HIDDEN"})
    material: PointerProperty(
        name="Material",
        description="The material in the slot",
        type=bpy.types.Material,
        options={"HIDDEN"},
    )


class KirikoMaterial(bpy.types.PropertyGroup):
    """What Kiriko remembers of a material."""

    alpha_before: FloatProperty(
        name="Alpha Before",
        description="Opacity in Solid before Add Rig made the material see-through; 0: it did not",
        options={"HIDDEN"},
    )


class KirikoObject(bpy.types.PropertyGroup):
    """An object's part in the rig."""

    role: EnumProperty(
        name="Role",
        description="This object's part in the rig",
        items=ROLE_ITEMS,
        default="NONE",
    )
    use_ior: BoolProperty(
        name="Override IOR",
        description="Bend light by the index below instead of the one in the material",
        default=False,
    )
    ior: FloatProperty(
        name="IOR",
        description="Index of refraction: the higher, the more the glass bends the picture"
        " (acrylic 1.49, N-BK7 1.517)",
        default=1.49,
        min=0.1,
        soft_min=1.0,
        soft_max=2.5,
        max=10.0,
        precision=4,
        step=1,
    )
    priority: IntProperty(
        name="Priority",
        description="Where two glass objects overlap, the one with the higher number counts;"
        " among equals the smaller object",
        default=0,
        min=-1000,
        max=1000,
        soft_min=-10,
        soft_max=10,
    )
    plate: PointerProperty(name="Plate", description="The plate's make", type=KirikoPlate)
    picture: PointerProperty(
        name="Picture", description="How light the picture is wanted", type=KirikoPicture
    )
    display: PointerProperty(
        name="Display", description="How the display shines", type=KirikoDisplay
    )
    surface: EnumProperty(
        name="Surface",
        description="The surface that smooth shading stands for; facets bend the picture where a"
        " curve was meant",
        items=SURFACES,
        default="AUTOMATIC",
    )
    use_resolution: BoolProperty(
        name="Own Resolution",
        description="Give the viewer square pixels of its own in place of the render's; the"
        " camera's frame in the viewport keeps the shape of the render",
        default=False,
    )
    resolution: IntVectorProperty(
        name="Resolution",
        description="Width and height in pixels of the display, and so of the source image, or"
        " of the viewer's image",
        size=2,
        default=(1024, 1024),
        min=1,
        max=32768,
    )
    taken_as: StringProperty(
        name="Taken As",
        description="The name of glass when Add Rig took it into a rig, which copies have, too",
        options={"HIDDEN"},
    )
    is_made_glass: BoolProperty(
        name="Was No Glass",
        description="Add Rig gave the object its role",
        options={"HIDDEN"},
    )
    is_drawn_by_edges: BoolProperty(
        name="Is Drawn by Edges",
        description="Add Rig set Display As to Wire",
        options={"HIDDEN"},
    )
    is_given: BoolProperty(
        name="Is Given",
        description="Make It Glass gave the object its material",
        options={"HIDDEN"},
    )
    given: CollectionProperty(
        name="Given",
        description="Its own material slots, before",
        type=KirikoSlot,
        options={"HIDDEN"},
    )
    # image: see `register`
    is_image_shown: BoolProperty(
        name="Image Is Shown",
        description="The plane's own material shows the image that was chosen, and tells the"
        " picture from then on",
        options={"HIDDEN"},
    )
