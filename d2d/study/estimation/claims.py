"""Claims of thesis sections 5.1 and 5.2: optimisers and covariances on the overlapped scene."""

from collections.abc import Sequence

import numpy as np

from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.point_set import PointSet
from d2d.radar import compare
from d2d.study.book.claim import ANEES, DECIBELS, Evidence, claim, decide, nearly_all
from d2d.study.book.measured import Measured, anees_of, inclination_of, mean_of, median_of, share_of
from d2d.study.drives.claims import DRIVES, DURATION, robot_drives
from d2d.study.estimation.covariance_trials import (
    COSTS,
    RUNS,
    SEED,
    covariance_study,
    kurtosis_of,
    over_layouts,
    quadratic_ratios,
)
from d2d.study.estimation.descent import (
    FIRST_ORDER,
    Ends,
    PairedTargets,
    ends_of,
    gradient_descents,
    random_starts,
    run_second_order,
)
from d2d.study.line.scene import FIXED_POSITIONS, SIGMA, TRUTH, line_scene
from d2d.study.plane.evaluation import times_off

STARTS = 300  # of the four methods, within 5 m and 30 degrees of the truth
UNITS = {"m": 1.0, "25 m": 25.0}  # of lengths; in the second, an angle weighs as much as a shift
AREA_STEP = 0.1  # m


@claim("second-order-faster", section="5.1", lines="964", figure="optimizer-paths")
def second_order_faster(ev: Evidence) -> None:
    """The main difference between gradient descent and Newton, Gauss-Newton and Levenberg-Marquardt
    is how fast they reach the minimum and converge.
    """
    problems, starts = random_starts(STARTS, SEED)
    paths = list(map(run_second_order, problems, starts))
    fast = {name: ends_of([each[name] for each in paths]) for name in paths[0]}
    slow = {unit: _descents_in(length, problems, starts) for unit, length in UNITS.items()}
    ends = {FIRST_ORDER: slow["m"]} | fast
    slowest = np.max([each.iterations for each in fast.values()], axis=0)
    lowest = np.min([each.cost for each in ends.values()], axis=0)
    arrived = {name: each.converged & (each.cost - lowest < 1e-3) for name, each in ends.items()}
    failed = ~np.all([arrived[name] for name in fast], axis=0)
    reach = ev.part("they reach the minimum", nearly_all)
    needs_more = ev.part("gradient descent needs more steps", nearly_all)
    for unit, each in slow.items():
        more = share_of(each.iterations > slowest)
        add = needs_more.headline if unit == "25 m" else needs_more
        add(f"share of starts in which gradient descent needs more steps, unit {unit}", more)
    steps = {f"{FIRST_ORDER}, unit of length {unit}": each for unit, each in slow.items()}
    in_metres, in_units, *_ = (
        ev(f"median iterations, {name}", median_of(each.iterations.astype(float)))
        for name, each in (steps | fast).items()
    )
    for name, each in arrived.items():
        add = reach.headline if name == "Newton" else reach
        add(f"share that reaches the minimum, {name}", share_of(each))
    ev("starts from which one of the three does not reach it", float(failed.sum()))
    rescued = float(arrived[FIRST_ORDER][failed].sum())
    ev("of these, starts from which gradient descent does", rescued)
    ev.conclude(
        f"gradient descent needs a median of {in_metres:.0f} iterations, or {in_units:.0f} with "
        "lengths in units of 25 m, which makes shifts and angles weigh alike: how many times "
        "faster the others are is a matter of units. Newton's method without a safeguard accepts "
        "any stationary point; gradient descent reaches the minimum from starts from which that "
        "happens.",
        over=f"{STARTS} draws of the noise with a start each, within 5 m and 30 degrees",
    )


def _descents_in(length: float, problems: Sequence[PairedTargets], starts: Array) -> Ends:
    """Gradient descents with lengths in units of ``length`` m; the cost is the same."""

    def scaled(points: PointSet) -> PointSet:
        return PointSet(points.means / length, points.covariances / length**2)

    smaller = [PairedTargets(scaled(each.fixed), scaled(each.moving)) for each in problems]
    return gradient_descents(smaller, starts / (length, length, 1.0))


