"""Claims of thesis chapter 7 on simulated drives: what the Doppler velocities bring."""

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from d2d import ANNEALED
from d2d._types import Array
from d2d.bootstrap import block_length
from d2d.radar import Track, compare, simulate_drive, track
from d2d.radar.simulation.drive import CAR_MOUNTING, CAR_SPEED, Drive
from d2d.study.book.claim import (
    RATIO,
    SHARE,
    Evidence,
    Margin,
    claim,
    hardly_any,
    judge,
    larger,
    nearly_all,
)
from d2d.study.book.measured import (
    Measured,
    geometric_mean_of,
    mean_of,
    rms_ratio,
    share_counted,
    share_over,
    telling,
)
from d2d.study.drives.errors import NAMES
from d2d.study.drives.moving_targets import TargetWeights, walkers_by_pair
from d2d.study.drives.variations import followed

DRIVES = 8
DURATION = 40.0  # s: a third of a lap, with two bends
DOPPLER = {"without": False, "with": True}
WALKING_SPEED = 1.5  # m/s
OVER = f"{DRIVES} drives of the robot of {DURATION:g} s"


def _ratios(what: str, ratio: list[Measured], shown: Sequence[str]) -> dict[str, float]:
    """A ratio of v_x, v_y and omega as three numbers, of which some are telling."""
    return {
        f"{what} of {name}, without / with": telling(each, name in shown)
        for name, each in zip(NAMES, ratio, strict=True)
    }


def _by_component(values: Sequence[float]) -> str:
    each = [f"{value:.1f} ({name})" for name, value in zip(NAMES, values, strict=True)]
    return f"{', '.join(each[:-1])} and {each[-1]}"


@cache
def tracked_drive(seed: int, by_car: bool) -> tuple[Drive, dict[bool, Track]]:
    """A drive of the robot, or of the car; its tracks without and with Doppler."""
    rng = np.random.default_rng(seed)
    if by_car:
        drive = simulate_drive(rng, DURATION, CAR_SPEED, mounting=CAR_MOUNTING)
    else:
        drive = simulate_drive(rng, DURATION)
    return drive, {d: track(drive, doppler=d) for d in (False, True)}


def robot_drives() -> list[tuple[Drive, dict[bool, Track]]]:
    """The drives of the robot, each with its tracks."""
    return [tracked_drive(seed, False) for seed in range(DRIVES)]


@claim("doppler-rejects-moving", section="7.1", figure="moving-targets")
def doppler_rejects_moving() -> Evidence:
    """The Doppler velocities suppress targets that move."""
    # per drive: moving without and with Doppler, still with; per pair: walking along, and across
    shares, counts = np.empty((DRIVES, 3)), np.empty((DRIVES, 2))
    walking: list[Array] = []
    for seed in range(DRIVES):
        drive, tracks = tracked_drive(seed, by_car=seed % 2 == 1)
        for doppler, driven in tracks.items():
            weights = TargetWeights.of(drive, driven, doppler=doppler)
            moving = weights.kind == "moving"
            shares[seed, int(doppler)] = weights.rejected(moving)
        fixed = ~np.isin(weights.kind, ("moving", "clutter"))
        shares[seed, 2] = weights.rejected(fixed)
        counts[seed] = moving.sum(), fixed.sum()
        angles = np.array([0.0, 0.5 * np.pi])
        pairs = walkers_by_pair(drive, driven, WALKING_SPEED, angles)
        walking.extend(pair.mean(axis=1) for pair in pairs)
    met = ~np.isnan(shares).any(axis=1)
    seen, (number_moving, number_fixed) = shares[met], counts[met].mean(axis=0)
    without, with_doppler = (share_over(each, number_moving) for each in seen.T[:2])
    still = share_over(seen[:, 2], number_fixed)
    along, across = (share_over(each, 1) for each in np.transpose(walking))
    gain = mean_of(seen[:, 1] - seen[:, 0])
    suppressed = larger(gain, SHARE) and nearly_all(with_doppler)
    across_too = nearly_all(across)
    return Evidence(
        judge(confirmed=suppressed and across_too, qualified=suppressed),
        f"with Doppler {with_doppler:.0%} of the moving targets are rejected, without it "
        f"{without:.0%}. Of walkers along the line of sight, who miss the Doppler velocity of a "
        f"target that stands still by many standard deviations, {along:.0%} are rejected; of those "
        "at a right angle to it, who have that very velocity and move too little between two scans "
        f"to miss their place, {across:.1%}.",
        {
            "share of moving targets rejected without Doppler": without,
            "share of moving targets rejected with Doppler": telling(with_doppler),
            "difference of these shares": gain,
            "share of targets that stand still rejected with Doppler": still,
            "share rejected with Doppler, walking along the line of sight": along,
            "share rejected with Doppler, walking across it": telling(across),
        },
        holds="For targets that move along the line of sight, as most traffic in a street does: "
        f"{along:.0%} of those that walk along it are rejected, {across:.1%} of those that walk "
        "across it.",
        over=f"{len(seen)} drives of {DURATION:g} s in traffic, half by robot, half by car; "
        "walkers in every tenth pair",
    )


