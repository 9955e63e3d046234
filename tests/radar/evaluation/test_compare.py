"""A track against a reference: what is compared, in which units, and how it is shown."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d import block_bootstrap, coverage, credibility, crps, log_score, whiten
from d2d.radar import Comparison, Reference, Track, compare
from d2d.radar.evaluation.compare import check_reference
from tests.radar.evaluation.noisy_tracks import EMPTY, SCALE, failed, noisy, truth

N = 400  # estimates
DEGREES = np.array([1.0, 1.0, 180.0 / np.pi])


def example(factor: float = 1.0) -> tuple[Track, Reference]:
    """A track with errors of ``factor`` times its covariances, and the truth."""
    times = np.arange(N + 1) / 10.0
    return noisy(0, times[1:], factor), Reference(times, truth(times), np.zeros((N + 1, 3)))


def test_errors_are_relative_to_the_reference_at_the_later_scan():
    """Breaks if an estimate is compared with the motion at the scan before."""
    driven, reference = example()
    found = compare(driven, reference)
    assert_array_equal(found.errors, driven.theta - reference.theta[1:])
    assert_array_equal(found.times, driven.times)
    assert_array_equal(found.covariances, driven.covariance)
    assert found.share == found.converged == 1.0


def test_a_reference_at_other_times_is_interpolated():
    """Breaks if estimates and reference are paired by their numbers."""
    at = np.array([0.33, 0.5, 1.21, 1.23])
    reference = Reference(at, truth(at), np.zeros((4, 3)))
    found = compare(noisy(0, np.arange(1, 20) / 10.0, factor=0.0), reference)
    assert_allclose(found.times, np.arange(4, 13) / 10.0)  # those within its time span
    assert_allclose(found.errors, 0.0, atol=1e-12)
    assert found.share == pytest.approx(9 / 19)


def test_what_did_not_converge_or_has_no_reference_is_left_out():
    """Breaks if a prediction is judged as an estimate, or nan spreads over the drive."""
    driven, reference = example()
    theta = reference.theta.copy()
    theta[11, 1] = np.nan  # of estimate 10
    found = compare(failed(driven, 4), replace(reference, theta=theta))
    left = np.delete(np.arange(N), [4, 10])
    assert_array_equal(found.times, driven.times[left])
    assert found.share == pytest.approx(1.0 - 2 / N)
    assert found.converged == pytest.approx(1.0 - 1 / N)
    assert np.isfinite(np.concatenate([np.ravel(m) for m in found.measures])).all()


def test_what_cannot_be_compared_is_refused_by_name():
    """Breaks if clocks that differ give a table of nan."""
    driven, reference = example()
    late = Reference(reference.times + 1e6, reference.theta, reference.poses)
    for given, beside, message in (
        (driven, late, "track and reference have 0 .* clocks"),
        (EMPTY, reference, "have 0 converged"),
        (failed(driven, slice(3, None)), reference, "have 3 converged estimates"),
    ):
        with pytest.raises(ValueError, match=message):
            compare(given, beside)


def test_only_directions_that_the_reference_has_are_judged():
    """Breaks if a gyro alone, or a speed alone, is no reference, or what is missing is judged."""
    driven, reference = example()
    whole = compare(driven, reference)
    for known, lacking in (([2], [0, 1]), ([0, 1], [2])):
        theta = reference.theta.copy()
        theta[:, lacking] = np.nan
        found = compare(driven, replace(reference, theta=theta))
        check_reference(driven, replace(reference, theta=theta))
        e, c = whole.errors[:, known], whole.covariances[:, known][:, :, known]
        assert_allclose(found.rmse[known], whole.rmse[known])
        assert_allclose(found.measures.anees, credibility(e, c).anees)
        assert_allclose(found.measures.log_score, log_score(e, c).mean())
        assert_allclose(found.measures.coverage, coverage(e, c))
        assert_allclose(found.measures.crps[known], whole.measures.crps[known])
        assert found.credibility.anees == credibility(e, c).anees
        for name in ("rmse", "whitened_squares", "coverages"):
            assert np.isnan(getattr(found.measures, name)[lacking]).all()
        assert (found.table.iloc[[0, 1], lacking] == "").all(axis=None)


GYRO = np.array([np.nan, np.nan, 1.0])
WRONG = {
    "the same": (lambda times, theta: (times, theta), ""),
    "another clock": (lambda times, theta: (times + 5.0, theta), r"clock, .* those of \+5\.0 s"),
    "an early clock": (lambda times, theta: (times - 0.7, theta), r"clock, .* those of -0\.7 s"),
    "nearly its clock": (lambda times, theta: (times + 0.3, theta), ""),
    "km/h": (lambda times, theta: (times, theta * [3.6, 3.6, 1.0]), r"speed, .* by 0\.278"),
    "deg/s": (lambda times, theta: (times, theta * [1.0, 1.0, 57.3]), r"yaw rate, .* by 0\.017"),
    "clockwise": (lambda times, theta: (times, theta * [1, 1, -1]), r"yaw rate, .* -1\.0.*clockw"),
    "a poor speedometer": (lambda times, theta: (times, theta * [1.2, 1.0, 0.8]), ""),
    "a clockwise gyro": (lambda times, theta: (times, -theta * GYRO), "yaw rate, .* -1.0.*clockw"),
    "a late gyro": (lambda times, theta: (times + 5.0, theta * GYRO), "clock, .* yaw r"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_reference_of_another_clock_unit_or_sign_is_refused(case):
    """Breaks if its errors are printed as the track's, or a right one is doubted."""
    times = np.arange(0.0, 60.0, 0.1)
    swing = np.sin(0.01 * times**2)  # never the same again
    theta = np.column_stack([10.0 + 4.0 * swing, 0.0 * times, 0.2 * swing])
    covariance = np.tile(1e-4 * np.eye(3), (len(times), 1, 1))
    driven = Track(times, np.full_like(times, 0.1), theta, covariance, times >= 0.0)
    change, message = WRONG[case]
    beside = Reference(*change(times, theta), np.full_like(theta, np.nan))
    if not message:
        check_reference(driven, beside)
        return
    with pytest.raises(ValueError, match=f"^reference must have the track's {message}"):
        check_reference(driven, beside)