@claim("fisher-suffices", section="5.2", lines="1166", figure="covariance-credibility")
def fisher_suffices(ev: Evidence) -> None:
    """As long as the input noise is in the cost function, the inverse Hessian is "enough", and
    there is "no need" for error propagation.
    """
    enough = ev.part("for the likelihood of separate targets", DECIBELS.same)
    for_sum = ev.part("for the sum, which has the noise in its cost too", DECIBELS.same)
    for_radar = ev.part("for the scans of a radar", ANEES.same)
    judged = {"likelihood": enough, "robust likelihood": enough, "sum": for_sum}
    for name in COSTS:
        study = covariance_study(name)
        hessian, propagated = map(study.credibility, ("inverse Hessian", "propagated"))
        inverse = inclination_of(hessian)
        judged.get(name, ev)(f"I² of the inverse Hessian, {name} (dB)", inverse)
        anees, anees_name = anees_of(hessian), f"ANEES of the inverse Hessian, {name}"
        if name == "likelihood":
            ev.headline(anees_name, anees, ANEES.same)
        elif name == "sum":
            off = times_off(inverse)
            for_sum(anees_name, anees, ANEES.same)
        else:
            ev(anees_name, anees)
        ev(f"I² of the propagated covariance, {name} (dB)", inclination_of(propagated))
        ev(f"ANEES of the propagated covariance, {name}", anees_of(propagated))
    layouts = over_layouts("likelihood")
    on_layouts = "mean ANEES of the inverse Hessian on random layouts, likelihood"
    enough(on_layouts, mean_of(layouts), ANEES.same)
    drives = "mean ANEES of the inverse Hessian on simulated drives, with Doppler"
    road = for_radar.headline(drives, anees_of_drives())
    ev.conclude(
        f"the sum has the noise in its cost too, and its inverse Hessian is {off}. On simulated "
        f"drives, where several targets share a partner, the ANEES is {road:.2f}, and on the road "
        "it is higher still (chapter 15). P2D, whose cost has the noise of one set only, is too "
        "small, and propagation mends it.",
        over=f"{RUNS} draws of the noise of the overlapped scene, and 1000 on each of "
        f"{len(layouts)} random layouts, all started at the truth; {DRIVES} drives of "
        f"{DURATION:g} s",
    )


def anees_of_drives() -> Measured:
    """Mean ANEES of the inverse Hessian over simulated drives, with Doppler velocities."""
    tracked = [compare(tracks[True], drive.truth) for drive, tracks in robot_drives()]
    return mean_of([each.credibility.anees for each in tracked])


@claim("summing-not-gaussian", section="5.2", lines="831, 1166", figure="covariance-credibility")
def summing_not_gaussian(ev: Evidence) -> None:
    """The likelihood does not violate "any Gaussian assumption like the summing one": by
    section 4.4, "the area under the curve" is one.
    """
    names = {"likelihood": "is one", "sum": "is not"}
    subjects = {"likelihood": "the area of the likelihood", "sum": "that of the sum"}
    for name, words in names.items():
        for side, area in _areas(COSTS[name]).items():
            ev(f"area of two targets' density over squares of {side:g} m, {name}", area)
        is_so = (abs(area - 1.0) < 1e-3) == (words == "is one")
        ev.parts[f"{subjects[name]} {words}"] = decide(supported=is_so, opposed=not is_so)
    for name in names:
        ev.headline(
            f"Mardia's kurtosis of the errors over that of a Gaussian, {name}",
            kurtosis_of(covariance_study(name).errors),
        )
        quadratic = median_of(quadratic_ratios(name, 2.0))
        ev(f"cost at 2 stated deviations over its quadratic model, {name}", quadratic)
    ev.conclude(
        "as densities of the targets' places, which is what the assumption can mean: the area of "
        "the sum grows with the side of the square. As functions of the motion neither has an area "
        "of one. The errors, divided by the root of their own covariance, are Gaussian with the "
        "likelihood and nearly so with the sum.",
        over=f"one draw of the scene on a line for the areas, {RUNS} draws of the noise of the "
        "overlapped scene, started at the truth, for the errors, 500 for the cost",
    )


def _areas(cost: RegistrationCost) -> dict[float, float]:
    """Integral of the fused density over the places of two targets of M, by the square's side."""
    fixed, _ = line_scene(np.random.default_rng(SEED))
    areas = {}
    for side in (20.0, 40.0, 80.0):  # m, about the components
        places = FIXED_POSITIONS.mean() - TRUTH + np.arange(-0.5 * side, 0.5 * side, AREA_STEP)
        pairs = np.stack(np.meshgrid(places, places), axis=-1).reshape(-1, 2, 1)
        moving = PointSet(pairs, np.full((2, 1, 1), SIGMA**2))
        density = np.exp(-cost.value(np.array([TRUTH]), fixed, moving))
        areas[side] = float(density.sum() * AREA_STEP**2)
    return areas
