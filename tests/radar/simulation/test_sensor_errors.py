"""What can be wrong with a simulated radar: each error does what it says, and nothing else."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d.radar import Sensor, SensorErrors, build_world, doppler_velocity, simulate_drive
from d2d.radar.simulation.drive import CAR_MOUNTING, CAR_SPEED, STEPS

EXACT = Sensor(quantised=False)


def drive(errors: SensorErrors | None = None, sensor: Sensor = EXACT, **options):
    options |= {"mounting": CAR_MOUNTING, "sensor": sensor, "errors": errors}
    return simulate_drive(np.random.default_rng(5), 2.0, CAR_SPEED, **options)


def targets(driven, name):
    return np.concatenate([getattr(scan, name) for scan in driven.scans])


def true(driven, name):
    return np.concatenate([getattr(each, name) for each in driven.targets])


def test_without_errors_the_drives_are_those_of_before():
    """Breaks if a new error costs the generator a number although it is off."""
    driven = simulate_drive(np.random.default_rng(0), 2.0)
    steps = [
        np.rint(getattr(driven.scans[20], name)[:4] / step).astype(int).tolist()
        for name, step in zip(("range", "azimuth", "doppler"), STEPS[:, 0], strict=True)
    ]
    assert steps == [[177, 170, 174, 166], [-2825, 2549, 3331, -3050], [-42, -44, -40, -39]]
    off = simulate_drive(np.random.default_rng(0), 2.0, errors=SensorErrors())
    for a, b in zip(driven.scans, off.scans, strict=True):
        assert_array_equal(a.azimuth, b.azimuth)


def test_constant_errors_change_what_is_measured_of_real_targets():
    """Breaks if a sign is turned, the scale takes the offset too, or false targets are moved."""
    wrong = drive(SensorErrors(azimuth=0.02, doppler=0.3, scale=-0.05))
    plain = drive()
    assert_array_equal(true(wrong, "azimuth"), true(plain, "azimuth"))
    real = true(plain, "point") >= 0
    assert 0.5 < real.mean() < 1.0
    exact = true(plain, "doppler")[real]
    turned = targets(wrong, "azimuth") - targets(plain, "azimuth")
    assert_allclose(turned, np.where(real, 0.02, 0.0), rtol=0, atol=1e-12)
    assert_array_equal(targets(wrong, "range"), targets(plain, "range"))
    shifted = targets(wrong, "doppler") - targets(plain, "doppler")
    assert_allclose(shifted[real], 0.3 - 0.05 * exact, rtol=0, atol=1e-12)
    assert_array_equal(shifted[~real], 0.0)


def test_a_scan_that_lags_shows_the_world_of_before():
    """Breaks if the lag has the wrong sign, or moves the truth or the time stamps."""
    world = build_world(np.random.default_rng(1), movers=0)
    late = drive(SensorErrors(lag=0.25), world=world, start=5.0)
    before, now = (drive(world=world, start=start) for start in (4.75, 5.0))
    assert [scan.time for scan in late.scans] == [scan.time for scan in now.scans]
    assert_array_equal(late.truth.theta, now.truth.theta)
    for name in ("range", "azimuth", "doppler"):
        assert_allclose(targets(late, name), targets(before, name), rtol=0, atol=1e-9)
    assert np.abs(before.truth.theta - now.truth.theta).max() > 0.1, "else nothing is tested"


def test_movers_lag_too():
    """Breaks if the movers are seen at another instant than what stands still."""
    world = build_world(np.random.default_rng(1), movers=60)
    late = drive(SensorErrors(lag=0.25), world=world)
    places, _ = world.movers.at(late.truth.times - 0.25)
    first = len(late.world.kind)
    pose = simulate_drive(
        np.random.default_rng(0), 2.0, CAR_SPEED, sensor=Sensor(half_range=1e-3), start=-0.25
    ).truth.poses
    seen = 0
    for i, each in enumerate(late.targets):
        for k in np.flatnonzero(each.kind == "moving"):
            at = each.range[k] * np.exp(1j * each.azimuth[k]) + CAR_MOUNTING.x
            at = at * np.exp(1j * pose[i, 2]) + complex(*pose[i, :2])
            assert_allclose([at.real, at.imag], places[i, each.point[k] - first], atol=1e-9)
            seen += 1
    assert seen > 3


def test_a_drive_is_a_part_of_the_lap_and_can_start_anywhere():
    """Breaks if the lap shrinks with the duration, or the start shifts the time stamps."""
    whole = simulate_drive(np.random.default_rng(0), 8.0, CAR_SPEED, sensor=EXACT)
    for part, rows in ((drive(), slice(0, 21)), (drive(start=6.0), slice(60, None))):
        assert part.truth.times[0] == part.scans[0].time == 0.0
        assert_allclose(part.truth.poses, whole.truth.poses[rows], rtol=0, atol=1e-9)
        assert_allclose(part.truth.theta, whole.truth.theta[rows], rtol=0, atol=1e-9)


def places(driven):
    """Where the real targets are in the sensor's frame, as complex numbers, and their points."""
    real = true(driven, "point") >= 0
    at = true(driven, "range") * np.exp(1j * true(driven, "azimuth"))
    return at[real], true(driven, "point")[real]


