"""Settings of an object in the rig."""

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
from ...rig.parts import MOST_SPREAD
from ...rig.rig import MOST_CROSSING_ERROR, ROLES
from ..read.plane import show
from .light import KirikoDisplay, KirikoPicture, KirikoViews

# None, then the roles by their numbers, which Blender's files store
ROLE_ITEMS = (
    ("NONE", "None", "Ignored by Kiriko", "X", 0),
    *sorted(
        (
            (role.name, role.label, role.tip, role.icon, role.number)
            for role in ROLES
            if role.number is not None
        ),
        key=lambda item: item[-1],
    ),
)
# by their numbers, which Blender's files store
DISPERSED = {
    "Acrylic": 3,
    "Soda-Lime Glass": 4,
    "N-BK7, K9": 5,
    "N-SF11": 6,
    "Fused Silica": 7,
    "Polycarbonate": 8,
    "Polystyrene": 9,
    "Casting Resin (CR-39)": 10,
    "Water": 11,
}
DISPERSIONS = (
    ("NONE", "None", "The same index for all colours", "", 0),
    ("MATERIAL", "From Material", "Dispersion of the group glTF Material Output, if any", "", 1),
    ("ABBE", "Abbe Number", "By one number, as data sheets give it", "", 2),
    *((name, name, "", "", number) for name, number in DISPERSED.items()),
)
PLATE_MODELS = (
    (
        "IDEAL",
        "Ideal",
        "Perfect plate: every ray goes to the mirror image of its origin",
    ),
    (
        "CROSSED",
        "Two Layers (MMAP)",
        "Two layers of mirrors crossed at right angles, as in ASKA3D plates",
    ),
    (
        "HOLES",
        "Square Holes (DCRA)",
        "One layer of square holes with mirrored walls",
    ),
    (
        "RADIAL",
        "Radial Holes (DCRA)",
        "Square holes rotated with the azimuth around the plate's origin",
    ),
)
SURFACES = (
    (
        "AUTOMATIC",
        "Automatic",
        "Smooth where the mesh is regular, a blend where it is irregular, as drawn elsewhere",
        "NONE",
        2,
    ),
    (
        "SMOOTH",
        "Smooth",
        "Curved surface implied by smooth shading; flat faces and sharp edges stay as drawn",
        "NONE",
        0,
    ),
    (
        "FACETS",
        "As Drawn",
        "Facets of the mesh; smooth shading only interpolates their normals",
        "NONE",
        1,
    ),
)


