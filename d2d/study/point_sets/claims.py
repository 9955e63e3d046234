"""Claims of thesis chapter 3: ICP and the NDT."""

from functools import lru_cache

import numpy as np

from d2d._types import Array
from d2d.baselines import icp, ndt_d2d, ndt_p2d
from d2d.baselines.icp import Metric
from d2d.study.book.claim import SHARE, Evidence, claim, judge, larger, most, nearly_all, smaller
from d2d.study.book.measured import Measured, mean_of, median_of, share_over, telling
from d2d.study.point_sets.convergence import (
    CELL_SIZES,
    MAX_DISTANCE,
    MAX_ROTATION,
    METHODS,
    NEAR_DISTANCE,
    NEAR_ROTATION,
    draw_offsets,
    is_registered,
    ndt_coarse_to_fine,
)
from d2d.study.point_sets.room_scans import MOTION, RoomScan, random_room, room_pair

ROOMS = 12
FAR_STARTS, NEAR_STARTS = 12, 6  # of each room
FULL_VIEW = "field of view 360 deg"
SCENES: dict[str, dict[str, float]] = {
    FULL_VIEW: {},
    "20 % outliers": {"outliers": 0.2},
    "field of view 120 deg": {"field_of_view": np.deg2rad(120.0)},
}
ICP = "ICP, point to point"
NDT = ("NDT, P2D", "NDT, D2D")
COMPARED = (ICP, "ICP, point to line", *NDT)
COARSE = {
    "NDT, P2D, cells of 4, 2 and 1 m in turn": ndt_coarse_to_fine(ndt_p2d, *CELL_SIZES),
    "NDT, D2D, cells of 4, 2 and 1 m in turn": ndt_coarse_to_fine(ndt_d2d, *CELL_SIZES),
}

NEAR = f"within {NEAR_DISTANCE:g} m and {np.rad2deg(NEAR_ROTATION):.0f} deg"
FAR = f"within {MAX_DISTANCE:g} m and {np.rad2deg(MAX_ROTATION):.0f} deg"
OVER = (
    f"{ROOMS} random rooms in each of {len(SCENES)} scenes, with {FAR_STARTS} far and "
    f"{NEAR_STARTS} near starts in each room"
)


def _scan_pair(scene: str, number: int) -> tuple[RoomScan, RoomScan, np.random.Generator]:
    """Two scans of another room for every number, and the generator that goes on from there."""
    rng = np.random.default_rng([37, list(SCENES).index(scene), number])
    before, after = room_pair(rng, walls=random_room(rng), **SCENES[scene])
    return before, after, rng


@lru_cache(maxsize=1)
def _success_shares() -> dict[tuple[str, str], Array]:
    """Share of starts that end at the truth, far and near, in each room (ROOMS, 2)."""
    methods = {name: METHODS[name] for name in COMPARED} | COARSE
    shares = {key: np.empty((ROOMS, 2)) for key in ((s, m) for s in SCENES for m in methods)}
    for scene in SCENES:
        for room in range(ROOMS):
            before, after, rng = _scan_pair(scene, room)
            far = draw_offsets(rng, FAR_STARTS, MAX_DISTANCE, MAX_ROTATION)
            near = draw_offsets(rng, NEAR_STARTS, NEAR_DISTANCE, NEAR_ROTATION)
            starts = MOTION + np.concatenate([far, near])
            for method, run in methods.items():
                good = is_registered(run(before, after, starts), MOTION)
                shares[scene, method][room] = good[:FAR_STARTS].mean(), good[FAR_STARTS:].mean()
    return shares


# The rooms are independent, but the starts in one room are not: intervals are over the rooms.


def _far(scene: str, method: str) -> Measured:
    return share_over(_success_shares()[scene, method][:, 0], FAR_STARTS)


def _near(scene: str, method: str) -> Measured:
    return share_over(_success_shares()[scene, method][:, 1], NEAR_STARTS)


def _loss_with_distance(scene: str, method: str) -> Measured:
    """By how much the share of successes from far starts is below that from near ones."""
    far, near = _success_shares()[scene, method].T
    return mean_of(near - far)


def _lead(scene: str, method: str, other: str) -> Measured:
    """Difference of two methods' shares of successes from far starts, room by room."""
    shares = _success_shares()
    return mean_of(shares[scene, method][:, 0] - shares[scene, other][:, 0])


def _far_range(*methods: str) -> str:
    """The lowest and the highest share of successes from far starts, over scenes and methods."""
    shares = [_far(scene, method) for scene in SCENES for method in methods]
    return f"{min(shares):.0%} to {max(shares):.0%}"


def _near_minimum(method: str) -> str:
    """The lowest share of successes from near starts over the scenes."""
    return f"{min(_near(scene, method) for scene in SCENES):.0%}"


