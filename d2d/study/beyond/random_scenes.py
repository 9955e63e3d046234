"""Scenes whose targets are placed anew in every run."""

from dataclasses import dataclass

import numpy as np

from d2d import rigid
from d2d._types import Array
from d2d.point_set import PointSet
from d2d.study.plane.scenarios import FIELD_OF_VIEW, OVERLAPPED, RANGES, cartesian, noisy_polar

_MAX_TRIES = 2000  # for one target, before its scene counts as too crowded


@dataclass(frozen=True, eq=False)
class RandomScenes:
    """Targets at random places in the field of view, drawn anew for every run."""

    sigma_range: float = OVERLAPPED.sigma_range  # m
    sigma_azimuth: float = OVERLAPPED.sigma_azimuth  # rad
    size: int = 20  # number of targets in each scan
    # share of each scan's targets that only this scan sees, anywhere in the field of view
    outlier_share: float = 0.2
    # one minus the share of each scan's targets that lie beyond one side of the other's field of
    # view: to the right in the fixed scan, to the left in the moving one
    overlap: float = 1.0
    spacing: float = 2.0  # m, minimum distance between any two targets
    view: float = FIELD_OF_VIEW  # rad, half the width of the field of view
    reported: float = 1.0  # standard deviations that the targets report, over those of the noise

    @property
    def theta(self) -> Array:
        """Motion [t_x, t_y, phi_z] in m, m, rad, from the moving onto the fixed set."""
        return OVERLAPPED.theta

    @property
    def outliers(self) -> int:
        """Number of outliers in each scan."""
        return round(self.size * self.outlier_share)

    @property
    def beyond(self) -> int:
        """Number of each scan's targets that lie outside the other's field of view."""
        return round(self.size * (1.0 - self.overlap))

    @property
    def shared(self) -> int:
        """Number of targets that both scans see."""
        return self.size - self.outliers - self.beyond

    def sample(self, runs: int, rng: np.random.Generator) -> tuple[PointSet, PointSet]:
        """Draw layouts and noisy scans: fixed and moving sets of batch shape (runs,)."""
        scattered_count = 2 * self.outliers
        places = self._places(runs, self.shared + scattered_count + 2 * self.beyond, rng)
        scattered, rest = places[:, :scattered_count], places[:, scattered_count:]
        order = np.argsort(np.arctan2(rest[..., 1], rest[..., 0]), axis=1)
        ordered = np.take_along_axis(rest, order[..., np.newaxis], axis=1)
        length = self.shared + self.beyond
        fixed = np.concatenate([ordered[:, :length], scattered[:, : self.outliers]], axis=1)
        second = np.concatenate([ordered[:, self.beyond :], scattered[:, self.outliers :]], axis=1)
        moving = rigid.transform_means(rigid.inverse(self.theta), second)
        return self._measured(fixed, rng), self._measured(moving, rng)

    def _places(self, runs: int, count: int, rng: np.random.Generator) -> Array:
        """Positions (runs, count, 2) in m, drawn one after the other where there is still room."""
        places = np.empty((runs, count, 2))
        for target in range(count):
            waiting = np.arange(runs)
            for _ in range(_MAX_TRIES):
                azimuth = rng.uniform(-self.view, self.view, len(waiting))
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
        measured = noisy_polar(rng, positions, self.sigma_range, self.sigma_azimuth)
        return PointSet.from_polar(
            *measured, self.sigma_range * self.reported, self.sigma_azimuth * self.reported
        )
