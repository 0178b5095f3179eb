"""Rigs that scripts write by hand."""

from dataclasses import fields, replace

import numpy as np
import pytest

from kiriko.core.base.errors import KirikoError, RigError
from kiriko.core.base.fingerprint import fingerprint
from kiriko.core.rig.rig import ROLES, Picture, Rig
from known.reference_rigs import ball_rig


def in_lists(part):
    """A part with lists in place of its arrays and of those of its mesh."""
    changed = {one.name: getattr(part, one.name) for one in fields(part)}
    for name, value in changed.items():
        if isinstance(value, np.ndarray):
            changed[name] = value.tolist()
        elif name == "mesh" and value is not None:
            changed[name] = in_lists(value)
    return replace(part, **changed)


def test_lists_become_arrays_and_tuples():
    """A rig of lists has the content of the same rig of arrays and tuples."""
    rig = ball_rig(levels=1)
    lists = Rig(**{role.field: [in_lists(part) for part in rig.of(role)] for role in ROLES})
    assert fingerprint(lists) == fingerprint(rig)


@pytest.mark.parametrize(
    ("role", "changes", "sentence"),
    [
        ("displays", {"uv": np.zeros((4, 2))}, r"has uv of shape \(4, 2\): give it the shape \(2,"),
        ("glasses", {"surface": "round"}, "has surface 'round': set it to one of 'automatic',"),
        ("viewers", {"projection": "flat"}, "has projection 'flat': set it to one of 'persp"),
        ("pictures", {"image": np.ones((4, 4))}, r"has image of shape \(4, 4\): give it the shape"),
    ],
)
def test_a_wrong_field_is_named(role, changes, sentence):
    """An array of the wrong shape, and a word that is no choice, are refused by name."""
    rig = ball_rig(levels=1)
    (part,) = getattr(rig, role)
    if set(changes) <= vars(part).keys():
        part = replace(part, **changes)
    else:
        part = replace(part, mesh=replace(part.mesh, **changes))
    with pytest.raises(KirikoError, match=sentence):
        replace(rig, **{role: (part,)}).check()


def test_whole_numbers_are_no_light() -> None:
    """A picture of bytes would be 255 times too bright: it is refused with the reason."""
    with pytest.raises(RigError, match="pixels of type uint8"):
        Picture("P", np.full((4, 4, 4), 255, np.uint8))
