"""A track: what it holds, its poses, its velocities at other times, in words and as a picture."""

from dataclasses import fields, replace

import numpy as np
import pytest
from matplotlib import pyplot as plt
from numpy.testing import assert_allclose, assert_array_equal

from d2d.radar import ErrorBudget, Track, simulate_drive, track
from d2d.radar.tracks.path import independent

N = 40


def example(*, errors: bool = True, known: bool = True) -> Track:
    """A track whose numbers have all their digits, with three failures."""
    rng = np.random.default_rng(7)
    intervals = rng.uniform(0.05, 0.15, N)
    converged = np.ones(N, dtype=bool)
    converged[[4, 20, 21]] = False
    root = rng.standard_normal((N, 3, 4)) * np.array([0.1, 0.2, 0.02])[:, None]
    covariances = root @ np.swapaxes(root, -1, -2)
    covariances[~converged] = np.nan
    reasons = np.full(N, "", dtype="<U60")
    reasons[4] = "a scan without targets"
    reasons[[20, 21]] = ["a speed of 120.5 m/s", "a speed of 98.0 m/s"]
    driven = Track(
        1.6e9 + np.cumsum(intervals),
        intervals,
        rng.uniform([-5.0, -1.0, -1.0], [20.0, 1.0, 1.0], (N, 3)),
        covariances,
        converged,
        errors=np.pad(independent(covariances), [(0, 0)] * 3 + [(0, 5)]) if errors else None,
    )
    if not known:
        return driven
    inliers = np.where(converged, rng.uniform(size=N), np.nan)
    return replace(driven, reasons=reasons, targets=rng.integers(0, 90, N), inliers=inliers)


def all_with(covariance) -> dict[str, np.ndarray]:
    """The change of a track that states one covariance everywhere."""
    return {"covariance": np.broadcast_to(np.asarray(covariance, dtype=float), (N, 3, 3))}


