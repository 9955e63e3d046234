"""Numbers of an error budget by maximum likelihood: recovered, at the bound, refused."""

import re
from dataclasses import astuple

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d import log_score
from d2d.bootstrap import covariance_of_sum
from d2d.radar import ErrorBudget, Mounting, compare, fit_budget, simulate_drive, track

TRUE = np.array([0.02, 0.04, 0.003])
SCALE = np.array([0.01, 0.02, 0.002])  # of the noise
OPTIONS = {"horizon": 0.3, "progress": False}


def drawn(seed: int, own: np.ndarray = TRUE, memory: float = 0.0, count: int = 600):
    """Errors (n, 3) of a noise that differs between estimates, and of constants; the noise's part.

    With a memory, what the constants describe is an autoregression with this coefficient.
    """
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((count, 3, 5)) * SCALE[:, None]
    root *= np.exp(rng.uniform(-1.0, 1.0, (count, 1, 1)))
    noise = root @ np.swapaxes(root, -1, -2)
    errors = np.linalg.cholesky(noise) @ rng.standard_normal((count, 3, 1))
    slow = rng.standard_normal((count, 3))
    for i in range(1, count):
        slow[i] = memory * slow[i - 1] + np.sqrt(1.0 - memory**2) * slow[i]
    return errors[..., 0] + own * slow, noise


@pytest.mark.parametrize("memory", [0.0, 0.8])
def test_what_a_simulation_put_in_is_found_within_its_standard_error(memory):
    """Breaks if variances are taken for constants, or dependent errors for independent ones."""
    fits = [fit_budget(*drawn(seed, memory=memory)) for seed in range(20)]
    off = (np.array([fit.values for fit in fits]) - TRUE) / [fit.sigmas for fit in fits]
    # 60 squares, three of each draw hardly dependent; a 99.9 % region is 0.5 to 1.7, and blocks
    # of a series of 600 know a part of a long memory only
    assert 0.5 < np.mean(off**2) < (1.7 if memory == 0.0 else 2.5)
    inside = [(fit.bounds[0] <= TRUE) & (fit.bounds[1] >= TRUE) for fit in fits]
    assert np.mean(inside) > 0.85
    if memory:
        apart = [fit_budget(*drawn(seed)).sigmas for seed in range(20)]
        assert np.mean([fit.sigmas for fit in fits]) > 1.3 * np.mean(apart)


def test_intervals_are_95_percent_of_a_normal_distribution():
    """Breaks if they are of another level: 1.96 standard errors of the squares to each side."""
    fit = fit_budget(*drawn(0))
    half = 0.5 * np.diff(fit.bounds**2, axis=0)[0]
    assert_allclose(half, 1.96 * 2.0 * fit.values * fit.sigmas, rtol=1e-3)


def test_a_sum_of_few_terms_has_the_unbiased_covariance():
    """Breaks if the degrees of freedom that a fit uses up are forgotten."""
    terms = np.random.default_rng(1).standard_normal((12, 2))
    covariance, block = covariance_of_sum(terms)
    assert block == 1
    assert_allclose(covariance, 12 * np.cov(terms.T))


def test_no_other_constants_score_better():
    """Breaks if the search ends early, or at another measure than the log score."""
    errors, noise = drawn(3)
    fit = fit_budget(errors, noise)
    constant = np.diag(np.square([getattr(fit.budget, name) for name in ("v_x", "v_y", "omega")]))
    assert_allclose(fit.log_score, log_score(errors, noise + constant).mean())
    for k in range(3):
        for factor in (0.99, 1.01):
            other = fit.values
            other[k] *= factor
            assert log_score(errors, noise + np.diag(other**2)).mean() > fit.log_score


def test_a_constant_that_is_zero_is_on_the_bound_or_not_told_from_it():
    """Breaks if a variance goes below zero, or a constant is stated that the errors do not show."""
    own = TRUE * [1.0, 0.0, 1.0]
    fits = [fit_budget(*drawn(seed, own)) for seed in range(20)]
    found = np.array([fit.values for fit in fits])[:, 1]
    assert 4 <= (found == 0.0).sum() <= 16
    low, high = np.array([fit.bounds[:, 1] for fit in fits]).T
    assert (low == 0.0).sum() >= 17
    assert ((high > 0.0) & (high < 0.015)).all()
    assert all((fit.sigmas > 0.0).all() for fit in fits)


