"""Scans of recordings: their animation, and the summary of those that cannot be shown."""

import matplotlib.pyplot as plt
import numpy as np

from d2d.radar import Mounting, RadarScan
from d2d.study.book.grammar import MOVING, OUTLIER, PINK
from d2d.study.road.scan_animation import WeighedScan, animate_scans, draw_epoch
from d2d.study.road.scan_profile import EDGES, profile_panels, read_profile, scan_profile

AHEAD = Mounting(3.0, 0.0, 0.0)


def scan(time, distance, azimuth, doppler) -> RadarScan:
    return RadarScan(time, distance, azimuth, doppler, 0.1, 0.01, 0.1)


def view(time, distance, azimuth, probabilities, mounting=AHEAD) -> WeighedScan:
    seen = scan(time, distance, azimuth, np.zeros(len(distance)))
    return WeighedScan(seen, mounting, np.asarray(probabilities))


def dots(*views: WeighedScan) -> dict[str, np.ndarray]:
    """Places (K, 2) of the targets in the picture, by colour."""
    lines = draw_epoch(views).axes[0].lines[:3]
    return {line.get_color(): line.get_xydata() for line in lines}


def test_each_target_is_drawn_once_in_the_colour_of_its_class():
    """Breaks if a class has a gap, a target is drawn twice, or colours change places."""
    shares = [0.0, 0.1, 0.2, 0.5, 0.8, 1.0]
    found = dots(view(0.0, [10.0] * 6, np.linspace(-0.5, 0.5, 6), shares))
    assert [len(found[c]) for c in (OUTLIER, PINK, MOVING)] == [2, 2, 2]


def test_forward_is_up_and_left_is_left():
    """Breaks if axes are mirrored, or the mounting is left out."""
    left = view(0.0, [20.0], [0.0], [0.0], Mounting(0, 0, 1.0))
    found = dots(view(0.0, [20.0], [0.0], [1.0]), left)
    np.testing.assert_allclose(found[MOVING], [[0.0, 23.0]], atol=1e-9)
    np.testing.assert_allclose(found[OUTLIER], [[-20.0 * np.sin(1.0), 20.0 * np.cos(1.0)]])


def test_a_scan_without_targets_is_drawn_as_well():
    """Breaks if it ends in an error."""
    html = animate_scans(
        "x", [[view(5.0, [10.0, 20.0], [0.1, -0.1], [1.0, 0.5])], [view(5.25, [], [], [])]]
    )
    assert "0.00 s: 2 targets, mean inlier probability 0.75" in html
    assert "0.25 s: 0 targets, mean inlier probability 0.00" in html


def test_a_profile_counts_each_target_in_its_bin():
    """Breaks if scans are weighted wrongly, or azimuths are counted in radians."""
    scans = [
        scan(0.0, [5.0, 15.0, 15.0], np.deg2rad([-40.0, 20.0, 20.0]), [-12.0, -12.0, 3.0]),
        scan(0.1, [5.0], np.deg2rad([20.0]), [3.0]),
    ]
    profile = scan_profile(scans)
    assert (profile["scans"], profile["targets"]) == (2, 2.0)
    assert profile["range (m)"][:3] == [1.0, 1.0, 0.0]
    of_azimuth = dict(zip(EDGES["azimuth (°)"], profile["azimuth (°)"], strict=False))
    assert (of_azimuth[-45.0], of_azimuth[15.0]) == (0.5, 1.5)
    assert sum(profile["Doppler velocity (m/s)"]) == 2.0


def test_the_stored_profile_fits_the_bins_and_is_drawn():
    stored = read_profile()
    assert all(len(stored[name]) == len(edges) - 1 for name, edges in EDGES.items())
    _, axes = plt.subplots(3, 1)
    profile_panels(axes, {"stored": stored})
    assert [ax.get_xlabel() for ax in axes] == list(EDGES)