def test_measures_are_those_of_the_errors():
    """Breaks if a column of the table is another than it says, or of another unit."""
    found = compare(*example(factor=2.0))
    e, c = found.errors, found.covariances
    parts = whiten(e, c, (2, 1, 0))
    m = found.measures
    assert_allclose(m.mean_error, e.mean(axis=0) * DEGREES)
    assert_allclose(m.rmse, np.sqrt((e**2).mean(axis=0)) * DEGREES)
    assert_allclose(found.rmse, m.rmse)
    sigmas = np.sqrt(np.stack([c[:, i, i] for i in range(3)], axis=1))
    assert_allclose(found.sigmas, sigmas * DEGREES)
    assert_allclose(m.crps, crps(e * DEGREES, sigmas * DEGREES).mean(axis=0))
    assert_allclose(m.whitened_squares, (parts.values**2).mean(axis=0))
    assert_allclose(m.anees, credibility(e, c).anees)
    assert_allclose(m.anees, m.whitened_squares.mean())
    assert_allclose(m.log_scores, parts.log_score.mean(axis=0))
    assert_allclose(m.log_score, log_score(e, c).mean())
    assert_allclose(m.coverage, coverage(e, c))
    assert_allclose(m.coverages, parts.within().mean(axis=0))
    assert found.credibility.anees == credibility(e, c).anees


