"""The thesis's two-dimensional scenarios (thesis sec. 6.1 and 6.3)."""

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from d2d import rigid
from d2d._types import Array
from d2d.point_set import PointSet

# The thesis does not list its eight targets; these come from its group's public follow-up code:
# azimuth (rad) and range (m) in the frame of the previous scan.
EIGHT_TARGETS = np.array(
    [
        (0.2458, 0.4928, 0.3532, 0.0770, -0.0364, -0.6750, -0.5330, -0.3608),
        (15.5935, 21.4556, 31.7386, 23.3288, 32.8625, 14.4914, 24.3163, 31.1166),
    ]
).T
EMPTY = np.empty((0, 2))


def cartesian(azimuth_range: Array) -> Array:
    """Positions (n, 2) in m of targets given by azimuth (rad) and range (m)."""
    azimuth, distance = azimuth_range.T
    return np.stack([distance * np.cos(azimuth), distance * np.sin(azimuth)], axis=-1)


def noisy_polar(
    rng: np.random.Generator,
    positions: Array,
    sigma_range: float,
    sigma_azimuth: float,
    draws: tuple[int, ...] = (),
) -> tuple[Array, Array]:
    """Noisy ranges (m) and azimuths (rad) ``(*draws, ..., N)`` of positions (..., N, 2) in m."""
    x, y = positions[..., 0], positions[..., 1]
    noise = rng.standard_normal((2, *draws, *x.shape))
    return np.hypot(x, y) + sigma_range * noise[0], np.arctan2(y, x) + sigma_azimuth * noise[1]


@dataclass(frozen=True, eq=False)
class Scenario:
    """Static targets seen from two places, with the noise in polar coordinates that they state."""

    name: str
    # (n, 2) in m, seen in both scans, in the frame of the previous one
    targets: Array = field(default_factory=lambda: cartesian(EIGHT_TARGETS))
    # (..., 2) in m, seen in one scan only, each in that scan's frame
    outliers_fixed: Array = field(default_factory=lambda: EMPTY)
    outliers_moving: Array = field(default_factory=lambda: EMPTY)
    # true motion [t_x, t_y, phi_z] in m, m, rad, from the moving onto the fixed set
    theta: Array = field(default_factory=lambda: np.array([5.0, 0.0, np.deg2rad(15.0)]))
    sigma_range: float = 0.2  # m
    sigma_azimuth: float = 0.03  # rad

    @property
    def true_sets(self) -> tuple[Array, Array]:
        """Noise-free positions of the fixed and of the moving set, each in its own frame."""
        moved = rigid.transform_means(rigid.inverse(self.theta), self.targets)
        return (
            np.concatenate([self.targets, self.outliers_fixed]),
            np.concatenate([moved, self.outliers_moving]),
        )

    def sample(self, runs: int, rng: np.random.Generator) -> tuple[PointSet, PointSet]:
        """Draw noisy scans: fixed and moving sets of batch shape (runs,)."""
        fixed, moving = self.true_sets
        return self._observe(fixed, runs, rng), self._observe(moving, runs, rng)

    def _observe(self, positions: Array, runs: int, rng: np.random.Generator) -> PointSet:
        sigmas = self.sigma_range, self.sigma_azimuth
        return PointSet.from_polar(*noisy_polar(rng, positions, *sigmas, (runs,)), *sigmas)


@dataclass(frozen=True)
class Layout:
    """The outliers and clusters of a scene, and the regions where they are placed at random.

    The thesis gives neither.  Beside eight targets there are a close and a far outlier in each set,
    the share of 0.2 that it assumes; twice as many where two clusters double the targets.
    """

    close: int = 0  # outliers in each set beside a target
    far: int = 0  # and farther from the sensor than any target
    clusters: int = 0  # targets that become clusters
    companions: int = 4  # targets added to each of them
    close_distance: ClassVar[tuple[float, float]] = (2.0, 4.0)  # m, from the target beside it
    far_distance: ClassVar[tuple[float, float]] = (50.0, 60.0)  # m, from the sensor
    cluster_radius: float = 1.5  # m, of the disc over which companions are spread evenly


