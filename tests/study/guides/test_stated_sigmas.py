"""Wrong standard deviations: what shows, and what does not."""

import matplotlib.pyplot as plt
import numpy as np
from numpy.testing import assert_allclose

from d2d.study.guides.stated_sigmas import (
    FACTORS,
    draw_stated_sigmas,
    front_drive,
    rounded,
    scaled,
    stated_sigmas,
)


def test_azimuth_and_doppler_decide_on_the_covariance():
    """Breaks if a wrong standard deviation changes something else than the page says."""
    found = stated_sigmas()
    at = {name: dict(zip(FACTORS, rows, strict=True)) for name, rows in found.items()}
    assert 0.8 < at["azimuth"][1.0].anees < 1.4
    assert at["azimuth"][0.5].anees > 2.0 * at["azimuth"][1.0].anees
    assert at["doppler"][0.5].anees > 1.6 * at["doppler"][1.0].anees
    assert at["range"][0.5].anees < 1.3 * at["range"][1.0].anees
    for name in at:
        for factor in (0.5, 2.0):
            assert at[name][factor].rmse[2] < 1.3 * at[name][1.0].rmse[2]
    _, axes = plt.subplots(1, 3)
    draw_stated_sigmas(axes, found)
    assert [len(ax.lines) for ax in axes] == [4, 4, 4]


def test_scans_are_rounded_and_scaled():
    """Breaks if the steps, or what is told of them, are not those asked for."""
    scan = front_drive().scans[0]
    (coarse,) = rounded([scan], 0.5, 0.3)
    assert_allclose(coarse.doppler * 2.0, np.round(coarse.doppler * 2.0))
    assert np.abs(coarse.doppler - scan.doppler).max() <= 0.25
    assert_allclose(coarse.sigma_doppler**2, scan.sigma_doppler**2 + 0.09)
    half = scaled(scan, 0.5)
    assert_allclose(half.sigma_range, 0.5 * scan.sigma_range)
    assert_allclose(half.sigma_azimuth, 0.5 * scan.sigma_azimuth)
    assert_allclose(half.sigma_doppler, 0.5 * scan.sigma_doppler)
    assert_allclose(half.doppler, scan.doppler)
