"""The animation of scans that appendix F shows."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from d2d.radar import Mounting, RadarScan
from d2d.study.book.grammar import MOVING, OUTLIER, PINK
from d2d.study.road.scan_animation import WeighedScan, animate_scans

AHEAD = Mounting(3.0, 0.0, 0.0)


def view(time, distance, azimuth, probabilities, mounting=AHEAD) -> WeighedScan:
    scan = RadarScan(time, distance, azimuth, np.zeros(len(distance)), 0.1, 0.01, 0.1)
    return WeighedScan(scan, mounting, np.asarray(probabilities))


def dots(html: str) -> dict[str, list[tuple[float, float]]]:
    """Places of the targets by colour."""
    found = {}
    for path, colour in re.findall(
        r'<path d="([^"]*)" stroke="(#\w+)" stroke-width="(?:8|10)', html
    ):
        found[colour] = [tuple(map(float, p)) for p in re.findall(r"M(\S+) (\S+)h0", path)]
    return found


def test_each_target_is_drawn_once_in_the_colour_of_its_class():
    """Breaks if a class has a gap, a target is drawn twice, or colours change places."""
    shares = [0.0, 0.1, 0.2, 0.5, 0.8, 1.0]
    html = animate_scans("x", [[view(0.0, [10.0] * 6, np.linspace(-0.5, 0.5, 6), shares)]])
    found = dots(html)
    assert [len(found[c]) for c in (OUTLIER, PINK, MOVING)] == [2, 2, 2]


def test_forward_is_up_and_left_is_left():
    """Breaks if axes are mirrored, or the mounting is left out."""
    html = animate_scans(
        "x",
        [[view(0.0, [20.0], [0.0], [1.0]), view(0.0, [20.0], [0.0], [0.0], Mounting(0, 0, 1.0))]],
    )
    ((ahead_x, ahead_y),), ((left_x, left_y),) = dots(html)[MOVING], dots(html)[OUTLIER]
    triangle = re.search(r'd="M(\S+) (\S+)L(\S+) (\S+)L', html)
    x = float(triangle[3])
    assert ahead_x == pytest.approx(x, abs=1.0)
    assert left_x < x - 50.0
    assert ahead_y < left_y < float(triangle[2])


def test_a_round_s_caption_counts_and_its_picture_is_well_formed():
    """Breaks if a scan without targets ends in an error, or the SVG does not parse."""
    rounds = [
        [view(5.0, [10.0, 20.0], [0.1, -0.1], [1.0, 0.5])],
        [view(5.25, [], [], [])],
    ]
    html = animate_scans("x", rounds).replace("\N{NO-BREAK SPACE}", " ")
    assert "0.00 s: 2 targets, mean inlier probability 0.75" in html
    assert "0.25 s: 0 targets, mean inlier probability 0.00" in html
    for picture in re.findall(r"<svg.*?</svg>", html, re.DOTALL):
        ET.fromstring(picture)