def test_errors_smaller_than_stated_leave_no_constant():
    """Breaks if the bound is left in one direction only, or the unit decides."""
    errors, noise = drawn(1)
    fit = fit_budget(0.01 * errors, noise)
    assert fit.values.tolist() == [0.0, 0.0, 0.0]
    assert_allclose(fit_budget(np.zeros((9, 3)), np.eye(3)).bounds[0], 0.0)


def test_noise_beside_which_a_constant_cannot_be_seen_is_told():
    """Breaks if a fit of what the likelihood does not identify looks like a measurement."""
    errors, noise = drawn(2)
    wide = noise + np.diag([0.5, 0.0, 0.0]) ** 2
    errors = errors + np.random.default_rng(5).standard_normal((600, 1)) * [0.5, 0.0, 0.0]
    fit = fit_budget(errors, wide)
    assert fit.bounds[0, 0] == 0.0
    assert fit.bounds[1, 0] > 5.0 * TRUE[0]
    assert (fit.bounds[0, 1:] > 0.5 * TRUE[1:]).all()


def test_units_do_not_matter():
    """Breaks if the search needs all three directions to be of one size."""
    errors, noise = drawn(4)
    unit = np.array([10.0, 0.1, 100.0])
    fit, other = fit_budget(errors, noise), fit_budget(errors * unit, noise * np.outer(unit, unit))
    assert_allclose(other.values, fit.values * unit, rtol=1e-4)
    assert_allclose(other.sigmas, fit.sigmas * unit, rtol=1e-3)


def test_a_track_adds_the_constants_to_the_propagated_noise():
    """Breaks if the budget adds something else than what was fitted, or moves the velocities; a
    little of what stays for 15 s averages out."""
    drive = simulate_drive(np.random.default_rng(1), duration=3.0, mounting=Mounting(3.0))
    plain = track(drive, budget=ErrorBudget(), **OPTIONS)
    budget = ErrorBudget(v_x=0.05, v_y=0.1, omega=0.01)
    wider = track(drive, budget=budget, **OPTIONS)
    assert_allclose(wider.theta, plain.theta, atol=0.02)
    added = np.diag(np.square([0.05, 0.1, 0.01]))
    slow = wider.errors[:, 1, :3, 6:]
    for more in (wider.covariance - plain.covariance, slow @ slow.swapaxes(1, 2)):
        factor = np.diagonal(more, axis1=1, axis2=2) / np.diag(added)
        assert_allclose(factor, 1.0, atol=0.3)
    assert astuple(ErrorBudget())[:5] == (0.0,) * 5


def test_errors_put_into_a_simulated_drive_are_found():
    """Breaks if the noise that `track` states is not what the fit takes off."""
    drive = simulate_drive(np.random.default_rng(2), duration=20.0)
    found = compare(track(drive, budget=ErrorBudget(), **OPTIONS), drive.truth)
    put = np.array([0.1, 0.15, 0.02])
    errors = found.errors + put * np.random.default_rng(3).standard_normal(found.errors.shape)
    fit = fit_budget(errors, found.covariances)
    assert (np.abs(fit.values - put) < 3.5 * fit.sigmas).all()
    assert (fit.bounds[0] > 0.0).all()


