"""How light a picture is wanted, and how a display shines: closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from kiriko.core.base.errors import RigError
from kiriko.core.base.steps import run_steps
from kiriko.core.files.encoding import encode
from kiriko.core.image.tone import Tone
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.session import Session
from known.reference_rigs import box, rig

RANDOM = np.random.default_rng(5)


def test_no_tone_is_the_image_itself():
    """Not one bit is changed, nor is anything copied."""
    image = RANDOM.random((8, 6, 4)).astype(np.float32)
    assert Tone().of(image) is image


@pytest.mark.parametrize("tone", [Tone(2.5), Tone(0.3, 2.2), Tone(1, 0.5, 0.2), Tone(3, 1, 0.1)])
def test_a_tone_is_its_formula(tone):
    """Straight colours through B max((c - b) / (1 - b), 0)^(1 / g), times alpha; alpha stays."""
    alpha = RANDOM.random((700, 400, 1)) * (RANDOM.random((700, 400, 1)) > 0.1)
    straight = 1.5 * RANDOM.random((700, 400, 3))
    image = np.concatenate([straight * alpha, alpha], axis=2).astype(np.float32)
    above = np.maximum((straight - tone.black_level) / (1 - tone.black_level), 0)
    wanted = tone.brightness * above ** (1 / tone.gamma) * alpha

    found = tone.of(image)
    # float32 of the quotient: at black the slope of a gamma above 1 has no bound
    assert (np.abs(found[..., :3] - wanted) <= np.maximum(1e-4 * np.abs(wanted), 2e-3)).all()
    assert np.array_equal(found[..., 3:], alpha.astype(np.float32))
    assert np.isfinite(found).all()


@pytest.mark.parametrize("gamma", [1.0, 1.8, 2.2, 2.4])
def test_a_power_is_undone_by_its_power(gamma):
    """A display of this gamma shows the light that was encoded for it; sRGB is the default."""
    light = np.linspace(0, 1, 1001)
    assert encode(light, gamma) ** gamma == pytest.approx(light, abs=1e-14)
    srgb = encode(light)
    decoded = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    assert decoded == pytest.approx(light, abs=1e-6)


def grey_rig(grey, black_level):
    """A cube on the bench with a grey card, whose display's black shines."""
    image = np.full((4, 4, 4), (grey, grey, grey, 1), np.float32)
    a_rig = rig(box([0.3, 0.02, 0.3]), pixels=16, display_pixels=16, image=image)
    return replace(a_rig, displays=(replace(a_rig.display, black_level=black_level),))


@pytest.mark.parametrize("black_level", [0.0, 0.001, 0.05, 0.5])
def test_black_level_is_made_up_for(black_level):
    """Where the display can, it shines as it would without: b + (1 - b) x is the wanted light.

    So the viewer sees the same, where light comes from pixels that have a colour.
    """
    plain = run_steps(Session().solve(grey_rig(0.6, 0.0)))
    found = run_steps(Session().solve(grey_rig(0.6, black_level)))
    is_seen = plain.source[..., 0] > black_level
    wanted = (plain.source - black_level) / (1 - black_level)
    assert found.source[is_seen] == pytest.approx(np.maximum(wanted, 0)[is_seen], abs=1e-6)
    shown = found.rig.display.light_of(found.source)
    assert shown[is_seen] == pytest.approx(plain.source[is_seen], abs=1e-6)
    assert found.source.min() >= 0

    middle = plain.seen()[7:9, 7:9]
    assert middle == pytest.approx(0.6, abs=1e-3)
    assert found.seen()[7:9, 7:9] == pytest.approx(middle, abs=1e-6)


def test_darker_than_black_is_told():
    """A picture darker than the display's black is shown as dark as it can be, which is told."""
    found = run_steps(Session().solve(grey_rig(0.02, 0.05)))
    assert not found.source.any()
    (note,) = found.notes
    assert note.startswith("100 % of the source image should be darker than the black of")
    assert "5 % of white" in note
    assert "Picture Brightness" in note
    assert "Black Level" in note
    assert not run_steps(Session().solve(grey_rig(0.2, 0.05))).notes


def test_another_black_level_traces_nothing():
    """Light lands where it did."""
    session = Session()
    run_steps(session.solve(grey_rig(0.6, 0.0)))
    assert run_steps(session.solve(grey_rig(0.6, 0.1))).n_rays == 0


@pytest.mark.parametrize("black_level", [-0.1, 1.0, np.nan])
def test_a_black_as_light_as_white_is_refused(black_level):
    """In one sentence that names the display."""
    with pytest.raises(RigError, match=r"The display '.*' has Black Level .*: set it from 0"):
        run_steps(Session().solve(grey_rig(0.5, black_level), Settings()))