def test_intervals_are_those_of_each_statistic():
    """Breaks if bounds are given to another measure, or of the square of an RMSE."""
    found = compare(*example())
    bounds = found.intervals(0.9)
    for name, statistic in {
        "rmse": lambda e, c: np.sqrt((e**2).mean(axis=0)) * DEGREES,
        "anees": lambda e, c: credibility(e, c).anees,
        "log_score": lambda e, c: log_score(e, c).mean(),
        "coverage": coverage,
        "coverages": lambda e, c: whiten(e, c, (2, 1, 0)).within().mean(axis=0),
    }.items():
        rng, drawn = np.random.default_rng(0), [found.errors, found.covariances]
        direct = block_bootstrap(statistic, drawn, found.block, rng, confidence=0.9)
        assert_allclose(getattr(bounds, name), direct, rtol=1e-4)
    for value, (low, high) in zip(found.measures, bounds, strict=True):
        assert (low <= value).all()
        assert (value <= high).all()


def test_errors_of_singular_covariances_have_an_rmse():
    """Breaks if the errors of a track that is sure of a velocity cannot be told."""
    driven, reference = example()
    driven = replace(driven, covariance=driven.covariance * np.outer([1, 0, 1], [1, 0, 1]))
    found = compare(driven, reference)
    assert_array_equal(found.rmse, compare(*example()).rmse)
    with pytest.raises(ValueError, match="covariances must be positive definite"):
        str(found)


def test_slow_errors_have_wider_intervals():
    """Breaks if the correlation in time of the errors, or of their size, is not accounted for."""
    driven, reference = example()
    slow = np.repeat(np.random.default_rng(4).standard_normal((N // 20, 3)), 20, axis=0)
    found = Comparison.from_errors(driven, slow * SCALE)
    assert found.block > 10
    rng, errors = np.random.default_rng(0), [found.errors * DEGREES]
    if_independent = np.ptp(block_bootstrap(lambda e: e.mean(axis=0), errors, 1, rng), axis=0)
    assert (np.ptp(found.intervals().mean_error, axis=0) > 2.0 * if_independent).all()
    assert compare(driven, reference).block <= 5
    size = np.repeat(np.tile([0.1, 3.0], N // 40), 20)[:, None]
    calm_and_rough = size * SCALE * np.random.default_rng(0).standard_normal((N, 3))
    assert Comparison.from_errors(driven, calm_and_rough).block > 10


def test_the_table_holds_each_number_in_its_column():
    """Breaks if a direction stands below another's name, or a print is not repeatable."""
    found = compare(*example(factor=3.0))
    table, m = found.table, found.measures
    assert list(table.columns) == ["v_x (m/s)", "v_y (m/s)", "omega (deg/s)", "all"]
    assert table.loc["RMSE"].tolist() == [*(f"{value:.3f}" for value in m.rmse), ""]
    squares = [*m.whitened_squares, m.anees]
    assert table.loc["whitened square"].tolist() == [f"{value:.2f}" for value in squares]
    inside = [*m.coverages[:, 1], m.coverage[1]]
    assert table.loc["within 95%"].tolist() == [f"{value:.1%}" for value in inside]
    low, high = found.intervals().rmse
    below = table.iloc[1 + table.index.get_loc("RMSE")]
    assert below.iloc[2] == f"[{low[2]:.3f},{high[2]:.3f}]"
    text = str(found)
    assert text.startswith(f"{N} estimates compared, 100.0% of the track; 100.0% converged")
    assert f"ANEES {m.anees:.2f} " in text
    assert max(map(len, text.splitlines())) <= 82  # as wide as the text of a page
    assert text == str(compare(*example(factor=3.0)))


def test_only_the_table_of_a_comparison_needs_pandas(monkeypatch):
    """Breaks if its numbers need it, too."""
    monkeypatch.setitem(sys.modules, "pandas", None)
    found = compare(*example())
    assert found.measures.anees > 0.0
    with pytest.raises(ModuleNotFoundError, match="pandas"):
        str(found)