def test_causes_are_told_apart_by_what_each_does_to_an_estimate():
    """Breaks if the effects of one cause are taken for those of another."""
    put = {"azimuth": 0.004, "scale": 0.002, "omega": 0.01}
    inside, off = [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        columns = {
            "azimuth": rng.normal(0.0, 5.0, (600, 3)),
            "scale": rng.normal(10.0, 5.0, (600, 3)),
        }
        columns["omega"] = np.tile([0.0, 0.0, 1.0], (600, 1))
        effects = {name: each[:, :, None] * each[:, None] for name, each in columns.items()}
        errors, noise = drawn(seed, np.zeros(3))
        for name, each in columns.items():
            errors = errors + put[name] * rng.standard_normal((600, 1)) * each
        fit = fit_budget(errors, noise, effects)
        assert fit.names == tuple(put)
        true = np.array(list(put.values()))
        off.append((fit.values - true) / fit.sigmas)
        inside.append((fit.bounds[0] <= true) & (fit.bounds[1] >= true))
    assert 0.5 < np.mean(np.square(off)) < 1.7
    assert np.mean(inside) > 0.85


def test_the_constants_are_the_effects_of_one_each():
    """Breaks if the default is another model than what it is said to be."""
    errors, noise = drawn(6)
    fit = fit_budget(errors, noise)
    units = dict(zip(fit.names, np.eye(3)[:, :, None] * np.eye(3)[:, None], strict=True))
    other = fit_budget(errors, noise, units)
    assert_allclose(other.values, fit.values)
    assert other.budget == fit.budget


def test_arguments_are_refused_by_name():
    """Breaks if a mistake is found late, or makes a budget."""
    errors, noise = drawn(0, count=10)
    hole = np.where(np.arange(30).reshape(10, 3) == 4, np.nan, errors)
    for given, name in (
        ((errors[:, :2], noise[:, :2, :2]), r"errors must have the shape \(n, 3\)"),
        ((errors[:3], noise[:3]), "errors must have the shape .* at least 4"),
        ((hole, noise), "errors must be finite"),
        ((errors, noise[:5]), "covariances"),
        ((errors, -noise), "covariances must be positive definite"),
    ):
        with pytest.raises(ValueError, match=f"^{name}"):
            fit_budget(*given)
    whole = np.tile(np.eye(3), (10, 1, 1))
    for effects, name in (
        ([whole], "effects must be a Mapping"),
        ({}, "effects must hold at least one"),
        ({"neighbours": whole}, "effects must be of v_x, .*, not 'neighbours'"),
        ({"lag": whole[:4]}, r"effects\['lag'\] must have the shape \(10, 3, 3\)"),
        ({"lag": 0.0 * whole}, r"effects\['lag'\] is zero"),
        ({"lag": -whole}, r"effects\['lag'\] must be positive semidefinite"),
        (
            {"lag": whole, "scale": 2.0 * whole},
            "effects must differ .* but lag and scale have the same in all of them",
        ),
    ):
        with pytest.raises(ValueError, match=f"^{name}"):
            fit_budget(errors, noise, effects)


def scaled(seed: int, least: float, most: float):
    """Errors with noise, of which some covariances are larger or smaller by orders of magnitude."""
    errors, noise = drawn(seed, count=200)
    rng = np.random.default_rng(seed)
    rows = rng.choice(len(errors), rng.integers(1, 60), replace=False)
    noise[rows] *= 10.0 ** rng.uniform(least, most)
    return errors, noise, rows


@pytest.mark.parametrize("seed", range(6))
def test_huge_covariances_tell_nothing(seed):
    """Breaks if one of them decides where the search begins, or hides what the others say."""
    errors, noise, rows = scaled(seed, 6.0, 130.0)
    left = np.delete(np.arange(len(errors)), rows)
    expected = fit_budget(errors[left], noise[left])
    assert_allclose(fit_budget(errors, noise).values, expected.values, rtol=1e-3, atol=1e-5)


@pytest.mark.parametrize("seed", range(6))
def test_tiny_covariances_give_the_best_score_or_a_refusal(seed):
    """Breaks if numbers come out that others beat, or an error names no argument."""
    errors, noise, _ = scaled(seed, -130.0, -4.0)
    try:
        fit = fit_budget(errors, noise)
    except ValueError as error:
        if not re.match("(errors and )?covariances must", str(error)):
            raise
        return
    others = fit.values * 10.0 ** np.random.default_rng(seed).normal(0.0, 0.5, (50, 3))
    scores = [log_score(errors, noise + np.diag(other**2)).mean() for other in others]
    assert min(scores) >= fit.log_score - 1e-9
