"""Models of the covariance of estimates, and how each is fitted.

A model is fitted to the estimates of training drives by the smallest mean log score, and then
states the covariances of other estimates from what is known while driving.  All models see the same
estimates, which are carried to their times; what the carry adds is in the covariances of all that
build on the targets of a scan, so that no model lacks it.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from d2d._types import Array
from d2d.radar import fit_budget
from d2d.scores import log_score

Parameters = dict[str, Array]

WINDOW = 2.0  # s, over which the adaptive model looks back
GAP = 0.5  # s without an estimate, after which nothing is extrapolated
FEWEST = 5  # innovations in a window, for less the usual spread is taken
QUIETEST = 0.01  # of the usual spread: what repeats itself is not known without error
# A factor, and constants relative to the errors' RMSE: mostly noise, or hardly any.
STARTS = (5.0, 0.2), (1.0, 0.8)
POWERS = np.linspace(0.0, 1.5, 31)  # of the recent spread
CAUSES = "azimuth", "doppler", "scale", "lag"  # of an error budget
NEIGHBOURS = "neighbours"


class Estimates(NamedTuple):
    """n accepted estimates of a drive in time order, and what is known of their errors."""

    times: Array  # (n,) s
    theta: Array  # (n, 3) in m/s, m/s, rad/s
    errors: Array  # (n, 3) against the reference
    hessian: Array  # (n, 3, 3) inverse Hessian
    noise: Array  # (n, 3, 3) propagated noise of the targets
    carry: Array  # (n, 3, 3) of the acceleration by which each is carried to its time
    budget: Array  # (n, 3, 3) with the data set's stored budget, carry included
    dependence: Array  # (n, 3, 3) of neighbouring targets, over the stored budget's length
    effects: Array  # (n, 4, 3, 3) of a standard deviation of one of each cause of a budget

    def where(self, chosen: NDArray[np.bool_]) -> "Estimates":
        """Some of the estimates."""
        return Estimates(*(column[chosen] for column in self))


class Model(NamedTuple):
    """Finds parameters from training drives, and states covariances of other estimates."""

    fit: Callable[[Sequence[Estimates]], Parameters]
    covariances: Callable[[Parameters, Estimates], Array]  # (n, 3, 3)


def joined(drives: Sequence[Estimates]) -> Estimates:
    """All estimates of some drives, one drive after the other."""
    return Estimates(*(np.concatenate(columns) for columns in zip(*drives, strict=True)))


def as_it_is(stated: Callable[[Estimates], Array]) -> Model:
    """A covariance to which nothing is fitted."""
    return Model(lambda drives: {}, lambda parameters, own: stated(own))


def likeliest(score: Callable[[Array], float], start: Array) -> Array:
    """The positive parameters with the smallest score, from a start: a search in logarithms."""
    best = scipy.optimize.minimize(
        lambda logarithms: score(np.exp(logarithms)),
        np.log(start),
        method="L-BFGS-B",
        bounds=[(-20.0, 20.0)] * len(start),
    )
    return np.asarray(np.exp(best.x))


def scaled(stated: Callable[[Estimates], Array], count: int, constants: bool = False) -> Model:
    """D C D and the carry, with a factor on C for all directions, or one for each.

    The factors are those of the covariance: D holds their roots.  There may be three variances
    beside them.
    """

    def covariances(parameters: Parameters, own: Estimates) -> Array:
        root = np.sqrt(np.broadcast_to(parameters["factors"], 3))
        added = np.diag(parameters.get("constants", np.zeros(3)) ** 2)
        return np.asarray(stated(own) * np.outer(root, root) + own.carry + added)

    def named(values: Array) -> Parameters:
        factors: Parameters = {"factors": values[:count]}
        return factors | {"constants": values[count:]} if constants else factors

    def fit(drives: Sequence[Estimates]) -> Parameters:
        own = joined(drives)

        def score(values: Array) -> float:
            return float(log_score(own.errors, covariances(named(values), own)).mean())

        starts = [np.full(count, 3.0)]
        if constants:
            usual = np.sqrt(np.mean(own.errors**2, axis=0))
            starts = [np.array([*[factor] * count, *share * usual]) for factor, share in STARTS]
        return named(min((likeliest(score, start) for start in starts), key=score))

    return Model(fit, covariances)


def with_constants(stated: Callable[[Estimates], Array]) -> Model:
    """C, the carry, and three variances that `fit_budget` finds."""

    def fit(drives: Sequence[Estimates]) -> Parameters:
        own = joined(drives)
        found = fit_budget(own.errors, stated(own) + own.carry)
        constants = np.sqrt(np.diagonal(found.budget.constant))
        return {"constants": constants, "sigmas": found.sigmas, "bounds": found.bounds}

    def covariances(parameters: Parameters, own: Estimates) -> Array:
        return np.asarray(stated(own) + own.carry + np.diag(parameters["constants"] ** 2))

    return Model(fit, covariances)


def budgeted(without: str = "") -> Model:
    """The propagated noise, the carry, and the causes of a budget as `fit_budget` finds them.

    One cause may be left out, or the dependence of neighbours.
    """
    names = [name for name in CAUSES if name != without]
    places = [CAUSES.index(name) for name in names]

    def rest(own: Estimates) -> Array:
        noise = own.noise if without == NEIGHBOURS else own.noise + own.dependence
        return np.asarray(noise + own.carry)

    def fit(drives: Sequence[Estimates]) -> Parameters:
        own = joined(drives)
        effects = dict(zip(names, own.effects[:, places].swapaxes(0, 1), strict=True))
        found = fit_budget(own.errors, rest(own), effects)
        return {"causes": found.values, "sigmas": found.sigmas, "bounds": found.bounds}

    def covariances(parameters: Parameters, own: Estimates) -> Array:
        added = np.einsum("p,npij->nij", parameters["causes"] ** 2, own.effects[:, places])
        return np.asarray(rest(own) + added)

    return Model(fit, covariances)


def constant() -> Model:
    """One matrix for all estimates: the mean square of the errors has the best score."""

    def fit(drives: Sequence[Estimates]) -> Parameters:
        errors = joined(drives).errors
        return {"matrix": errors.T @ errors / len(errors)}

    return Model(fit, lambda given, own: np.tile(given["matrix"], (len(own.times), 1, 1)))


def adaptive() -> Model:
    """One matrix, times a power of how much the estimates have scattered lately.

    The scatter is the mean square of the innovations of the last two seconds, relative to what it
    is on the training drives.
    """

    def fit(drives: Sequence[Estimates]) -> Parameters:
        each = np.concatenate([innovations(own) for own in drives])
        each = each[np.isfinite(each).all(axis=1)]
        usual = each.T @ each / len(each)
        recent = np.concatenate([spread(own, usual) for own in drives])
        errors = joined(drives).errors

        def parameters(power: float) -> Parameters:
            relative = errors / np.sqrt(recent**power)[:, None]
            matrix = relative.T @ relative / len(relative)
            return {"matrix": matrix, "power": np.array(power), "usual": usual}

        def score(given: Parameters) -> float:
            stated = given["matrix"] * (recent ** given["power"])[:, None, None]
            return float(log_score(errors, stated).mean())

        return min((parameters(float(power)) for power in POWERS), key=score)

    def covariances(given: Parameters, own: Estimates) -> Array:
        factors = spread(own, given["usual"]) ** given["power"]
        return np.asarray(factors[:, None, None] * given["matrix"])

    return Model(fit, covariances)


def innovations(own: Estimates) -> Array:
    """By how much (n, 3) each estimate differs from the line through the two before; or nan."""
    found = np.full_like(own.theta, np.nan)
    steps = np.diff(own.times)
    known = (steps[1:] < GAP) & (steps[:-1] < GAP)
    slopes = np.diff(own.theta, axis=0) / steps[:, None]
    found[2:][known] = ((slopes[1:] - slopes[:-1]) * steps[1:, None])[known]
    return found


def spread(own: Estimates, usual: Array) -> Array:
    """The mean square (n,) of the innovations of the last seconds over the usual one (3, 3)."""
    each, precision = innovations(own), np.linalg.inv(usual)
    squares = np.einsum("ni,ij,nj->n", each, precision, each) / 3.0
    found = np.ones(len(squares))
    for i, first in enumerate(np.searchsorted(own.times, own.times - WINDOW, side="right")):
        recent = squares[first : i + 1]
        recent = recent[np.isfinite(recent)]
        if len(recent) >= FEWEST:
            found[i] = max(recent.mean(), QUIETEST)
    return found


CONSTANTS, BUDGET = "noise + 3 constants", "noise + fitted budget"
MODELS = {
    "inverse Hessian": as_it_is(lambda own: own.hessian + own.carry),
    "inverse Hessian × 1 factor": scaled(lambda own: own.hessian, 1),
    "inverse Hessian × 3 factors": scaled(lambda own: own.hessian, 3),
    "inverse Hessian + 3 constants": with_constants(lambda own: own.hessian),
    "inverse Hessian × 1 factor + 3 constants": scaled(lambda own: own.hessian, 1, constants=True),
    "constant matrix": constant(),
    "adaptive matrix": adaptive(),
    "propagated noise": as_it_is(lambda own: own.noise + own.carry),
    "noise × 3 factors": scaled(lambda own: own.noise, 3),
    CONSTANTS: with_constants(lambda own: own.noise),
    "noise × 1 factor + 3 constants": scaled(lambda own: own.noise, 1, constants=True),
    BUDGET: budgeted(),
    "stored budget": as_it_is(lambda own: own.budget),
}
ABLATIONS = {f"without {each}": budgeted(each) for each in (*CAUSES, NEIGHBOURS)}  # of the budget
