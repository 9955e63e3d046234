"""Claims of thesis sections 5.1 and 5.2: optimisers and covariances on the overlapped scene."""

from collections.abc import Sequence
from functools import cache

import numpy as np

from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.point_set import PointSet
from d2d.radar import compare, simulate_drive, track
from d2d.study.book.claim import ANEES, DECIBELS, Evidence, claim, decide, nearly_all
from d2d.study.book.measured import Measured, anees_of, inclination_of, mean_of, median_of, share_of
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
DRIVES, DURATION = 8, 40.0  # of the robot, in s
AREA_STEP = 0.1  # m


@claim("second-order-faster", section="5.1", lines="964", figure="optimizer-paths")
def second_order_faster(ev: Evidence) -> None:
    """The main difference between gradient descent and Newton, Gauss-Newton and Levenberg-Marquardt
    is how fast they reach the minimum and converge.
    """
    problems, starts = random_starts(STARTS, SEED)
    fast = list(map(run_second_order, problems, starts))
    ends = {name: ends_of([each[name] for each in fast]) for name in fast[0]}
    slowest = np.max([each.iterations for each in ends.values()], axis=0)
    slow = {unit: _descents_in(length, problems, starts) for unit, length in UNITS.items()}
    ends = {FIRST_ORDER: slow["m"]} | ends
    lowest = np.min([each.cost for each in ends.values()], axis=0)
    arrived = {name: each.converged & (each.cost - lowest < 1e-3) for name, each in ends.items()}
    failed = ~np.all([arrived[name] for name in ends if name != FIRST_ORDER], axis=0)
    rescued = int(arrived[FIRST_ORDER][failed].sum())
    shares = {name: share_of(each) for name, each in arrived.items()}
    steps = {f"{FIRST_ORDER}, unit of length {unit}": each for unit, each in slow.items()}
    steps |= {name: each for name, each in ends.items() if name != FIRST_ORDER}
    reach = ev.part("they reach the minimum", nearly_all)
    needs_more = ev.part("gradient descent needs more steps", nearly_all)
    faster = {unit: share_of(each.iterations > slowest) for unit, each in slow.items()}
    for unit, share in faster.items():
        add = needs_more.headline if unit == "25 m" else needs_more
        add(f"share of starts in which gradient descent needs more steps, unit {unit}", share)
    in_metres, in_units, *others = (
        ev(f"median iterations, {name}", median_of(each.iterations.astype(float)))
        for name, each in steps.items()
    )
    for name, share in shares.items():
        add = reach.headline if name == "Newton" else reach
        add(f"share that reaches the minimum, {name}", share)
    ev("starts from which one of the three does not reach it", float(failed.sum()))
    ev("of these, starts from which gradient descent does", float(rescued))
    ev.conclude(
        f"gradient descent needs more iterations than the slowest of the others from "
        f"{faster['m']:.0%} of the starts: a median of {in_metres:.0f}, or {in_units:.0f} with "
        "lengths in units of 25 m, which makes shifts and angles weigh alike, and the others "
        f"{max(others):.0f} at most. How many times faster they are is therefore a matter of "
        "units. All four reach the minimum from nearly every start within 5 m "
        f"and 30 degrees: gradient descent from {shares[FIRST_ORDER]:.0%}, Newton's method from "
        f"{shares['Newton']:.1%}, Gauss-Newton from {shares['Gauss-Newton']:.1%} and "
        f"Levenberg-Marquardt from {shares['Levenberg-Marquardt']:.1%}. Newton's method without a "
        "safeguard accepts any stationary point; gradient descent reaches the minimum from "
        f"{rescued} of the {failed.sum()} starts from which that happens.",
        over=f"{STARTS} draws of the noise with a start each",
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
    inverse, propagated = {}, {}
    for name in COSTS:
        study = covariance_study(name)
        hessian, spread = map(study.credibility, ("inverse Hessian", "propagated"))
        inverse[name], propagated[name] = inclination_of(hessian), inclination_of(spread)
        judged.get(name, ev)(f"I2 of the inverse Hessian, {name} (dB)", inverse[name])
        anees, anees_name = anees_of(hessian), f"ANEES of the inverse Hessian, {name}"
        if name == "likelihood":
            ev.headline(anees_name, anees, ANEES.same)
        elif name == "sum":
            for_sum(anees_name, anees, ANEES.same)
        else:
            ev(anees_name, anees)
        ev(f"I2 of the propagated covariance, {name} (dB)", propagated[name])
        ev(f"ANEES of the propagated covariance, {name}", anees_of(spread))
    layouts = over_layouts("likelihood")
    on_layouts = "mean ANEES of the inverse Hessian on random layouts, likelihood"
    enough(on_layouts, mean_of(layouts), ANEES.same)
    road = for_radar.headline(
        "mean ANEES of the inverse Hessian on simulated drives, with Doppler", anees_of_drives()
    )
    ev.conclude(
        "for the D2D likelihood of targets that stand apart I2 is "
        f"{inverse['likelihood']:+.2f} dB with the inverse Hessian and "
        f"{propagated['likelihood']:+.2f} dB with the propagated covariance, for the robust one "
        f"{inverse['robust likelihood']:+.2f} dB and {propagated['robust likelihood']:+.2f} dB. "
        "The sum has the noise in its cost too, and its inverse Hessian is "
        f"{times_off(inverse['sum'])}. On simulated drives, where several targets share a partner, "
        f"the ANEES is {road:.2f}, and on the road it is higher still (chapter 15). P2D, whose "
        f"cost has the noise of one set only, is {times_off(inverse['P2D likelihood'])}, and "
        f"propagation brings I2 to {propagated['P2D likelihood']:+.2f} dB.",
        over=f"{RUNS} draws of the noise of the overlapped scene, and 1000 on each of "
        f"{len(layouts)} random layouts, all started at the truth; {DRIVES} drives of "
        f"{DURATION:g} s",
    )


@cache
def anees_of_drives() -> Measured:
    """Mean ANEES of the inverse Hessian over simulated drives, with Doppler velocities."""
    drives = [simulate_drive(np.random.default_rng(seed), DURATION) for seed in range(DRIVES)]
    return mean_of(
        [
            compare(track(each, baseline=1, carry=False), each.truth).credibility.anees
            for each in drives
        ]
    )


@claim("summing-not-gaussian", section="5.2", lines="831, 1166", figure="covariance-credibility")
def summing_not_gaussian(ev: Evidence) -> None:
    """The likelihood does not violate "any Gaussian assumption like the summing one": by
    section 4.4, "the area under the curve" is one.
    """
    areas = {name: _areas(COSTS[name]) for name in ("likelihood", "sum")}
    last = {name: each[max(each)] for name, each in areas.items()}
    is_one = {name: abs(area - 1.0) < 1e-3 for name, area in last.items()}
    ev.parts["the area of the likelihood is one"] = decide(
        supported=is_one["likelihood"], opposed=not is_one["likelihood"]
    )
    ev.parts["that of the sum is not"] = decide(supported=not is_one["sum"], opposed=is_one["sum"])
    for name, each in areas.items():
        for side, area in each.items():
            ev(f"area of two targets' density over squares of {side:g} m, {name}", area)
    kurtosis: dict[str, Measured] = {}
    quadratic: dict[str, Measured] = {}
    for name in areas:
        kurtosis[name] = ev.headline(
            f"Mardia's kurtosis of the errors over that of a Gaussian, {name}",
            kurtosis_of(covariance_study(name).errors),
        )
        quadratic[name] = ev(
            f"cost at 2 stated deviations over its quadratic model, {name}",
            median_of(quadratic_ratios(name, 2.0)),
        )
    ev.conclude(
        "as densities of the targets' places, which is what the assumption can mean: the product "
        f"has an area of {last['likelihood']:.3f} over all places of two targets, and the sum one "
        f"that grows with the side of the square, to {last['sum']:.3g}. As functions of the motion "
        "neither has an area of one. The errors, divided by the root of their own covariance, have "
        f"{kurtosis['likelihood']:.2f} times the kurtosis of a Gaussian with the likelihood "
        f"and {kurtosis['sum']:.2f} times with the sum, and at two stated standard "
        "deviations from the optimum the negative logarithm is "
        f"{quadratic['likelihood']:.2f} and {quadratic['sum']:.2f} times its quadratic model.",
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
