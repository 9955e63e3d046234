"""Wrong standard deviations: what shows, and what does not."""

import numpy as np
from numpy.testing import assert_allclose

from d2d.study.guides.stated_sigmas import front_drive, rounded, scaled


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
