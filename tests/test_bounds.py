"""Bounds: what they hold, they do not refuse, and the other way round."""

import numpy as np
import pytest

from d2d._checks import ANGLE, FINITE, METRES, NOT_NEGATIVE, POSITIVE, Bounds

VALUES = np.array([-np.inf, -400.0, -6.3, -1.0, 0.0, 1e-300, 1.0, 6.3, 400.0, np.inf, np.nan])


def test_what_is_held_is_what_is_not_refused():
    """Breaks if a reader leaves out other targets than a scan refuses."""
    for bounds, held in (
        (FINITE, VALUES[1:9]),
        (POSITIVE, VALUES[5:9]),
        (NOT_NEGATIVE, VALUES[4:9]),
        (ANGLE, VALUES[3:7]),
        (METRES._replace(above=0.0, most=10.0), VALUES[5:8]),
        (Bounds(above=-1.0, least=0.5), VALUES[6:9]),
    ):
        assert VALUES[bounds.hold(VALUES)].tolist() == held.tolist()
        assert bounds.array("these", held).tolist() == held.tolist()
        for value in VALUES[~bounds.hold(VALUES)]:
            with pytest.raises(ValueError, match=r"^this must be (?!.*holds -?\d)"):
                bounds.number("this", value)
            with pytest.raises(ValueError, match=r"^these must be .*holds"):
                bounds.array("these", [*held, value])


def test_a_unit_is_asked_for_only_if_a_number_is_too_large():
    """Breaks if a range of zero is said to be in millimetres."""
    bounds = METRES._replace(above=0.0, most=10.0)
    with pytest.raises(ValueError, match=r"^x must be in m, at most 10, but is 11; are these mi"):
        bounds.number("x", 11)
    with pytest.raises(ValueError, match=r"^x must be positive, but is 0$"):
        bounds.number("x", 0)


def test_a_full_turn_in_single_precision_is_an_angle():
    """Breaks if an array of float32, which rounds 2 pi up, is said to be in degrees."""
    assert ANGLE.number("yaw", np.float32(2.0 * np.pi)) > 2.0 * np.pi