def _median_iterations(metric: Metric) -> Measured:
    """Median number of ICP iterations from near starts in the scene without outliers."""
    counts = []
    for room in range(ROOMS):
        before, after, rng = _scan_pair(FULL_VIEW, room)
        starts = MOTION + draw_offsets(rng, NEAR_STARTS, NEAR_DISTANCE, NEAR_ROTATION)
        result = icp(before.points, after.points, starts, metric=metric)
        counts.append(result.iterations)
    return median_of(np.array(counts))


@claim("icp-feeble", section="3.1", figure="icp-convergence")
def icp_feeble() -> Evidence:
    """The convergence of standard ICP is feeble: it needs a good initial guess."""
    numbers: dict[str, float] = {}
    for scene in SCENES:
        numbers[f"{scene}: share from near starts, {ICP}"] = _near(scene, ICP)
        for method in (*COMPARED, *COARSE):
            numbers[f"{scene}: share from far starts, {method}"] = telling(
                _far(scene, method), scene == FULL_VIEW and method in (ICP, "NDT, D2D")
            )
        for method in COARSE:
            numbers[f"{scene}: share from near starts, {method}"] = _near(scene, method)
    numbers["median iterations from near starts, point to point"] = _median_iterations("point")
    numbers["median iterations from near starts, point to line"] = _median_iterations("line")

    needs_guess = all(
        most(_near(scene, ICP)) and larger(_loss_with_distance(scene, ICP), SHARE)
        for scene in SCENES
    )
    leads, leads_of_coarse = (
        [_lead(scene, ICP, ndt) for scene in SCENES for ndt in kind] for kind in (NDT, COARSE)
    )
    numbers["smallest lead of ICP over an NDT with cells of 1 m"] = min(leads)
    numbers["smallest lead of ICP over an NDT with coarse to fine cells"] = min(leads_of_coarse)
    below_ndt = all(smaller(lead, SHARE) for lead in leads)
    above_ndt = all(larger(lead, SHARE) for lead in leads)
    above_coarse = sum(larger(lead, SHARE) for lead in leads_of_coarse)
    if above_ndt and above_coarse == len(leads_of_coarse):
        comparison = "ICP is ahead of all of them in every scene"
    elif above_ndt:
        comparison = (
            "ICP is ahead of those with cells of 1 m in every scene, and of those with coarse to "
            f"fine cells in {above_coarse} of {len(leads_of_coarse)} cases"
        )
    elif below_ndt:
        comparison = "ICP is behind those with cells of 1 m in every scene"
    else:
        comparison = "whether ICP is ahead depends on the scene"
    return Evidence(
        judge(confirmed=needs_guess and below_ndt, qualified=needs_guess),
        f"in its worst scene ICP succeeds from {_near_minimum(ICP)} of the near starts ({NEAR}), "
        f"and from {_far_range(ICP)} of the far starts ({FAR}), depending on the scene"
        + (", so it needs a good guess" if needs_guess else "")
        + f". The NDTs succeed from {_far_range(*NDT)} of the far starts with cells of 1 m and "
        f"from {_far_range(*COARSE)} with coarse to fine cells: {comparison}.",
        numbers,
        holds=f"For far starts on their own, from {_far_range(ICP)} of which ICP succeeds. It does "
        f"not hold {'' if above_ndt else 'throughout '}in comparison with the NDTs: {comparison}.",
        over=OVER,
    )


@claim("ndt-registers", section="3.2", figure="ndt-d2d")
def ndt_registers() -> Evidence:
    """Point-to-distribution and distribution-to-distribution NDT both register the scans."""
    numbers: dict[str, float] = {}
    for scene in SCENES:
        for method in NDT:
            shown = scene == FULL_VIEW and method == "NDT, P2D"
            numbers |= {
                f"{scene}: share from near starts, {method}": telling(_near(scene, method), shown),
                f"{scene}: share from far starts, {method}": telling(_far(scene, method), shown),
            }
    near = [_near(scene, method) for scene in SCENES for method in NDT]
    far = [_far(scene, method) for scene in SCENES for method in NDT]
    p2d, d2d = NDT
    return Evidence(
        judge(confirmed=all(map(nearly_all, near + far)), qualified=all(map(most, near))),
        f"in its worst scene P2D succeeds from {_near_minimum(p2d)} of the near starts ({NEAR}) "
        f"and D2D from {_near_minimum(d2d)}. From the far starts ({FAR}) P2D succeeds in "
        f"{_far_range(p2d)} of the cases, depending on the scene, and D2D in {_far_range(d2d)}.",
        numbers,
        holds=f"The start is {NEAR} of the truth, as between two scans of a moving vehicle whose "
        f"motion is predicted; from far ones P2D succeeds in {_far_range(p2d)} of the cases and "
        f"D2D in {_far_range(d2d)}.",
        over=OVER,
    )
