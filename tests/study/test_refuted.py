"""Every check is run in a world in which its claim is false, and must refute it there.

In most of these worlds the whole check runs on changed data: other costs, scenes or tracks.  Where
that takes long, what it measures is replaced.
"""

from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from d2d import rigid
from d2d.radar import track
from d2d.study import CLAIMS
from d2d.study.book.measured import Measured
from d2d.study.drives import claims as drives
from d2d.study.drives.variations import followed
from d2d.study.estimation import claims as estimation
from d2d.study.estimation.descent import ends_of
from d2d.study.line import cluster_study, outlier_study
from d2d.study.line.claims import clusters as line_clusters
from d2d.study.line.claims import outliers as line_outliers
from d2d.study.line.claims import surfaces
from d2d.study.line.scene import line_scene, with_outlier
from d2d.study.line.surfaces import Survey
from d2d.study.mixtures import claims as mixtures
from d2d.study.plane.claims import clusters, combined, indices, outliers, overlapped
from d2d.study.plane.optima import Minima
from d2d.study.point_sets import claims as point_sets

SUM, PRODUCT = surfaces.D2D, surfaces.LIKELIHOOD
SWAPPED = {"SUMMING": overlapped.LIKELIHOOD, "LIKELIHOOD": overlapped.SUMMING}
SAME, WORSE = Measured(1.0, 0.99, 1.01), Measured(1.5, 1.4, 1.6)  # ratios of errors
ELSEWHERE = np.array([[8.0, 0.0, 0.0], np.zeros(3)]), np.array([0.0, -1.0])  # of the minima
AT_TRUTH = np.zeros((1, 3)), np.zeros(1)
FAR_OFF = {"TRUTH": 4.0}  # m: where no peak is
CACHED = (
    *(surfaces.surfaces_of_scene, outlier_study.scene, outlier_study.survey_scene),
    *(cluster_study.spread, cluster_study.cluster_sweep, drives.tracked_drive),
    *(point_sets._success_shares, point_sets._near_of_ndt),
)


def always(value):
    """A function that finds the same whatever it is given."""
    return lambda *given, **options: value


def minima(errors, log_heights):
    """In the place of `local_minima`: the same in all draws."""
    return lambda scenario, cost, draws: Minima((errors,) * draws, (log_heights,) * draws, [0.0])


def outlier_at(place):
    """`with_outlier`, always at that place (m)."""
    return lambda rng, where, **options: with_outlier(rng, where, **{**options, "at": place})


def surveyed(optima):
    """A survey of 400 surfaces with a high rival, whose highest peak is nowhere near the truth."""
    several = np.full(400, float(optima))
    return Survey(several, several + 90.0, several * 0.0 + 0.9, several, several + 1.0)


def rooms(far, near):
    """In the place of the shares of successes: the same in every room of every scene."""
    methods = (*point_sets.COMPARED, *point_sets.COARSE)
    shares = np.tile([far, near], (point_sets.ROOMS, 1))
    return {(scene, method): shares for scene in point_sets.SCENES for method in methods}


def spread(cost, spacing):
    """What a cost states, and how far it errs: twice as much with a cluster."""
    once = np.random.default_rng(0).uniform(0.9, 1.1, (3, 500))
    return cluster_study.Spread(*(once if spacing is None else 2.0 * once))


def path(iterations):
    """A path of an optimiser that does not arrive."""
    return SimpleNamespace(costs=[1.0], evaluations=iterations, converged=False)


def evaluated(scenario, cost, start="truth", runs=200):
    """Runs that lose the truth with the likelihood only, started at zero."""
    lost = cost is overlapped.LIKELIHOOD and start == "zero"
    return SimpleNamespace(errors=np.full((runs, 3), 9.0 if lost else 0.0))


def layouts(**measures):
    """In the place of `over_layouts`: what 50 random layouts have in common."""
    scatter = 1e-3 * np.random.default_rng(0).standard_normal(50)
    return always(SimpleNamespace(**{name: value + scatter for name, value in measures.items()}))


def conditions():
    """Conditions whose NCI tells the dangerous ones from the others."""
    dangerous = {"nci": np.full(50, 9.0), "inclination": np.full(50, 9.0), "coverage": np.zeros(50)}
    others = {name: 1.0 - 0.1 * each for name, each in dangerous.items()}
    return [SimpleNamespace(**(dangerous if at % 2 else others)) for at in range(12)]


def weights(drive, driven, *, doppler):
    """In the place of `TargetWeights`: Doppler velocities let targets pass."""
    share = (0.1 if doppler else 0.5) + 0.01 * np.random.default_rng(0).standard_normal()
    return SimpleNamespace(kind=np.repeat(["moving", "wall"], 400), rejected=always(share))


