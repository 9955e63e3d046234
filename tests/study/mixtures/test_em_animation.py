"""The animation's HTML: well formed, self-contained, one frame shown without JavaScript."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from d2d.study.book import slider
from d2d.study.mixtures import em_animation
from d2d.study.mixtures.gaussian import GaussianMixture, fit_mixture


@pytest.fixture(scope="module")
def run():
    truth = GaussianMixture([0.5, 0.5], [[0.0, 0.0], [4.0, 1.0]], np.tile(np.eye(2), (2, 1, 1)))
    x, _ = truth.sample(40, np.random.default_rng(1))
    return x, fit_mixture(x, 2, np.random.default_rng(2), tolerance=1e-4)


def frames(run):
    x, fit = run
    return [
        em_animation.em_frame(x, fit.steps, fit.log_likelihoods, i) for i in range(len(fit.steps))
    ]


def test_a_frame_is_well_formed_and_holds_every_point(run):
    for frame in frames(run):
        svg = ElementTree.fromstring(frame)
        assert len(svg.findall("circle")) == len(run[0]) + 1  # and the mark on the curve
        assert len(svg.findall("ellipse")) == 4


def test_everything_lies_within_the_frame(run):
    _, _, width, height = map(float, ElementTree.fromstring(frames(run)[0]).get("viewBox").split())
    for frame in frames(run):
        for circle in ElementTree.fromstring(frame).findall("circle"):
            assert 0 <= float(circle.get("cx")) <= width
            assert 0 <= float(circle.get("cy")) <= height


def test_it_opens_on_the_first_frame(run):
    """Breaks if a reader sees the end before having moved the slider."""
    drawn = frames(run)
    html = slider.animate("steps", drawn, [f"step {i}" for i in range(len(drawn))])
    assert html.count("<svg") == len(drawn)
    assert html.count('" hidden>') == len(drawn) - 1
    assert '<div data-frame="0"><svg' in html
    assert 'value="0"' in html
    assert "<div data-controls hidden>" in html
    assert "http" not in html
