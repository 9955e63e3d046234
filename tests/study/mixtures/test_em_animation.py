"""The animation: self-contained, one frame shown without JavaScript, no bigger than a picture."""

import numpy as np

from d2d.study.book import slider
from d2d.study.mixtures.em_animation import em_frame
from d2d.study.mixtures.gaussian import GaussianMixture, fit_mixture


def test_it_opens_on_the_first_frame():
    """Breaks if a reader sees the end before having moved the slider, or needs a server."""
    truth = GaussianMixture([0.5, 0.5], [[0.0, 0.0], [4.0, 1.0]], np.tile(np.eye(2), (2, 1, 1)))
    x, _ = truth.sample(40, np.random.default_rng(1))
    fit = fit_mixture(x, 2, np.random.default_rng(2), tolerance=1e-4)
    drawn = [
        slider.picture(em_frame(x, fit.steps, fit.log_likelihoods, step), f"step <{step}>")
        for step in range(3)
    ]
    html = slider.animate("steps", drawn, ["start", "then", "end"])
    assert html.count("data:image/png;base64") == 3
    assert html.count('" hidden>') == 2
    assert '<div data-frame="0"><img alt="step &lt;0&gt;"' in html
    assert 'max="2" value="0"' in html
    assert "http" not in html
