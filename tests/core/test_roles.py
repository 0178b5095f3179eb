"""The table of roles, and the parts that a rig has by it."""

from dataclasses import fields

from kiriko.core.rig.rig import MET_ROLES, ROLES, Blocker, Kind, Mirror, Rig
from known.reference_rigs import ball_rig, rectangle


def test_each_field_of_a_rig_is_a_role():
    """All parts come with the role whose field has them, in the order of the table."""
    wall = rectangle([0, 0, 0], [1, 0, 0], [0, 0, 1], 1, 1)
    ball = ball_rig(1, pixels=32, display_pixels=32)
    bench = Rig(
        *(getattr(ball, f.name) for f in fields(Rig)[:5]),
        mirrors=(Mirror("one", wall), Mirror("two", wall)),
        blockers=(Blocker("three", wall),),
    )
    found = list(bench.parts())
    assert [role.field for role in ROLES] == [f.name for f in fields(Rig)]
    assert [part.name for _, part in found[-3:]] == ["one", "two", "three"]
    assert all(part in getattr(bench, role.field) for role, part in found)
    assert bench.curved_parts() == (*bench.glasses, *bench.mirrors)


def test_numbers_stay_as_files_and_the_kernel_have_them():
    """Blender's files keep a role's number, and kiriko.h has the kinds as constants."""
    assert [(role.kind, role.name) for role in MET_ROLES] == [
        (0, "GLASS"),
        (1, "PLATE"),
        (2, "MIRROR"),
        (3, "BLOCKER"),
        (4, "DISPLAY"),
        (5, "HALF_MIRROR"),
        (6, "RETROREFLECTOR"),
        (7, "LENS"),
        (8, "POLARISER"),
        (9, "WAVE_PLATE"),
    ]
    assert Kind.DISPLAY == 4

    numbers = {role.number: role.name for role in ROLES if role.number is not None}
    assert numbers == {
        1: "GLASS",
        2: "PLATE",
        3: "MIRROR",
        4: "DISPLAY",
        5: "PICTURE",
        6: "BLOCKER",
        7: "HALF_MIRROR",
        8: "RETROREFLECTOR",
        9: "LENS",
        10: "SCREEN",
        11: "PROJECTOR",
        12: "POLARISER",
        13: "WAVE_PLATE",
    }
