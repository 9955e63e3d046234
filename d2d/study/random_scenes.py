"""Scenes that put their targets elsewhere in every run (chapter 9)."""

from dataclasses import dataclass

import numpy as np

from d2d import rigid
from d2d._checks import Array
from d2d.point_set import PointSet
from d2d.study.scenarios import FIELD_OF_VIEW, RANGES, Scenario, cartesian

_MOST_TRIES = 2000  # for one target, before its scene counts as too crowded


@dataclass(frozen=True, eq=False)
class RandomScenes(Scenario):
    """Targets at random places in the field of view, drawn anew for every run.

    What a sweep over it measures is an average over layouts and noise together.  The fields of
    `Scenario` that name positions are not used; its ``theta`` and its noise are.

    Attributes
    ----------
    size : int
        Targets in each scan.
    outlier_share : float
        Of each scan's targets, seen in this scan only, anywhere in the field of view.
    overlap : float
        One minus the share of each scan's targets that the other does not see because they lie
        beyond one side of its field of view: to the right in the fixed scan, to the left in the
        moving one.
    spacing : float, m
        Least distance of any two targets.
    field : float, rad
        Half the width of the field of view.
    reported : float
        Standard deviations that the targets report over those of the noise.

    Raises
    ------
    ValueError
        Fewer than two shared targets; on drawing, if so many do not fit at that spacing.
    """

    size: int = 20
    outlier_share: float = 0.2
    overlap: float = 1.0
    spacing: float = 2.0
    field: float = FIELD_OF_VIEW
    reported: float = 1.0

    def __post_init__(self) -> None:
        if self.shared < 2:
            raise ValueError(
                f"size {self.size}, outlier_share {self.outlier_share:g} and overlap "
                f"{self.overlap:g} leave {self.shared} shared targets, but two are needed"
            )

    @property
    def anywhere(self) -> int:
        """Number of outliers in each scan."""
        return round(self.size * self.outlier_share)

    @property
    def beyond(self) -> int:
        """Number of each scan's targets that lie outside the other's field of view."""
        return round(self.size * (1.0 - self.overlap))

    @property
    def shared(self) -> int:
        """Number of targets that both scans see."""
        return self.size - self.anywhere - self.beyond

    def sample(self, runs: int, rng: np.random.Generator) -> tuple[PointSet, PointSet]:
        """Draw layouts and noisy scans: fixed and moving sets of batch shape (runs,)."""
        lone = 2 * self.anywhere
        places = self._places(runs, self.shared + lone + 2 * self.beyond, rng)
        scattered, rest = places[:, :lone], places[:, lone:]
        order = np.argsort(np.arctan2(rest[..., 1], rest[..., 0]), axis=1)
        ordered = np.take_along_axis(rest, order[..., np.newaxis], axis=1)
        length = self.shared + self.beyond
        fixed = np.concatenate([ordered[:, :length], scattered[:, : self.anywhere]], axis=1)
        seen = np.concatenate([ordered[:, self.beyond :], scattered[:, self.anywhere :]], axis=1)
        moving = rigid.transform_means(rigid.inverse(self.theta), seen)
        return self._measured(fixed, rng), self._measured(moving, rng)

    def _places(self, runs: int, count: int, rng: np.random.Generator) -> Array:
        """Positions (runs, count, 2) in m, one after the other wherever there is room."""
        places = np.empty((runs, count, 2))
        for target in range(count):
            waiting = np.arange(runs)
            for _ in range(_MOST_TRIES):
                azimuth = rng.uniform(-self.field, self.field, len(waiting))
                drawn = cartesian(np.stack([azimuth, rng.uniform(*RANGES, len(waiting))], axis=-1))
                places[waiting, target] = drawn
                apart = np.linalg.norm(places[waiting, :target] - drawn[:, np.newaxis], axis=-1)
                waiting = waiting[apart.min(axis=1, initial=np.inf) < self.spacing]
                if not len(waiting):
                    break
            else:
                raise ValueError(
                    f"spacing must leave room for {count} targets, but is {self.spacing:g} m"
                )
        return places

    def _measured(self, positions: Array, rng: np.random.Generator) -> PointSet:
        noise = rng.standard_normal((2, *positions.shape[:-1]))
        return PointSet.from_polar(
            np.hypot(positions[..., 0], positions[..., 1]) + self.sigma_range * noise[0],
            np.arctan2(positions[..., 1], positions[..., 0]) + self.sigma_azimuth * noise[1],
            self.sigma_range * self.reported,
            self.sigma_azimuth * self.reported,
        )