@claim("doppler-reduces-error", section="7.3", figure="ego-error")
def doppler_reduces_error() -> Evidence:
    """The Doppler velocities reduce the estimation error."""
    # only pairs of scans for which both estimates are accepted, one drive after the other
    errors: dict[bool, list[Array]] = {False: [], True: []}
    for drive, tracks in robot_drives():
        accepted = tracks[False].converged & tracks[True].converged
        for doppler, driven in tracks.items():
            errors[doppler].append((driven.theta - drive.truth.theta[1:])[accepted])
    without, with_doppler = map(np.concatenate, errors.values())
    block = max(block_length(np.square(without)), block_length(np.square(with_doppler)))
    pairs = zip(without.T, with_doppler.T, strict=True)
    ratio = [rms_ratio(over, under, block) for over, under in pairs]
    less = [larger(each, RATIO) for each in ratio]
    return Evidence(
        judge(confirmed=all(less), qualified=any(less)),
        f"the RMSE without Doppler over that with it is {_by_component(ratio)}. The Doppler "
        "velocities measure the sensor's velocity directly; the rotation is seen by the positions.",
        _ratios("ratio of the RMSE", ratio, ("v_x", "omega")),
        holds="For the components for which the lower bound of the 95% interval of the ratio "
        f"exceeds {RATIO.high:g}: it is {_by_component([each.low for each in ratio])}.",
        over=OVER,
    )


@claim("doppler-more-certain", section="7.3", figure="ego-covariance")
def doppler_more_certain() -> Evidence:
    """The Doppler velocities make the estimate more certain."""
    drives = {
        name: [compare(tracks[doppler], drive.truth) for drive, tracks in robot_drives()]
        for name, doppler in DOPPLER.items()
    }
    sigmas = {
        name: np.array([np.median(each.sigmas, axis=0) for each in found])
        for name, found in drives.items()
    }
    ratio = [geometric_mean_of(each) for each in (sigmas["without"] / sigmas["with"]).T]
    anees = {
        name: mean_of([each.credibility.anees for each in found]) for name, found in drives.items()
    }
    more = [larger(each, RATIO) for each in ratio]
    return Evidence(
        judge(confirmed=all(more), qualified=any(more)),
        f"the median sigma without Doppler over that with it is {_by_component(ratio)}, and the "
        f"mean ANEES is {anees['without']:.2f} without and {anees['with']:.2f} with it. Another "
        "factor adds curvature to the negative logarithm, so that its inverse shrinks; the thesis "
        "has it the other way round when it says that the curvature becomes less.",
        _ratios("ratio of the median sigma", ratio, ("v_x",))
        | {
            "mean ANEES without Doppler": anees["without"],
            "mean ANEES with Doppler": telling(anees["with"]),
        },
        holds="For the components whose ratio has a lower bound of the 95% interval above "
        f"{RATIO.high:g}: it is {_by_component([each.low for each in ratio])}.",
        over=OVER,
    )


