"""Commercial plates, displays and glasses, each with the source of its numbers.

A product is listed only with figures from its maker or a measurement. Sizes in m. Sources name the
page used. "EDID" is the size a monitor reports to the computer, rounded to 1 mm, from reports of
the Linux Hardware Project; the listed size is based on its square pixels within this rounding.
Brightness is omitted without a source.
"""

from dataclasses import dataclass
from math import hypot, radians

from .dispersion import AbbeIndex, Index, PowerIndex, SellmeierIndex
from .mirror_array import MirrorArray
from .views import Views

INCH = 0.0254  # m


@dataclass(frozen=True)
class PlateProduct:
    """A square plate of mirrors.

    side : m, of the whole plate
    """

    name: str
    array: MirrorArray
    side: float
    source: str


@dataclass(frozen=True)
class DisplayProduct:
    """A display in landscape orientation, unless it has views.

    Parameters
    ----------
    kind : the heading in the product list
    size : (width, height) in m of the active area
    pixels : (width, height), of one view
    luminance : cd/m^2 of white, by its maker; None if not published
    views : of a light-field display; None for others
    """

    name: str
    kind: str
    size: tuple[float, float]
    pixels: tuple[int, int]
    luminance: float | None
    source: str
    views: Views | None = None


@dataclass(frozen=True)
class GlassProduct:
    """A clear material.

    ior : index of refraction at 589 nm, the sodium D line; Kiriko uses it for the helium d line,
        where it is larger by less than 0.0003
    dispersion : the index by wavelength, whose value at 589 nm rounds to `ior`; None without a
        source
    """

    name: str
    ior: float
    source: str
    dispersion: Index | None = None


def _by_density(
    name: str,
    kind: str,
    pixels: tuple[int, int],
    per_inch: float,
    luminance: float | None,
    source: str,
) -> DisplayProduct:
    """A display whose maker gives the pixel density instead of the size.

    Rounding the density by half a pixel to the inch is an error under 0.25 %.
    """
    width, height = (INCH * n / per_inch for n in pixels)
    return DisplayProduct(name, kind, (width, height), pixels, luminance, source)


def _by_diagonal(
    name: str, kind: str, pixels: tuple[int, int], inches: float, source: str
) -> DisplayProduct:
    """A display whose maker only gives its diagonal; pixels are square."""
    return _by_density(name, kind, pixels, hypot(*pixels) / inches, None, source)


def _light_field(
    name: str, panel: tuple[int, int], per_inch: float, tile: tuple[int, int],
    views: tuple[int, float], source: str,
) -> DisplayProduct:  # fmt: skip
    """A Looking Glass with the tiles of its default quilt: so many views, over a cone in degrees.

    Pixels of the panel and their density are those of the calibration templates of Looking Glass
    Bridge 2.4.10, as listed in horinoh's repository LookingGlass.
    """
    size = INCH * panel[0] / per_inch, INCH * panel[1] / per_inch
    n, cone = views
    shown = Views(n, cone=(radians(cone), 0.0))
    return DisplayProduct(name, "Light-Field Displays", size, tile, None, source, shown)


PLATES = {
    product.name: product
    for product in (
        PlateProduct(
            "ASKA3D-488",
            MirrorArray(pitch=0.5e-3, height=1.25e-3),
            side=0.488,
            source="Kiuchi and Koizumi, Computers & Graphics 96 (2021), for the mirrors; the"
            " number in the name is the side in mm",
        ),
        PlateProduct(
            "ASKA3D-200",
            MirrorArray(pitch=0.3e-3, height=0.75e-3),
            side=0.2,
            source="Kurihara and Bao, J. Imaging 11 (2025) 150, for side and pitch; we found no"
            " source for the layers' height, so it is taken from the ASKA3D-488: 2.5"
            " pitches",
        ),
    )
}

