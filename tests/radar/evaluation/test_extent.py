"""The extent of targets by maximum likelihood: the maximum, its standard error, refusals."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d.radar import Mounting, RadarScan, estimate_ego_motion, estimate_extent
from d2d.radar.evaluation.extent import CANDIDATES
from tests.radar.scenes import arc, observe

STILL = np.zeros(3)
MOUNTING = Mounting(2.0, 0.5, 0.1)
SIGMAS = (0.1, 0.004, 0.05)


def drive(seed: int, scatter: float, pairs: int = 20) -> list[RadarScan]:
    """Scans of 40 points; every scan sees each elsewhere, by a normal deviation."""
    rng = np.random.default_rng(seed)
    middles = rng.uniform([8.0, -40.0], [70.0, 40.0], (40, 2))
    found = []
    for time in 0.1 * np.arange(pairs + 1):
        points = middles + scatter * rng.standard_normal(middles.shape)
        noise = rng.standard_normal((3, 40))
        pose = arc(STILL, time)
        found.append(observe(points, pose, time, STILL, MOUNTING, noise, SIGMAS))
    return found


def test_the_curve_is_the_value_of_the_estimates_with_that_extent():
    """Breaks if the likelihood is not that of the ego-motion, or its maximum is not the largest."""
    scans = drive(1, 0.3, pairs=4)

    def log_likelihood(extent: float, first_order: bool) -> float:
        wider = [scan.with_extent(extent) for scan in scans]
        return -sum(
            float(estimate_ego_motion(*pair, MOUNTING, first_order=first_order).value)
            for pair in pairwise(wider)
        )

    for first_order in (True, False):
        found = estimate_extent(scans, MOUNTING, first_order=first_order)
        assert found.pairs == 4
        assert found.targets == 160
        others = [*CANDIDATES, found.extent - 0.01, found.extent + 0.01]
        poorer = max(log_likelihood(extent, first_order) for extent in others)
        assert log_likelihood(found.extent, first_order) > poorer


def test_the_scatter_of_single_points_is_found_with_its_standard_error():
    """Breaks if the variance counts once instead of twice, or the standard error is of e^2."""
    for scatter in (0.15, 1.0):
        found = [estimate_extent(drive(seed, scatter), MOUNTING) for seed in range(12)]
        extents, sigmas = np.array([[each.extent, each.sigma] for each in found]).T
        assert_allclose(extents.mean(), scatter, rtol=0.04)
        squares = ((extents - scatter) / sigmas) ** 2
        # 12 squares: a 99.9 % chi-square region is 0.2 to 2.7
        assert 0.2 < np.mean(squares) < 2.7


def test_points_that_stay_have_no_extent():
    """Breaks if the boundary is not recognised, or its standard error is nan."""
    found = [estimate_extent(drive(seed, 0.0), MOUNTING) for seed in range(12)]
    extents, sigmas = np.array([[each.extent, each.sigma] for each in found]).T
    assert 2 <= (extents == 0.0).sum() <= 10
    assert extents.max() < 0.04
    assert ((sigmas > 0.0) & (sigmas < 0.04)).all()


def test_what_the_scans_carry_and_where_they_are_does_not_matter():
    """Breaks if an extent is added to one that is there already."""
    scans = drive(3, 0.3, pairs=3)
    wide = [scan.with_extent(1.0) for scan in scans]
    assert estimate_extent(wide, MOUNTING).extent == estimate_extent(scans, MOUNTING).extent


def test_pairs_are_spread_over_the_recording():
    """Breaks if only the beginning counts, empty scans are paired, or the baseline is ignored."""
    scans = drive(4, 0.3, pairs=9)
    scans[2] = scans[2][:0]
    assert estimate_extent(scans, MOUNTING).pairs == 7
    assert estimate_extent(scans, MOUNTING, max_pairs=3).pairs == 3
    assert estimate_extent(scans, MOUNTING, max_pairs=None, baseline=7).pairs == 2
    later = scans[:5] + drive(5, 1.0, pairs=9)[5:]  # the second half scatters more
    few, all_of_them = (estimate_extent(later, MOUNTING, max_pairs=n) for n in (3, None))
    assert few.extent > 0.4 < all_of_them.extent


def test_arguments_are_refused_by_name():
    """Breaks if a mistake is found late, or the largest candidate is returned as an extent."""
    scans, rng = drive(0, 0.1, pairs=3), np.random.default_rng(6)
    apart = [
        RadarScan(0.1 * i, rng.uniform(5, 80, 9), rng.uniform(-1, 1, 9), np.zeros(9), *SIGMAS)
        for i in range(4)
    ]
    for change, name in (
        ({"scans": scans[:2]}, "two pairs"),
        ({"scans": scans[::-1]}, "scans"),
        ({"scans": apart, "outlier": None}, r"a likelihood that still grows at 3\.2 m"),
        ({"baseline": 3}, "baseline = 3"),
        ({"max_pairs": 1}, "max_pairs"),
    ):
        with pytest.raises(ValueError, match=name):
            estimate_extent(**({"scans": scans, "mounting": MOUNTING} | change))