def in_place(drive, **options):
    """A track that is off by a metre from its first estimate to the last."""
    true, intervals = drive.truth.poses, np.diff(drive.truth.times)
    moves = rigid.compose(rigid.inverse(true[:-1]), true[1:])
    moves[0, 0] += 1.0
    return SimpleNamespace(theta=rigid.logarithm(moves) / intervals[:, None], intervals=intervals)


def lost_where_annealed(drive, starts=None, **options):
    """In the place of `followed`: what is annealed from starts of its own is far off."""
    return followed(drive, **options) if starts is None else starts + 9.0


def useless_doppler(drive, *, doppler, **options):
    """A track that is better without."""
    return track(drive, doppler=not doppler, **options)


LINE, LINE_OUTLIERS, LINE_CLUSTERS = surfaces, line_outliers, line_clusters
COSTS = estimation.COSTS
SHORT = {"DRIVES": 3, "DURATION": 2.0}
FEW = {"DRAWS": 200}
# for each claim: what is another in its module, and in further ones
WORLDS = {
    "gmm-better": {mixtures: {"two_humps": always(mixtures.two_humps(0.0)), "DRAWS": 20}},
    "em-monotone": {mixtures: {"MAX_STEPS": 1, "SETS": 30}},
    "icp-feeble": {point_sets: {"_success_shares": always(rooms(1.0, 1.0))}},
    "ndt-registers": {
        point_sets: {
            "_success_shares": always(rooms(1.0, 1.0)),
            "METHODS": dict.fromkeys(point_sets.NDT, lambda before, after, starts: starts + 1.0),
            "NDT_ROOMS": 10,
        },
    },
    "b-three-peaks": {
        LINE: FEW
        | {"line_scene": lambda rng, **given: line_scene(rng, **given, positions=[0, 8, 8.1])},
    },
    "d2d-lower": {LINE: FEW | {"P2D": SUM, "D2D": surfaces.P2D}},
    "equal-sigma-same": {
        LINE: {"_survey": lambda cost: surveyed(cost is SUM)},  # one peak, none
    },
    "noisy-p2d-fails": {LINE: FEW | {"P2D": SUM, "D2D": surfaces.P2D, "NOISE_RATIO": 10.0}},
    "summing-local-peaks": {LINE: FEW | FAR_OFF | {"D2D": PRODUCT}},
    "likelihood-one-peak": {LINE: FEW | FAR_OFF | {"LIKELIHOOD": SUM}},
    "summing-smoother": {LINE: FEW | {"D2D": PRODUCT, "LIKELIHOOD": SUM}},
    "outlier-fixed-summing": {outlier_study: {"with_outlier": outlier_at(0.0)}},  # on a target
    "outlier-fixed-likelihood": {
        LINE_OUTLIERS: {"LIKELIHOOD": outlier_study.SUMMING, "rms_ratio": always(WORSE)},
        LINE: FAR_OFF,
    },
    "outlier-moving-summing": {
        outlier_study: {"with_outlier": outlier_at(-100.0)},  # beyond all surfaces
        LINE_OUTLIERS: {"MANY": 200},
        LINE: FAR_OFF,
    },
    "outlier-moving-likelihood": {
        outlier_study: {"with_outlier": outlier_at(6.0)},  # on a target
        LINE_OUTLIERS: {"MANY": 200},
    },
    "uniform-restores": {LINE_OUTLIERS: {"survey_scene": always(surveyed(2))}},
    "uniform-not-a-density": {
        LINE_OUTLIERS: {"UNIFORM": outlier_study.ROBUST, "ROBUST": outlier_study.UNIFORM},
    },
    "corrupted-restores": {LINE_OUTLIERS: {"ROBUST": outlier_study.SUMMING}, LINE: FAR_OFF},
    "outlier-parameters-crucial": {
        LINE_OUTLIERS: {
            "survey_corrupted": lambda *pair: outlier_study.survey_scene(
                outlier_study.ROBUST, "moving", 120
            )
        },
    },
    "tight-cluster-certain": {
        LINE_CLUSTERS: {
            "spread": spread,
            "cluster_sweep": always(SimpleNamespace(maxima=np.full((10, 400), 3))),
        },
    },
    "loose-cluster-summing": {LINE_CLUSTERS: {"SUMMING": outlier_study.LIKELIHOOD}},
    "loose-cluster-likelihood": {
        LINE_CLUSTERS: {"LIKELIHOOD": outlier_study.SUMMING, "rms_ratio": always(WORSE)},
    },
    "second-order-faster": {
        estimation: {
            "run_second_order": always(
                dict.fromkeys(("Newton", "Gauss-Newton", "Levenberg-Marquardt"), path(5000))
            ),
            "gradient_descents": always(ends_of([path(6)] * estimation.STARTS)),
        },
    },
    "fisher-suffices": {
        estimation: {
            "covariance_study": lambda name, study=estimation.covariance_study: study("sum"),
            "over_layouts": lambda name, over=estimation.over_layouts: over("sum"),
            "anees_of_drives": always(WORSE),
        },
    },
    "summing-not-gaussian": {
        estimation: {"COSTS": {"likelihood": COSTS["sum"], "sum": COSTS["likelihood"]}},
    },
    "overlap-local-minima": {overlapped: SWAPPED | {"SEARCHED": 20}},
    "overlap-error": {overlapped: SWAPPED},
    "overlap-initial-guess": {
        overlapped: {
            "evaluated": evaluated,
            "monte_carlo": lambda scenario, cost, **options: evaluated(scenario, cost),
            "over_layouts": layouts(share=0.5),
        },
    },
    "overlap-summing-pessimistic": {overlapped: {"SUMMING": overlapped.LIKELIHOOD}},
    "overlap-likelihood-credible": {overlapped: {"LIKELIHOOD": overlapped.SUMMING}},
    "overlap-outlier-component": {
        overlapped: {"LIKELIHOOD": overlapped.SUMMING, "ROBUST": overlapped.LIKELIHOOD},
    },
    "outlier-likelihood-vanishes": {outliers: {"LIKELIHOOD": outliers.ROBUST, "SEARCHED": 5}},
    "outlier-robust-minimum": {outliers: {"local_minima": minima(*ELSEWHERE)}},
    "outlier-error": {outliers: {"SUMMING": outliers.ROBUST, "ROBUST": outliers.SUMMING}},
    "outlier-credibility": {
        outliers: {
            "SUMMING": outliers.LIKELIHOOD,
            "ratios_in_decibels": always(np.zeros(1000)),
            "over_layouts": layouts(pessimistic=0.01, optimistic=0.01, inclination=0.0),
        },
    },
    "cluster-summing-wrong": {
        clusters: {
            "local_minima": minima(*AT_TRUTH),
            "worst": always((clusters.KINDS[-1], {})),
            "shares_wrong": always(np.zeros(40)),
        },
    },
    "cluster-likelihood-same": {
        clusters: {
            "local_minima": minima(*ELSEWHERE),
            "error_ratio": always(WORSE),
            "error_ratio_of_layouts": always(np.array([1.4, 1.5, 1.6])),
            "inclination": always(Measured(3.0, 2.9, 3.1)),
            "over_layouts": layouts(inclination=3.0),
        },
    },
    "cluster-error": {clusters: SWAPPED},
    "all-likelihood-stable": {
        combined: {"ROBUST": combined.LIKELIHOOD, "local_minima": minima(*ELSEWHERE)},
    },
    "all-summing-unstable": {
        combined: {
            "BOTH": dict.fromkeys("AB", combined.BOTH["A"]),
            "rms_ratio": Mock(side_effect=[SAME, SAME, WORSE, WORSE]),
            "local_minima": minima(*AT_TRUTH),
        },
    },
    "nci-not-enough": {indices: {"conditions": conditions}},
    "doppler-rejects-moving": {
        drives: {
            **SHORT,
            "TargetWeights": SimpleNamespace(of=weights),
            "walkers_by_pair": always([np.zeros((2, 20), dtype=bool)] * 100),
        },
    },
    "doppler-reduces-error": {drives: SHORT | {"track": useless_doppler}},
    "doppler-more-certain": {drives: SHORT | {"track": useless_doppler}},
    "trajectory-drifts": {drives: SHORT | {"track": in_place}},
    "annealing-no-gain": {drives: SHORT | {"DURATION": 10.0, "followed": lost_where_annealed}},
}


def forget():
    """Forget what other checks have computed."""
    for each in CACHED:
        each.cache_clear()


@pytest.fixture
def world(monkeypatch):
    """Changes modules for one test, without the memory of other checks."""
    forget()
    yield monkeypatch
    forget()


def test_every_claim_has_a_world_in_which_it_is_false():
    """Breaks if a claim is added that nothing could refute."""
    assert list(WORLDS) == list(CLAIMS)


@pytest.mark.parametrize("id", WORLDS)
def test_a_claim_is_refuted_where_it_is_false(world, id):
    """Breaks if a verdict does not come from what is measured, or no measurement can refute it."""
    for module, changes in WORLDS[id].items():
        for name, value in changes.items():
            world.setattr(module, name, value)
    evidence = CLAIMS[id].check()
    assert evidence.verdict == "refuted", dict(evidence.parts)