DISPLAYS = {
    product.name: product
    for product in (
        _by_density(
            "iPhone SE (2022)", "Phones", (1334, 750), 326, 625.0,
            "Apple's figures in Wikipedia, iPhone SE (3rd generation)",
        ),
        _by_density(
            "iPhone 15", "Phones", (2556, 1179), 460, 1000.0,
            "Apple's figures in Wikipedia, iPhone 15",
        ),
        _by_density(
            "iPhone 15 Plus", "Phones", (2796, 1290), 460, 1000.0,
            "Apple's figures in Wikipedia, iPhone 15",
        ),
        _by_density(
            "iPad mini (2021)", "Tablets", (2266, 1488), 326, None,
            "Apple's figures in Reference.org, iPad Mini (6th generation)",
        ),
        _by_density(
            "iPad (2022)", "Tablets", (2360, 1640), 264, 500.0,
            "Apple's figures in Wikipedia, iPad (10th generation)",
        ),
        _by_density(
            "iPad Pro 12.9 (2022)", "Tablets", (2732, 2048), 264, 600.0,
            "same pixels per inch as the first iPad Pro, Link-man, 2015; brightness: Il Portale"
            " del Nerd, 2024",
        ),
        DisplayProduct(
            "Raspberry Pi Touch Display 2", "Panels", (0.1545, 0.087), (1280, 720), None,
            "Raspberry Pi, Touch Display 2 documentation, 2025 (active area)",
        ),
        DisplayProduct(
            "Dell P2422H", "Monitors", (0.52704, 0.29646), (1920, 1080), None,
            "pixels of 0.2745 mm; EDID: 527 x 296 mm",
        ),
        DisplayProduct(
            "Dell U2415", "Monitors", (0.5184, 0.324), (1920, 1200), None,
            "pixels of 0.27 mm; EDID: 518 x 324 mm",
        ),
        DisplayProduct(
            "Dell U2723QE", "Monitors", (0.59674, 0.33566), (3840, 2160), 400.0,
            "pixels of 0.1554 mm; EDID: 597 x 336 mm; Dell's brightness in Ars Technica, 2022",
        ),
        _by_density(
            "Apple Studio Display", "Monitors", (5120, 2880), 218, 600.0,
            "Apple's figures in Wikipedia, Apple Studio Display",
        ),
        _by_diagonal(
            "Samsung QM55R", "Signage", (3840, 2160), 54.6,
            "we found no data sheet; size from the diagonal of 55-inch panels, whose EDIDs give"
            " 1210 x 680 mm",
        ),
        _light_field(
            "Looking Glass Go", (1440, 2560), 491, (372, 682), (66, 54),
            "Bridge 2.4.10; cone: quiltwright 0.16",
        ),
        _light_field(
            "Looking Glass Portrait", (1536, 2048), 324, (420, 560), (48, 40),
            "Bridge 2.4.10; cone: HoloPlay Core",
        ),
        _light_field(
            "Looking Glass 16", (3840, 2160), 283, (960, 720), (48, 50),
            "Bridge 2.4.10; cone: quiltwright 0.16",
        ),
        _light_field(
            "Looking Glass 32", (7680, 4320), 280, (1170, 1170), (49, 35),
            "Bridge 2.4.10; quilt: quiltwright 0.16; cone: the maker's default",
        ),
        _light_field(
            "Looking Glass 65", (7680, 4320), 136, (1024, 910), (72, 35),
            "Bridge 2.4.10; quilt: quiltwright 0.16; cone: the maker's default",
        ),
    )
}  # fmt: skip

# Coefficients and ranges are those of refractiveindex.info, of the sources named with each.
_POLYMERS = (436.8e-9, 1052e-9)  # m, the range of Sultanova et al.

GLASSES = {
    product.name: product
    for product in (
        GlassProduct(
            "Acrylic",
            1.49,
            "Kiuchi and Koizumi 2021; 1.4905 by Sultanova et al., Acta Phys. Pol. A 116 (2009)",
            SellmeierIndex(((1.1819, 0.011313),), _POLYMERS),
        ),
        GlassProduct(
            "Soda-Lime Glass",
            1.5233,
            "Rubin, Solar Energy Materials 12 (1985)",
            PowerIndex(((1.5130, 0), (-0.003169, 2), (0.003962, -2)), (310e-9, 4600e-9)),
        ),
        GlassProduct(
            "N-BK7, K9",
            1.5167,
            "SCHOTT, N-BK7 data sheet, 2017",
            SellmeierIndex(
                (
                    (1.03961212, 0.00600069867),
                    (0.231792344, 0.0200179144),
                    (1.01046945, 103.560653),
                ),
                (300e-9, 2500e-9),
            ),
        ),
        GlassProduct(
            "N-SF11",
            1.7845,
            "SCHOTT, N-SF11 data sheet, 2017",
            SellmeierIndex(
                (
                    (1.73759695, 0.013188707),
                    (0.313747346, 0.0623068142),
                    (1.89878101, 155.23629),
                ),
                (370e-9, 2500e-9),
            ),
        ),
        GlassProduct(
            "Fused Silica",
            1.4584,
            "Malitson, J. Opt. Soc. Am. 55 (1965)",
            SellmeierIndex(
                (
                    (0.6961663, 0.0684043**2),
                    (0.4079426, 0.1162414**2),
                    (0.8974794, 9.896161**2),
                ),
                (210e-9, 3710e-9),
            ),
        ),
        GlassProduct(
            "Lead Crystal (24 % PbO)",
            1.545,
            "Council Directive 69/493/EEC (1969): the lowest index allowed for this name",
        ),
        GlassProduct(
            "Polycarbonate",
            1.5846,
            "Sultanova et al., Acta Phys. Pol. A 116 (2009)",
            SellmeierIndex(((1.4182, 0.021304),), _POLYMERS),
        ),
        GlassProduct(
            "Polystyrene",
            1.5915,
            "Sultanova et al., Acta Phys. Pol. A 116 (2009)",
            SellmeierIndex(((1.4435, 0.020216),), _POLYMERS),
        ),
        GlassProduct(
            "Casting Resin (CR-39)",
            1.498,
            "PPG, CR-39 product bulletin, 2006, with PPG's Abbe number, 2013",
            AbbeIndex(1.498, 59.3),
        ),
        GlassProduct(
            "Water",
            1.3333,
            "Daimon and Masumura, Applied Optics 46 (2007), at 20 C",
            SellmeierIndex(
                (
                    (0.5684027565, 0.005101829712),
                    (0.1726177391, 0.01821153936),
                    (0.02086189578, 0.02620722293),
                    (0.1130748688, 10.69792721),
                ),
                (182e-9, 1129e-9),
            ),
        ),
    )
}
