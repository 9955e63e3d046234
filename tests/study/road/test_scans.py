"""Scans of recordings: their animation, and the summary of those that cannot be shown."""

import re
import xml.etree.ElementTree as ET

import matplotlib.pyplot as plt
import numpy as np
import pytest

from d2d.radar import Mounting, RadarScan
from d2d.study.book.grammar import MOVING, OUTLIER, PINK
from d2d.study.road.scan_animation import WeighedScan, animate_scans
from d2d.study.road.scan_profile import EDGES, profile_panels, read_profile, scan_profile

AHEAD = Mounting(3.0, 0.0, 0.0)


def scan(time, distance, azimuth, doppler) -> RadarScan:
    return RadarScan(time, distance, azimuth, doppler, 0.1, 0.01, 0.1)


def view(time, distance, azimuth, probabilities, mounting=AHEAD) -> WeighedScan:
    seen = scan(time, distance, azimuth, np.zeros(len(distance)))
    return WeighedScan(seen, mounting, np.asarray(probabilities))


def dots(html: str) -> dict[str, list[tuple[float, float]]]:
    """Places of the targets by colour."""
    pattern = r'<path d="([^"]*)" stroke="(#\w+)" stroke-width="(?:8|10)'
    return {
        colour: [tuple(map(float, p)) for p in re.findall(r"M(\S+) (\S+)h0", path)]
        for path, colour in re.findall(pattern, html)
    }


def test_each_target_is_drawn_once_in_the_colour_of_its_class():
    """Breaks if a class has a gap, a target is drawn twice, or colours change places."""
    shares = [0.0, 0.1, 0.2, 0.5, 0.8, 1.0]
    html = animate_scans("x", [[view(0.0, [10.0] * 6, np.linspace(-0.5, 0.5, 6), shares)]])
    found = dots(html)
    assert [len(found[c]) for c in (OUTLIER, PINK, MOVING)] == [2, 2, 2]


def test_forward_is_up_and_left_is_left():
    """Breaks if axes are mirrored, or the mounting is left out."""
    left = view(0.0, [20.0], [0.0], [0.0], Mounting(0, 0, 1.0))
    html = animate_scans("x", [[view(0.0, [20.0], [0.0], [1.0]), left]])
    ((ahead_x, ahead_y),), ((left_x, left_y),) = dots(html)[MOVING], dots(html)[OUTLIER]
    triangle = re.search(r'd="M(\S+) (\S+)L(\S+) (\S+)L', html)
    x = float(triangle[3])
    assert ahead_x == pytest.approx(x, abs=1.0)
    assert left_x < x - 50.0
    assert ahead_y < left_y < float(triangle[2])


def test_a_scan_without_targets_is_drawn_as_well():
    """Breaks if it ends in an error, or the SVG does not parse."""
    html = animate_scans(
        "x", [[view(5.0, [10.0, 20.0], [0.1, -0.1], [1.0, 0.5])], [view(5.25, [], [], [])]]
    )
    assert "2 targets, mean inlier probability 0.75" in html.replace("\N{NO-BREAK SPACE}", " ")
    for picture in re.findall(r"<svg.*?</svg>", html, re.DOTALL):
        ET.fromstring(picture)


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