def test_an_extent_scatters_the_same_targets():
    """Breaks if the extent is not a standard deviation, if it changes what is detected, or if the
    Doppler velocity stays that of the reflection point."""
    wide, plain = drive(SensorErrors(extent=0.4)), drive()
    (moved, of), (exact, point) = places(wide), places(plain)
    assert_array_equal(of, point)
    shift = moved - exact
    count = len(shift)
    assert count > 500
    for part in (shift.real, shift.imag):
        assert abs(part.mean()) < 4.0 * 0.4 / np.sqrt(count)
        assert_allclose(part.std(), 0.4, rtol=4.0 / np.sqrt(2.0 * count))
    again = [np.flatnonzero(point == k) for k in np.unique(point)]
    pairs = np.array([(k[0], k[1]) for k in again if len(k) > 1])
    product = np.mean(shift[pairs[:, 0]].real * shift[pairs[:, 1]].real)
    assert abs(product) < 4.0 * 0.4**2 / np.sqrt(len(pairs)), "drawn anew in each scan"
    noise = targets(wide, "azimuth") - true(wide, "azimuth")
    same = targets(plain, "azimuth") - true(plain, "azimuth")
    assert_allclose(noise, same, rtol=0, atol=1e-12)
    for theta, each in zip(wide.truth.theta, wide.targets, strict=True):
        still = each[(each.point >= 0) & (each.kind != "moving")]
        predicted = doppler_velocity(theta, still.azimuth, CAR_MOUNTING)
        assert_allclose(still.doppler, predicted, rtol=0, atol=1e-12)


def test_neighbours_move_alike():
    """Breaks if the correlation is not exp(-distance / length), the same along both axes."""
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0], [1.0, 2.0], [30.0, 5.0]])
    distance = np.linalg.norm(points[:, None] - points, axis=-1)
    rng = np.random.default_rng(3)
    for length, expected in ((0.0, np.eye(5)), (1.5, np.exp(-distance / 1.5))):
        errors = SensorErrors(extent=0.5, neighbours=length)
        shift = np.array([errors.moved(rng, points) for _ in range(20_000)]) - points
        found = np.einsum("nka,nlb->abkl", shift, shift) / len(shift)
        for a, b in np.ndindex(2, 2):
            assert_allclose(found[a, b], 0.25 * (a == b) * expected, rtol=0, atol=0.25 * 0.04)


def test_coarser_steps_only_where_there_are_steps():
    """Breaks if the factor is not that of the measured values' steps."""
    coarse = drive(SensorErrors(rounding=4.0), sensor=Sensor())
    fine = drive(sensor=Sensor())
    for name, step in zip(("range", "azimuth", "doppler"), STEPS[:, 0], strict=True):
        parts = targets(coarse, name) / (4.0 * step)
        assert_allclose(parts, np.round(parts), rtol=0, atol=1e-9)
        assert np.ptp(targets(fine, name) / (4.0 * step) % 1.0) > 0.5
    assert_array_equal(targets(coarse, "sigma_doppler"), targets(fine, "sigma_doppler"))
    assert_array_equal(
        targets(drive(SensorErrors(rounding=4.0)), "range"), targets(drive(), "range")
    )


def test_bad_errors_are_refused():
    """Breaks if a number out of range is accepted, or the message does not name it."""
    for name, value, reason in (
        ("azimuth", 30.0, "radians"),
        ("doppler", np.nan, "finite"),
        ("scale", -1.0, "above -1"),
        ("extent", -0.1, "at least 0"),
        ("rounding", 0.0, "positive"),
    ):
        with pytest.raises(ValueError, match=rf"^{name} must .*{reason}"):
            SensorErrors(**{name: value})
