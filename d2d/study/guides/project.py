"""Three logs with one hidden fault each, for readers to find; the answers are below."""

import numpy as np

from d2d._checks import check_choice
from d2d.radar import Drive, SensorErrors, simulate_drive
from d2d.radar.simulation.drive import CAR_MOUNTING, CAR_SPEED

_FAULTS = {
    "first": SensorErrors(scale=0.02),
    "second": SensorErrors(azimuth=np.deg2rad(-0.8)),
    "third": SensorErrors(lag=0.2),
}


def hidden_log(name: str, duration: float = 60.0) -> Drive:
    """Return the "first", "second" or "third" log of a simulated front radar, and the truth."""
    check_choice("name", name, _FAULTS)
    rng = np.random.default_rng(list(_FAULTS).index(name))
    errors = _FAULTS[name]
    return simulate_drive(rng, duration, CAR_SPEED, mounting=CAR_MOUNTING, errors=errors)
