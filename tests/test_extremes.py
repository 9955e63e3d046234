"""Arguments that no user means: each is refused by its name, and nothing hangs."""

import numpy as np
import pytest

from d2d import (
    PointSet,
    block_bootstrap,
    multi_start,
    register,
    rigid,
    sandwich_covariance,
    whiten,
)
from d2d.covariance import _sandwich
from d2d.radar import (
    RadarScan,
    VehicleLimits,
    calibrate,
    compare,
    compare_halves,
    simulate_drive,
    track,
)

EYE = np.eye(2)
MEANS = np.array([[8.0, 1.0], [5.0, -3.0], [6.0, 4.0]])
POINTS = PointSet(MEANS, [0.04 * EYE] * 3)
BATCH = PointSet(np.tile(MEANS, (4, 1, 1)), [0.04 * EYE] * 3)
DRIVE = simulate_drive(np.random.default_rng(0), duration=1.0)
SENSORS = [(DRIVE.scans, DRIVE.mounting)]
RNG = np.random.default_rng(0)
MASKED = np.ma.array([0.0, 1.0, 2.0], mask=[0, 1, 0])


def cartesian(**options):
    """The scan of one target, with one argument that is out of any range."""
    sigmas = {"sigma_range": 0.1, "sigma_azimuth": 0.1, "sigma_doppler": 0.1}
    return RadarScan.from_cartesian(0.0, [1.0], [1.0], doppler=[0.0], **(sigmas | options))


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: track(SENSORS[0], side_slip=1e-200), "side_slip must"),
        (lambda: track(SENSORS[0], side_slip=1e200), "side_slip must"),
        (lambda: track(SENSORS[0], initial=DRIVE.scans[0]), "initial must"),
        (lambda: PointSet(DRIVE.scans, EYE), "means must"),
        (lambda: PointSet(MEANS, np.zeros((0, 3, 2, 2))), "covariances must"),
        (lambda: PointSet(MEANS, [EYE] * 3, np.zeros((0, 3))), "weights must"),
        (lambda: PointSet([MASKED[1:], [1.0, 2.0]], [EYE] * 2), "means must not hold masked"),
        (lambda: POINTS.inflated(1e300), "scale must"),
        (lambda: POINTS.inflated(1e-300), "scale must"),
        (lambda: register(POINTS, POINTS, scales=(1e300, 1.0)), "scale must"),
        (lambda: BATCH.transformed(np.zeros((3, 3))), "theta and means"),
        (lambda: rigid.compose(np.zeros((3, 3)), np.zeros((4, 3))), "first and second"),
        (lambda: rigid.compose(np.zeros((3, 1)), np.zeros((4, 1))), "first and second"),
        (lambda: rigid.transform_covariances(np.zeros((3, 3)), BATCH.covariances), "theta and cov"),
        (lambda: VehicleLimits(speed=np.ones(3)), "speed must"),
        (lambda: cartesian(grid=1e300), "grid must"),
        (lambda: cartesian(step=1e300), "step must"),
        (
            lambda: DRIVE.scans[0].doppler_measurement(DRIVE.mounting, 0.1, of_twist="no"),
            "of_twist",
        ),
        (lambda: compare_halves(SENSORS, RNG, by=np.array(["target", "object"])), "by must"),
        (lambda: calibrate([(*SENSORS[0], DRIVE.truth)], max_lag=1e300), "max_lag must"),
        (lambda: whiten(np.ones((5, 3)), np.eye(3), MASKED), "order must"),
        (lambda: block_bootstrap(np.mean, [MASKED], 1, RNG), "arrays must not hold masked"),
        (
            lambda: sandwich_covariance(
                register(POINTS, POINTS), POINTS, POINTS, groups=[[1, 2], [3]]
            ),
            "groups must",
        ),
    ],
)
def test_it_is_refused_by_name(call, said):
    """Breaks if NumPy's or Python's own error comes out, or a number that means nothing."""
    with pytest.raises(ValueError, match=said):
        call()


def test_numbers_beyond_64_bits_do_not_hang_or_overflow():
    """Breaks if there is a thread for each number that was asked for, or a baseline overflows."""
    found = multi_start(BATCH, BATCH, None, np.zeros((2, 3)), threads=2**63)
    assert found.converged.all()
    first = track(SENSORS[0], baseline=2**63)
    assert (first.theta == track(SENSORS[0], baseline=100).theta).all()


def test_a_comparison_is_read_only():
    """Breaks if its cached numbers no longer belong to its errors."""
    found = compare(track(SENSORS[0]), DRIVE.truth)
    for array in (found.times, found.errors, found.covariances):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0


def test_a_product_of_nearly_singular_matrices_has_no_negative_variance():
    """Breaks if what rounding leaves of a large inverse Hessian is taken as it is.

    The product itself has a negative variance in many of these, by its rounding.
    """
    lost = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        axes = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        inverse = (axes * [1e14, 1.0, 1.0]) @ axes.T
        root = axes[:, 1:] @ rng.standard_normal((2, 2))
        middle = root @ root.T
        lost += (np.diag(inverse @ middle @ inverse) < 0.0).any()
        found = _sandwich(inverse, middle)
        assert (np.diag(found) >= 0.0).all()
        assert (found == found.T).all()
    assert lost > 20