def test_what_is_no_track_is_refused():
    """Breaks if times out of order are interpolated, nan passes for an estimate, integers choose
    rows where a mask is meant, or only pairs of a covariance's components are looked at."""
    driven = example()
    torn = [[1.0, 0.9, 0.9], [0.9, 1.0, -0.9], [0.9, -0.9, 1.0]]
    for changed, said in (
        ({"theta": np.zeros((3, 3))}, r"theta must have the shape \(40, 3\)"),
        ({"reasons": np.array(["a"])}, r"reasons must have the shape \(40,\)"),
        ({"converged": driven.converged.astype(int)}, "converged must be an array of bool"),
        ({"converged": np.ma.array(driven.converged, mask=True)}, "converged must not hold masked"),
        *(
            ({"errors": np.zeros((N, *rest))}, r"errors must have the shape \(40, 2, 6")
            for rest in ((6, 6), (2,), (2, 3, 3), (2, 6, 5), (2, 8, 8))
        ),
        ({"times": np.zeros(N)}, "times must be finite and strictly increasing"),
        ({"times": np.append(np.arange(N - 1.0), np.nan)}, "times must be finite"),
        ({"intervals": -driven.intervals}, "intervals must be finite and positive"),
        ({"intervals": np.full(N, np.nan)}, "intervals must be finite and positive, or nan"),
        ({"reasons": np.full(N, "")}, "reasons must be empty where converged is true, and only"),
        ({"reasons": np.full(N, "lost")}, "reasons must be empty where converged is true"),
        ({"targets": np.full(N, -1)}, "targets must not be negative"),
        ({"inliers": np.full(N, 7.5)}, "inliers must be between 0 and 1, or nan"),
        ({"intervals": np.full(N, 50.0)}, "intervals must add up to the diff"),
        ({"converged": np.ones(N, dtype=bool)}, "covariance must be finite wherever converged"),
        ({"theta": np.full((N, 3), np.nan)}, "theta must be finite wherever converged"),
        (all_with([[1.0, 0.1, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), "covariance must be sym"),
        (all_with(-np.eye(3)), "covariance must be positive semidefinite"),
        (all_with([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), "covariance must be pos"),
        (all_with(torn), "covariance must be positive semidefinite"),
    ):
        with pytest.raises(ValueError, match=f"^{said}"):
            replace(driven, **changed)


def test_intervals_fit_the_times_to_within_the_rounding_of_stamps():
    """Breaks if a path is driven for longer than it took, or a log with rounded times refused."""
    driven = example()
    rounded = replace(driven, times=driven.times.round(3))  # to milliseconds
    assert_allclose(rounded.poses(), driven.poses(), atol=0.05)
    kept = np.delete(np.arange(N), 7)
    rows = {field.name: getattr(driven, field.name)[kept] for field in fields(Track)}
    with pytest.raises(ValueError, match=r"^intervals must add up .* to number 7 they"):
        Track(**rows)
    rows["intervals"] = np.append(driven.intervals[0], np.diff(rows["times"]))
    assert Track(**rows).poses().shape == (N, 3)


# ---- at other times


def test_at_the_times_of_its_estimates_a_track_gives_them():
    """Breaks if a neighbour has a say at the time itself, or a failed estimate passes for one."""
    driven = example()
    found = driven.at(driven.times)
    good = driven.converged
    assert_array_equal(found.theta[good], driven.theta[good])
    assert_array_equal(found.covariance[good], driven.covariance[good])
    assert np.isnan(found.theta[~good]).all()
    assert np.isnan(found.covariance[~good]).all()


def test_rounding_of_times_does_not_make_a_gap():
    """Breaks if of a track of 10 Hz in which one estimate is missing, times since 1970 decide."""
    for origin in (0.0, 0.3, 1.6e9 + 0.7):
        times = np.delete(origin + 0.1 * np.arange(N + 20), np.arange(3, 60, 3))[:N]
        intervals = np.diff(times, prepend=times[0] - 0.1)
        driven = replace(example(), times=times, intervals=np.round(intervals, 6))
        usual = float(np.median(driven.intervals))
        assert usual == 0.1
        between = 0.5 * (times[1:] + times[:-1])
        good = driven.converged[1:] & driven.converged[:-1]
        assert_array_equal(np.isfinite(driven.at(between).theta[:, 0]), good)


def test_a_slice_is_the_same_track_of_fewer_estimates():
    """Breaks if a field is left whole, or estimates are left out between others."""
    for driven in (example(), example(errors=False, known=False)):
        part = driven[5:19]
        assert len(part) == 14
        for field in fields(Track):
            whole, own = getattr(driven, field.name), getattr(part, field.name)
            assert_array_equal(own, whole if whole is None else whole[5:19])
        assert len(driven[:0]) == 0
        for rows in (slice(None, None, 2), slice(9, 3, -1), 3):
            with pytest.raises(ValueError, match=r"^a track must be sliced with a step of 1"):
                driven[rows]


def test_between_two_estimates_a_track_is_linear():
    """Breaks if weights are exchanged, or one direction gets those of another."""
    driven = replace(example(), times=0.1 * np.arange(N), intervals=np.full(N, 0.1))
    i = np.array([0, 7, 30])
    for share in (0.25, 0.5, 0.9):
        found = driven.at(driven.times[i] + share * np.diff(driven.times)[i])
        theta = (1.0 - share) * driven.theta[i] + share * driven.theta[i + 1]
        assert_allclose(found.theta, theta, rtol=1e-9)
        sigma = (1.0 - share) * driven.covariance[i] + share * driven.covariance[i + 1]
        assert_allclose(found.covariance, sigma, rtol=1e-9)


def test_outside_next_to_failures_and_in_gaps_nothing_is_known():
    """Breaks if a velocity is invented where there was none."""
    driven = example()
    step = driven.times[:-1] + 0.5 * np.diff(driven.times)
    theta = driven.at([driven.times[0] - 1e-3, *step, driven.times[-1] + 1e-3]).theta
    unknown = np.isnan(theta[1:-1]).all(axis=1)
    assert_array_equal(np.flatnonzero(unknown), [3, 4, 19, 20, 21])
    assert np.isnan(theta[[0, -1]]).all()
    later = replace(
        driven,
        times=driven.times + 10.0 * (np.arange(N) >= 30),
        intervals=driven.intervals + 10.0 * (np.arange(N) == 30),
    )
    assert np.isnan(later.at([later.times[29] + 5.0]).theta).all()


def test_wrong_times_and_starts_are_refused():
    """Breaks if a single time gives half an answer, an empty track an error of indices, or half a
    pose is taken for one."""
    for times in (1.0, [[1.0]], [np.nan], "now"):
        with pytest.raises(ValueError, match=r"^times must"):
            example().at(times)
    with pytest.raises(ValueError, match=r"^the track must hold at least one estimate"):
        example()[:0].at([1.0])
    for times, said in (
        (([1.0], [1.0]), "end must be after start"),
        (([1.0, 2.0], [3.0]), "end must have the shape"),
        ((1.0, 2.0), "start must have the shape"),
    ):
        with pytest.raises(ValueError, match=f"^{said}"):
            example().displacement(*times)
    for start in ((0.0, 0.0), (0.0, 0.0, np.nan), 1.0, np.zeros((0, 3))):
        with pytest.raises(ValueError, match=r"^start must"):
            example().poses(start)


# ---- in words and as a picture


def test_a_track_in_a_few_words():
    """Breaks if arrays fill the screen, or reasons that differ in a number count one by one."""
    driven = replace(example(), times=1.0 + np.arange(N) / 10.0, intervals=np.full(N, 0.1))
    assert repr(driven) == "Track(40 estimates from 1.000 s to 4.900 s, 92.5% converged)"
    assert str(driven).splitlines() == [
        repr(driven),
        "  2 failed: a speed of 98.0 to 120.5 m/s",
        "  1 failed: a scan without targets",
    ]
    assert str(example(known=False)) == repr(example(known=False))


def failed(count: int) -> Track:
    """A track whose first estimates failed."""
    bad = np.arange(N) < count
    covariance = np.where(bad[:, None, None], np.nan, np.eye(3))
    reasons = np.where(bad, "a speed of 98.0 m/s", "").astype("<U60")
    return replace(example(), covariance=covariance, converged=~bad, reasons=reasons)


def test_rare_reasons_are_counted_together():
    """Breaks if failures are left out, a unit's exponent is taken for a number, or a number's sign
    makes two reasons of one."""
    driven = failed(9)
    reasons = driven.reasons.copy()
    reasons[:9] = 3 * ["an acceleration of 31.5 m/s^2 along x"] + 2 * ["a"] + ["b", "b", "c", "d"]
    words = str(replace(driven, reasons=reasons)).splitlines()
    assert words[1] == "  3 failed: an acceleration of 31.5 m/s^2 along x"
    assert words[-1] == "  2 failed otherwise"
    assert sum(int(line.split()[0]) for line in words[1:]) == 9
    reasons = np.array(["a side slip of -1.20 m/s", "a side slip of 0.90 m/s", *(N - 2) * [""]])
    words = str(replace(failed(2), reasons=reasons)).splitlines()
    assert words[1:] == ["  2 failed: a side slip of -1.20 to 0.90 m/s"]


def test_the_picture_shows_velocities_bands_and_failures():
    """Breaks if an axis lacks its unit, a failed estimate is drawn, or the band is one sigma."""
    for known in (False, True):
        driven = example(known=known)
        figure = driven.plot()
        path, *axes = figure.axes
        labels = ["$v_x$ (m/s)", "$v_y$ (m/s)", "$ω$ (°/s)", *["inlier share"] * known]
        assert [ax.get_ylabel() for ax in axes] == labels
        assert (path.get_xlabel(), axes[-1].get_xlabel()) == ("x (m)", "time (s)")
        assert_array_equal(path.lines[0].get_xydata(), driven.poses()[:, :2])
        drawn = np.where(driven.converged, np.rad2deg(driven.theta[:, 2]), np.nan)
        assert_allclose(axes[2].lines[0].get_ydata(), drawn)
        band = axes[0].collections[0].get_paths()[0].vertices
        top = driven.theta[0, 0] + 3.0 * np.sqrt(driven.covariance[0, 0, 0])
        assert band[band[:, 0] == driven.times[0], 1].max() == pytest.approx(top)
        for ax in axes:
            assert_array_equal(ax.lines[-1].get_xdata(), driven.times[~driven.converged])
        plt.close(figure)


def test_the_picture_shows_how_surely_each_place_is_known():
    """Breaks if the ellipses are of another time or level, or drawn where nothing is stated."""
    drive = simulate_drive(np.random.default_rng(1), duration=4.0)
    driven = track(drive, budget=ErrorBudget(azimuth=np.deg2rad(0.5), doppler=0.05))
    figure = driven.plot()
    outlines = [line.get_xydata() for line in figure.axes[0].lines[2:]]
    assert len(outlines) == 8
    began = driven.times[0] - driven.intervals[0]
    motion, covariance = driven.displacement([began], driven.times[-1:])
    off = outlines[-1] - motion[0, :2]
    squares = np.einsum("ka,ab,kb->k", off, np.linalg.inv(covariance[0, :2, :2]), off)
    assert_allclose(squares, -2.0 * np.log(0.05))
    assert_allclose(motion[0, :2], driven.poses()[-1, :2], atol=1e-9)
    plt.close(figure)
    figure = track(drive, carry=False).plot()
    assert len(figure.axes[0].lines) == 2
    plt.close(figure)