@claim("trajectory-drifts", section="7.3", figure="ego-trajectory")
def trajectory_drifts() -> Evidence:
    """The integrated trajectory accumulates error, with and without Doppler."""
    numbers: dict[str, float] = {}
    growing, said = True, []
    for name, doppler in DOPPLER.items():
        offsets = []
        for drive, tracks in robot_drives():
            true = drive.truth.poses
            off = tracks[doppler].poses(true[0]) - true
            offsets.append(np.linalg.norm(off[[len(true) // 4, -1], :2], axis=-1))
        quarter, end = np.transpose(offsets)  # of each drive, in m
        growth = mean_of(end - quarter)
        growing &= larger(growth, Margin(0.0, (RATIO.high - 1.0) * float(quarter.mean())))
        said.append(f"{quarter.mean():.2f} m and {end.mean():.2f} m {name} Doppler")
        numbers |= {
            f"mean position error after a quarter, {name} Doppler (m)": mean_of(quarter),
            f"mean position error at the end, {name} Doppler (m)": telling(mean_of(end)),
            f"mean growth, {name} Doppler (m)": growth,
        }
    return Evidence(
        judge(confirmed=growing),
        "after a quarter of the drive and at its end the mean position error is "
        f"{said[0]}, {said[1]}. Each pair's error is added to all later poses; the Doppler "
        "velocities change the size of a pair's error, not that errors add up.",
        numbers,
        holds="Only where the path is not known.",
        over=OVER,
    )


@claim("annealing-no-gain", section="7.3", figure="ego-error")
def annealing_no_gain() -> Evidence:
    """Starting from inflated covariances gains little over the constant-velocity start."""
    numbers: dict[str, float] = {}
    little: dict[tuple[str, bool], bool] = {}
    said = []
    for vehicle, by_car in (("robot", False), ("car", True)):
        for name, doppler in (("with", True), ("without", False)):
            gain = _gain_of_annealing(by_car, doppler)
            little[vehicle, doppler] = hardly_any(gain.nearer) and gain.ratio.high < RATIO.high
            what = f"{name} Doppler, {vehicle}"
            numbers |= {
                f"share of pairs that annealing brings nearer to the true v_x, {what}": telling(
                    gain.nearer, doppler
                ),
                f"share of pairs that it takes farther from it, {what}": gain.farther,
                f"ratio of the RMSE of v_x, plain / annealed, {what}": gain.ratio,
                f"drives in which it lowers the RMSE of v_x by more than 5 %, {what}": gain.drives,
            }
            said.append(
                f"{what}: {gain.nearer:.2%} nearer and {gain.farther:.2%} farther, RMSE "
                f"{gain.ratio:.2f} times ({gain.ratio.between('.2f')})"
            )
    own = all(little["robot", doppler] for doppler in (True, False))
    lost = sum(numbers[name] for name in numbers if name.startswith("drives"))
    return Evidence(
        judge(confirmed=all(little.values()), qualified=own or any(little.values())),
        "each pair is estimated once from the last velocity, without the second start that `track` "
        "gives to a doubtful pair. Share of pairs that annealing brings nearer to the true v_x and "
        "takes farther from it, and the RMSE from plain starts over that with annealing: "
        f"{'; '.join(said)}. Where the last velocity lies within the basin of the best optimum "
        "both end there. Where a pair goes astray, the next ones start from its velocity, and "
        "inflated standard deviations can lead back.",
        numbers,
        holds=(
            "For the robot, the thesis's own vehicle"
            if own
            else "For "
            + " and ".join(
                f"the {vehicle} {'with' if doppler else 'without'} Doppler"
                for (vehicle, doppler), passed in little.items()
                if passed
            )
        )
        + f". In {lost:.0f} of the {2 * DRIVES} runs a pair went astray; there annealing leads "
        "back.",
        over=f"{DRIVES} drives of {DURATION:g} s, half by robot and half by car, each pair started "
        "at the last velocity",
    )


class _Gain(NamedTuple):
    """What annealing brings where each pair starts at the last velocity."""

    nearer: Measured  # share of the pairs
    farther: Measured
    ratio: Measured  # of the RMSEs of v_x, plain / annealed
    drives: float  # number in which it lowers the RMSE by more than the margin


def _gain_of_annealing(by_car: bool, doppler: bool) -> _Gain:
    nearer, farther, errors = [], [], []
    for seed in range(int(by_car), DRIVES, 2):
        drive, _ = tracked_drive(seed, by_car)
        off = [
            np.abs(followed(drive, doppler=doppler, scales=scales) - drive.truth.theta[1:])[:, 0]
            for scales in ((1.0,), ANNEALED)
        ]
        nearer.append((off[1] < off[0] - 1e-3) * 1.0)
        farther.append((off[1] > off[0] + 1e-3) * 1.0)
        errors.append(off)
    plain, annealed = (np.concatenate(each) for each in zip(*errors, strict=True))
    block = max(block_length(plain**2), block_length(annealed**2))
    ratio = rms_ratio(plain, annealed, block)
    gains = [np.sqrt(np.mean(a**2) / np.mean(b**2)) > RATIO.high for a, b in errors]
    closer, worse = (
        share_counted(float(each.mean()), len(each) / block_length(each))
        for each in map(np.concatenate, (nearer, farther))
    )
    return _Gain(closer, worse, ratio, float(sum(gains)))