FIELD_OF_VIEW = 0.7  # rad to either side; the eight targets fill it
RANGES = (14.0, 33.0)  # m, those of the eight targets
SEPARATION = 6.0  # m: "well distributed"; the eight targets are at least 7 m apart

LAYOUTS = {
    "overlapped": Layout(),
    "outliers": Layout(close=1, far=1),
    "clusters": Layout(clusters=2),
    "outliers and clusters": Layout(close=2, far=2, clusters=2),
}


def scene(
    name: str,
    layout: Layout,
    rng: np.random.Generator,
    targets: Array | None = None,
    **parameters: Any,
) -> Scenario:
    """Put outliers and clusters at random around targets (n, 2); ``parameters`` of `Scenario`."""
    originals = cartesian(EIGHT_TARGETS) if targets is None else targets
    bare = Scenario(name, originals, **parameters)
    fixed, moving = bare.true_sets
    centres = rng.choice(len(originals), layout.clusters, replace=False)
    clusters = [
        originals[centre] + _in_ring(rng, layout.companions, 0.0, layout.cluster_radius)
        for centre in centres
    ]
    return replace(
        bare,
        targets=np.concatenate([originals, *clusters]),
        outliers_fixed=_outliers(rng, layout, fixed),
        outliers_moving=_outliers(rng, layout, moving),
    )


def random_scene(
    name: str, layout: Layout, rng: np.random.Generator, count: int = 8, **parameters: Any
) -> Scenario:
    """A scene of ``count`` targets at random places in the field of view, 6 m or more apart."""
    targets = EMPTY
    while len(targets) < count:
        azimuth = rng.uniform(-FIELD_OF_VIEW, FIELD_OF_VIEW)
        candidate = cartesian(np.array([[azimuth, rng.uniform(*RANGES)]]))
        if (np.linalg.norm(targets - candidate, axis=-1) >= SEPARATION).all():
            targets = np.concatenate([targets, candidate])
    return scene(name, layout, rng, targets, **parameters)


def _in_ring(rng: np.random.Generator, count: int, min_radius: float, max_radius: float) -> Array:
    """Offsets (count, 2) spread evenly over a ring."""
    distance = np.sqrt(rng.uniform(min_radius**2, max_radius**2, count))
    return cartesian(np.stack([rng.uniform(-np.pi, np.pi, count), distance], axis=-1))


def _outliers(rng: np.random.Generator, layout: Layout, targets: Array) -> Array:
    """Close outliers, each beside one of the targets, then far ones."""
    neighbours = targets[rng.choice(len(targets), layout.close, replace=False)]
    azimuth = rng.uniform(-FIELD_OF_VIEW, FIELD_OF_VIEW, layout.far)
    distance = rng.uniform(*layout.far_distance, layout.far)
    return np.concatenate(
        [
            neighbours + _in_ring(rng, layout.close, *layout.close_distance),
            cartesian(np.stack([azimuth, distance], axis=-1)),
        ]
    )


OVERLAPPED = Scenario("overlapped")
OUTLIERS = scene("outliers", LAYOUTS["outliers"], np.random.default_rng(1))
CLUSTERS = scene("clusters", LAYOUTS["clusters"], np.random.default_rng(1))
OUTLIERS_AND_CLUSTERS_A = scene(
    "outliers and clusters A", LAYOUTS["outliers and clusters"], np.random.default_rng(1)
)
OUTLIERS_AND_CLUSTERS_B = scene(
    "outliers and clusters B", LAYOUTS["outliers and clusters"], np.random.default_rng(2)
)
ALL = (OVERLAPPED, OUTLIERS, CLUSTERS, OUTLIERS_AND_CLUSTERS_A, OUTLIERS_AND_CLUSTERS_B)
