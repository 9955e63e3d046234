"""What users get wrong: each mistake is refused with a message that names the argument."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from d2d import (
    CorruptedGaussian,
    LinearMeasurement,
    PointSet,
    RegistrationCost,
    UniformOutlier,
    block_bootstrap,
    block_length,
    coverage,
    credibility,
    crps,
    fisher_covariance,
    log_score,
    multi_start,
    propagate_covariance,
    register,
    rigid,
    sandwich_covariance,
    start_grid,
    whiten,
)

NAN, INF, EYE = np.nan, np.inf, np.eye(2)
MEANS = np.array([[8.0, 1.0], [5.0, -3.0], [6.0, 4.0]])
EYES = np.tile(EYE, (3, 1, 1))
HOLEY = np.ma.masked_greater(MEANS, 7.0)
FIXED, MOVING = PointSet(MEANS, 0.04 * EYES), PointSet(MEANS + 0.1, 0.04 * EYES)
SETS = {"fixed": FIXED, "moving": MOVING}
PAIRS, LINE = PointSet(np.zeros((2, 3, 2)), EYES), PointSet([[0.0], [1.0]], np.ones((2, 1, 1)))
ESTIMATE = register(FIXED, MOVING)
ERRORS = np.random.default_rng(14).standard_normal((6, 2))


def doppler(targets: int = 3, parameters: int = 3, batch: tuple[int, ...] = ()):
    ones = np.ones((targets, parameters))
    return LinearMeasurement(np.zeros((*batch, targets)), 1.0, 0.1, ones, ones)


def one_wrong(matrix: Any) -> np.ndarray:
    """Three covariances, the last of which is replaced."""
    return np.array([EYE, EYE, matrix])


NOT_COVARIANCES = (
    np.zeros((2, 2)),
    *([[1.0, xy], [xy, 1.0]] for xy in (2.0, 1.0 - 1e-15)),  # the other singular but for rounding
    [[1.0, 0.5], [0.1, 1.0]],
    [[NAN, 0.0], [0.0, 1.0]],
)
NOT_MOTIONS = (np.zeros(2), 0.0, [0.0, NAN, 0.0], "zero")
NOT_ERRORS = (ERRORS[0], ERRORS[:0], ERRORS * NAN)
NOT_OF_ERRORS = (np.eye(3), EYE[None].repeat(5, axis=0), 1.0, *NOT_COVARIANCES)
OF_THE_COST = {
    "fixed": [None, MEANS],
    "moving": [MEANS],
    "fixed and moving": [{"moving": LINE}],
    "measurement": [doppler(2), doppler(parameters=1), np.zeros(3)],
}
SETS_AND_THETA = {"theta": np.zeros(3), **SETS, "measurement": None}
OF_AN_ESTIMATE = {
    "estimate": [ESTIMATE.theta, register(MOVING, FIXED)],
    "fixed": [MEANS],
    "cost": ["likelihood"],
}

# A function, arguments that are good and, for each name that a message gives, values of that
# argument, or changes of others, that are refused.
MISTAKES: dict[str, tuple[Callable[..., Any], dict[str, Any], dict[str, Any]]] = {
    "PointSet": (
        PointSet,
        {"means": MEANS, "covariances": EYES, "weights": None},
        {
            "means": [
                *(MEANS * NAN, [[1.0, 2.0], [3.0]], None, HOLEY, [*HOLEY]),
                *(MEANS[0], MEANS[:0], np.zeros((3, 3)), np.zeros((0, 3, 2)), MEANS * 1e300),
            ],
            "covariances": [
                *map(one_wrong, NOT_COVARIANCES),
                *(np.eye(3), EYES[:2], np.ones((3, 1, 1)), 1e154 * EYES, 1e-154 * EYES),
                {"means": np.zeros((3, 3, 2)), "covariances": [EYES] * 4},
            ],
            "weights": [[1.0, 1.0, w] for w in (0.0, NAN, 1e101, 1e-101)] + [np.ones(2)],
        },
    ),
    "from_polar": (
        PointSet.from_polar,
        {"range": [10.0, 20.0], "azimuth": [0.1, 0.2], "sigma_range": 0.2, "sigma_azimuth": 0.03},
        {
            "range": [[9.0, 0.0], [9.0, NAN], [], 9.0, [1.0, 2.0, 3.0]],
            "azimuth": [[0.1, NAN], [0.1, 0.2, 0.3], [0.1, 88.0], [0.1, -6.3]],
            "sigma_range": [0.0, [0.2, -0.2], [0.2, 0.2, 0.2]],
            "sigma_azimuth": [0.0, INF, "narrow"],
        },
    ),
    "inflated": (FIXED.inflated, {"scale": 2.0}, {"scale": [0.0, NAN, 1e300, 1e-300]}),
    "transformed": (FIXED.transformed, {"theta": np.zeros(3)}, {"theta": NOT_MOTIONS}),
    "shifted": (FIXED.shifted, {"translation": [1, 2]}, {"translation": [1.0, [0.0, NAN]]}),
    "UniformOutlier": (UniformOutlier, {"density": 1}, {"density": [0.0, NAN, INF, "low"]}),
    "CorruptedGaussian": (
        CorruptedGaussian,
        {"fraction": 0.2, "covariance": EYE},
        {
            "fraction": [-0.1, 1.1, NAN, [0.1, 0.2]],
            "covariance": [*NOT_COVARIANCES, np.eye(3), EYES, -1.0, None],
        },
    ),
    "RegistrationCost": (
        RegistrationCost,
        {},
        {"metric": ["D2D", None], "fusion": ["product"], "outlier": [0.1, UniformOutlier]},
    ),
    "LinearMeasurement": (
        LinearMeasurement,
        {
            "value": np.zeros(4),
            "sigma": 0.1,
            "sigma_input": 0.01,
            "gain": np.ones((4, 3)),
            "slope": np.ones((4, 3)),
        },
        {
            "value": [[0.0, 0.0, 0.0, NAN], np.zeros(3), np.zeros(0), np.full(4, 1e30)],
            "sigma": [0.0, INF, np.ones(3), 1e-60],
            "sigma_input": [-0.1, NAN, np.ones(5), 1e30],
            "gain": [np.ones(3), np.ones((4, 2)), np.ones((3, 3)), np.full((4, 3), 1e60)],
            "slope": [np.ones((4, 2)), np.full((4, 3), NAN), None],
            "of_twist": [
                "no",
                {"gain": np.ones((4, 1)), "slope": np.ones((4, 1)), "of_twist": True},
            ],
        },
    ),
    **{
        name: (
            getattr(RegistrationCost(), name),
            SETS_AND_THETA,
            {
                **OF_THE_COST,
                "theta": [*NOT_MOTIONS, {"theta": np.zeros((4, 3)), "fixed": PAIRS}],
                "measure": [{"theta": np.zeros((4, 3)), "measurement": doppler(batch=(3,))}],
            },
        )
        for name in ("value", "derivatives", "target_densities", "inlier_probabilities")
    },
    "register": (
        register,
        SETS,
        {
            **OF_THE_COST,
            "cost": ["likelihood", RegistrationCost],
            "outlier covariance": [{"cost": RegistrationCost(outlier=CorruptedGaussian(0.2, 4.0))}],
            "initial": [
                *(*NOT_MOTIONS, [1e155, 0.0, 0.0], [0.0, 0.0, 28.0], np.eye(3)),
                {"fixed": PAIRS, "initial": np.zeros((3, 3))},
            ],
            "scales": [(), (2.0, -1.0), (NAN,), 2.0, [[2.0], [1.0]], (1e51, 1.0)],
            "threads": [0, 1.5, None],
        },
    ),
    "multi_start": (
        multi_start,
        {**SETS, "cost": None, "starts": np.zeros((2, 3))},
        {"starts": [np.zeros(3), np.zeros((0, 3)), np.zeros((4, 2)), [[NAN] * 3], [[0, 0, 28]]]},
    ),
    "start_grid": (
        start_grid,
        {"reach": 1.0, "spacing": 1.0, "angles": [0.0]},
        {
            "reach": [0.0, NAN, [1.0, 2.0]],
            "spacing": [-1.0, 1e-12, {"spacing": 0.01, "angles": np.zeros(300)}],
            "angles": [[INF], []],
            "angles must be in radians": [{"angles": [-15.0, 0.0, 15.0]}],
        },
    ),
    "fisher_covariance": (
        fisher_covariance,
        {"hessian": EYE},
        {"hessian": [1.0, np.ones((2, 3)), np.zeros((0, 0)), [[1e-8, 0.5], [0.4, 1e8]]]},
    ),
    "propagate_covariance": (
        propagate_covariance,
        {"estimate": ESTIMATE, **SETS, "cost": None, "measurement": None},
        OF_AN_ESTIMATE,
    ),
    "sandwich_covariance": (
        sandwich_covariance,
        {"estimate": ESTIMATE, **SETS},
        {
            **OF_AN_ESTIMATE,
            "groups": [
                *(np.arange(2), np.zeros((2, 4)), [1, 2, NAN], [None] * 3, [1, None, "a"]),
                *(np.ma.masked_greater([1, 2, 3], 2), [np.ma.masked_greater([1, 2, 3], 2)]),
            ],
        },
    ),
    "transform_means": (
        rigid.transform_means,
        {"theta": np.zeros(3), "means": MEANS},
        {"theta": NOT_MOTIONS, "means": [MEANS * INF, np.zeros((4, 3)), 1.0]},
    ),
    "transform_covariances": (
        rigid.transform_covariances,
        {"theta": np.zeros(3), "covariances": EYES},
        {"theta": NOT_MOTIONS, "covariances": [EYES * NAN, np.eye(3)[None]]},
    ),
    "compose": (
        rigid.compose,
        {"first": np.zeros(3), "second": np.zeros(3)},
        {
            "first": NOT_MOTIONS,
            "second": NOT_MOTIONS,
            "first and second": [{"first": np.zeros((3, 3)), "second": np.zeros((4, 3))}],
        },
    ),
    "inverse": (rigid.inverse, {"theta": np.zeros(3)}, {"theta": NOT_MOTIONS}),
    "exponential": (rigid.exponential, {"twist": np.zeros(3)}, {"twist": NOT_MOTIONS}),
    "logarithm": (rigid.logarithm, {"theta": np.zeros(3)}, {"theta": NOT_MOTIONS}),
    **{
        function.__name__: (
            function,
            {"errors": ERRORS, "covariances": EYE} | more,
            {"errors": NOT_ERRORS, "covariances": NOT_OF_ERRORS} | wrong,
        )
        for function, more, wrong in (
            (credibility, {}, {"confidence": [0.0, 1.5, NAN, "high"]}),
            (log_score, {}, {}),
            (whiten, {}, {"order": [(0,), (0, 0), (1, 2), "10", 3, (1.0, 0.0), [None, 0]]}),
            (coverage, {"levels": 0.9}, {"levels": [0.0, [0.5, 1.5], NAN, None]}),
        )
    },
    "crps": (
        crps,
        {"errors": ERRORS, "sigmas": 1.0},
        {"errors": [NAN], "sigmas": [0.0], "broadcast": [{"sigmas": np.ones(3)}]},
    ),
    "block_bootstrap": (
        block_bootstrap,
        {
            "statistic": lambda *arrays: arrays[0].mean(),
            "arrays": [np.arange(6.0)],
            "block": 2,
            "rng": np.random.default_rng(0),
        },
        {
            "arrays": [[], np.arange(6.0), [[]], 3, [HOLEY]],
            r"arrays.*\[6, 5\]": [{"arrays": [np.arange(6.0), np.arange(5.0)]}],
            "block": [0, 7, 2.5],
            "rng": [0],
            "confidence": [0.0],
            "resamples": [0],
            "vectorized": ["no"],
            "statistic": [
                *(None, lambda *_: NAN),
                {"statistic": lambda x, axis: np.mean(x), "vectorized": True},
            ],
        },
    ),
    "block_length": (
        block_length,
        {"series": np.arange(6.0)},
        {"series": [[], np.ones((2, 2, 2)), [NAN], 3.0]},
    ),
}


@pytest.mark.parametrize("called", MISTAKES)
def test_a_mistake_is_refused_by_name(called):
    """Breaks if it gives a number, or an error that leaves the user guessing."""
    function, good, wrong = MISTAKES[called]
    function(**good)  # else the changes below would show nothing
    for name, values in wrong.items():
        for value in values:
            change = value if isinstance(value, dict) else {name: value}
            try:
                with pytest.raises(ValueError, match=name):
                    function(**(good | change))
            except pytest.fail.Exception as unnoticed:
                raise AssertionError(f"{called}({change})") from unnoticed


def test_what_is_no_sequence_cannot_be_looped_over():
    """Breaks if a loop over its targets runs through none of them and says nothing."""
    with pytest.raises(TypeError, match=r"iterable|iterate"):
        list(FIXED)
