"""Noise of a sensor that measures range and azimuth."""

import numpy as np

from d2d._types import Array


def noisy_polar(
    rng: np.random.Generator,
    positions: Array,
    sigma_range: float,
    sigma_azimuth: float,
    draws: tuple[int, ...] = (),
) -> tuple[Array, Array]:
    """Simulate noisy measurements of positions (..., N, 2) in m.

    Returns ranges in m and azimuths in rad, each of shape ``(*draws, ..., N)``.  The noise is
    Gaussian and independent, with standard deviations in m and rad.
    """
    x, y = positions[..., 0], positions[..., 1]
    noise = rng.standard_normal((2, *draws, *x.shape))
    return np.hypot(x, y) + sigma_range * noise[0], np.arctan2(y, x) + sigma_azimuth * noise[1]