def show_image(ours: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    """Show the chosen image on the picture's plane. The plane's size is up to the caller."""
    ours.is_image_shown = False
    if ours.image is not None and ours.role == "PICTURE":
        ours.is_image_shown = show(ours.id_data, ours.image)


class KirikoPlate(bpy.types.PropertyGroup):
    """The optical design of a plate."""

    model: EnumProperty(
        name="Model",
        description="Type of plate; mirrors add stray light, dimming and blur",
        items=PLATE_MODELS,
        default="IDEAL",
    )
    pitch: FloatProperty(
        name="Pitch",
        description="Distance between mirrors, always in millimetres",
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
        description="Height of one layer's mirrors in pitches, which sets the angle of greatest"
        " brightness",
        default=2.5,
        min=0.01,
        soft_max=10.0,
        max=1000.0,
        precision=2,
        step=1,
    )
    ior: FloatProperty(
        name="IOR",
        default=1.52,
        min=1.0,
        soft_max=2.5,
        max=10.0,
        precision=3,
        step=1,
    )
    reflectance: FloatProperty(
        name="Reflectance",
        default=0.87,
        min=0.001,
        max=1.0,
        subtype="FACTOR",
    )
    crossing_error: FloatProperty(
        name="Crossing Error",
        description="Deviation of the layers from 90 degrees; the image turns by twice as much",
        default=0.0,
        min=-MOST_CROSSING_ERROR,
        max=MOST_CROSSING_ERROR,
        precision=4,
        step=1,
        subtype="ANGLE",
    )
    fresnel: BoolProperty(
        name="Glass Reflections",
        description="Include reflections at the plate's two faces",
        default=True,
    )
    phase: FloatVectorProperty(
        name="Phase",
        description="Offset of the mirrors in each direction from the object's origin, in pitches",
        size=2,
        default=(0.0, 0.0),
        soft_min=0.0,
        soft_max=1.0,
        subtype="XYZ",
    )


PREFERENCES = (
    ("BRIGHTER", "Brighter", "The brighter of the two paths carries the picture"),
    ("REFLECTED", "Reflected First", "Reflected light carries the picture if it arrives"),
    ("TRANSMITTED", "Transmitted First", "Transmitted light carries the picture if it arrives"),
)


class KirikoElement(bpy.types.PropertyGroup):
    """Optical numbers of half mirrors, glass that reflects, lenses and polarising parts."""

    reflectance: FloatProperty(
        name="Reflectance",
        description="Share of the light that is reflected",
        default=0.5,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
    )
    absorption: FloatProperty(
        name="Absorption",
        description="Share of the light that is lost; the rest passes",
        default=0.0,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
    )
    reflects: BoolProperty(
        name="Use Reflection",
        description="Light reflected by the surface may carry the picture, as on water or a"
        " polished table",
        default=False,
    )
    prefers: EnumProperty(
        name="Picture By",
        description="Path of the picture if light arrives by both",
        items=PREFERENCES,
        default="BRIGHTER",
    )
    spread: FloatProperty(
        name="Spread",
        description="Standard deviation of the returned directions, shown by Simulate",
        default=0.0,
        min=0.0,
        max=MOST_SPREAD,
        subtype="ANGLE",
        precision=3,
        step=1,
    )
    pitch: FloatProperty(
        name="Pitch",
        description="Side of a corner cube, shown by Simulate, always in millimetres; 0 for none",
        default=0.0,
        min=0.0,
        soft_max=1.0,
        precision=3,
        step=1,
        unit="CAMERA",
    )
    focal_length: FloatProperty(
        name="Focal Length",
        description="Always in millimetres; below 0 for a diverging lens",
        default=100.0,
        soft_min=10.0,
        soft_max=1000.0,
        precision=2,
        step=100,
        unit="CAMERA",
    )
    polarising: BoolProperty(
        name="Reflective Polariser",
        description="Reflect s-polarised light and transmit the rest, regardless of Reflectance",
        default=False,
    )
    is_polarised: BoolProperty(
        name="Polarised",
        description="The light of the display is linearly polarised, as that of an LCD",
        default=False,
    )
    angle: FloatProperty(
        name="Axis",
        description="Angle of the transmission axis of a polariser or display, or of the fast axis"
        " of a wave plate; counterclockwise from the u axis of the UV map, or else from the first"
        " edge, seen from the front",
        default=0.0,
        precision=3,
        subtype="ANGLE",
    )
    extinction: FloatProperty(
        name="Extinction",
        description="Share of the other polarisation that passes; 0 for an ideal polariser",
        default=0.0,
        min=0.0,
        max=1.0,
        precision=4,
        subtype="FACTOR",
    )
    retardance: FloatProperty(
        name="Retardance",
        description="Delay between the two axes in waves: 0.25 for a quarter-wave film",
        default=0.25,
        soft_min=0.0,
        soft_max=1.0,
        precision=3,
        step=1,
    )


ELEMENT = tuple(KirikoElement.__annotations__)  # names of its properties


class KirikoSlot(bpy.types.PropertyGroup):
    """A material slot before Make It Glass; `link` is "OBJECT" or "DATA"."""

    link: StringProperty(options={"HIDDEN"})
    material: PointerProperty(type=bpy.types.Material, options={"HIDDEN"})


class KirikoMaterial(bpy.types.PropertyGroup):
    """Kiriko's record of a material.

    alpha_before : opacity in Solid before Add Rig made the material see-through; 0 if it did not
    """

    alpha_before: FloatProperty(options={"HIDDEN"})


class KirikoObject(bpy.types.PropertyGroup):
    """An object's part in the rig.

    taken_as : name of glass when Add Rig added it to a rig; copies have it, too
    is_made_glass : Add Rig gave the object its role
    is_drawn_by_edges : Add Rig set Display As to Wire
    is_given, given : Make It Glass gave the object its material; its slots before
    is_image_shown : the plane's own material shows the chosen image and defines the picture from
        then on
    """

    role: EnumProperty(
        name="Role",
        items=ROLE_ITEMS,
        default="NONE",
    )
    use_ior: BoolProperty(
        name="Override IOR",
        description="Use the index below instead of the material's",
        default=False,
    )
    ior: FloatProperty(
        name="IOR",
        description="Index of refraction; a higher index bends light more (acrylic 1.49, N-BK7"
        " 1.517)",
        default=1.49,
        min=0.1,
        soft_min=1.0,
        soft_max=2.5,
        max=10.0,
        precision=4,
        step=1,
    )
    dispersion: EnumProperty(
        name="Dispersion",
        description="How the index changes with colour, around the index at 588 nm",
        items=DISPERSIONS,
        default="MATERIAL",
    )
    abbe: FloatProperty(
        name="Abbe Number",
        description="A lower number separates colours more (N-BK7 64, acrylic 53, polycarbonate"
        " 28)",
        default=55.0,
        soft_min=20.0,
        soft_max=100.0,
        precision=1,
        step=100,
    )
    use_tint: BoolProperty(
        name="Override Tint",
        description="Use the colour below instead of the material's Volume Absorption",
        default=False,
    )
    tint: FloatVectorProperty(
        name="Tint",
        description="Colour of white light after 1 cm of this glass; it counts with Brightness",
        subtype="COLOR",
        default=(1.0, 1.0, 1.0),
        min=0.0,
        max=1.0,
    )
    priority: IntProperty(
        name="Priority",
        description="Order of overlapping glass objects: the higher number counts, then the"
        " smaller object",
        default=0,
        min=-1000,
        max=1000,
        soft_min=-10,
        soft_max=10,
    )
    plate: PointerProperty(type=KirikoPlate)
    element: PointerProperty(type=KirikoElement)
    picture: PointerProperty(type=KirikoPicture)
    display: PointerProperty(type=KirikoDisplay)
    views: PointerProperty(type=KirikoViews)
    surface: EnumProperty(
        name="Surface",
        description="Shape of smooth-shaded faces that the light meets",
        items=SURFACES,
        default="AUTOMATIC",
    )
    use_resolution: BoolProperty(
        name="Own Resolution",
        description="Give the viewer its own resolution instead of the render's; the camera frame"
        " in the viewport stays the render's",
        default=False,
    )
    resolution: IntVectorProperty(
        name="Resolution",
        description="Width and height in pixels, of a display's source image or of a viewer's"
        " image",
        size=2,
        default=(1024, 1024),
        min=1,
        max=32768,
    )
    pupil: FloatProperty(
        name="Diameter",
        description="Diameter of the viewer's pupil, always in millimetres, such as 4 for an eye in"
        " a room; 0 for a pinhole, which sees everything sharp",
        default=0.0,
        min=0.0,
        soft_max=8.0,
        precision=2,
        step=10,
        unit="CAMERA",
    )
    use_dof: BoolProperty(
        name="Use Depth of Field",
        description="Take the pupil and its focus from the camera's F-Stop, focal length and focus"
        " distance or object, instead of focusing on the picture",
        default=False,
    )
    taken_as: StringProperty(options={"HIDDEN"})
    is_made_glass: BoolProperty(options={"HIDDEN"})
    is_drawn_by_edges: BoolProperty(options={"HIDDEN"})
    is_given: BoolProperty(options={"HIDDEN"})
    given: CollectionProperty(type=KirikoSlot, options={"HIDDEN"})
    # image: see `register`
    is_image_shown: BoolProperty(options={"HIDDEN"})
