"""Animations that need no server: all frames in one piece of HTML, with a slider.

The frames are SVG written here with rounded coordinates rather than pictures of matplotlib: the
same on every machine, so that a comparison of notebook outputs compares the animation too.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from d2d import gaussian
from d2d._checks import Array, finite
from d2d.gaussian import GaussianMixture
from d2d.study.drawing import BLUE, GREEN, ORANGE, PINK

COLOURS = (BLUE, ORANGE, GREEN, PINK)
WIDTH, HEIGHT, STRIP, MARGIN = 600.0, 390.0, 130.0, 46.0  # of the drawing, in SVG units

_SCRIPT = """
(function () {{
  var root = document.getElementById("{name}"), frames = root.querySelectorAll("[data-frame]");
  var bar = root.querySelector("input"), play = root.querySelector("button"), timer = null;
  function show() {{
    frames.forEach(function (frame, i) {{ frame.hidden = i !== Number(bar.value); }});
  }}
  function stop() {{ clearInterval(timer); timer = null; play.textContent = "Play"; }}
  function step() {{
    if (Number(bar.value) >= frames.length - 1) {{ stop(); return; }}
    bar.value = Number(bar.value) + 1; show();
  }}
  bar.addEventListener("input", function () {{ stop(); show(); }});
  play.addEventListener("click", function () {{
    if (timer) {{ stop(); return; }}
    if (Number(bar.value) >= frames.length - 1) {{ bar.value = 0; show(); }}
    play.textContent = "Pause"; timer = setInterval(step, 500);
  }});
  root.querySelector("[data-controls]").hidden = false;
}})();
"""


def slider(name: str, frames: Sequence[str], captions: Sequence[str]) -> str:
    """HTML that shows one of the frames, chosen by a slider or played.

    Parameters
    ----------
    name : str
        Id of the element, unique on its page.
    frames, captions : sequences of str
        HTML of each frame, and a line of text under it.

    Without JavaScript the last frame is shown.

    Raises
    ------
    ValueError
        If there is no frame, or not one caption for each.
    """
    if not frames or len(frames) != len(captions):
        raise ValueError(
            f"frames must come with a caption each, but there are {len(frames)} frames and "
            f"{len(captions)} captions"
        )
    last = len(frames) - 1
    shown = "\n".join(
        f'<div data-frame="{i}"{"" if i == last else " hidden"}>{frame}'
        f'<div style="text-align:center;min-height:3em">{caption}</div></div>'
        for i, (frame, caption) in enumerate(zip(frames, captions, strict=True))
    )
    return f"""<div id="{name}" style="background:#fff;color:#111;max-width:640px;margin:auto">
{shown}
<div data-controls hidden>
<div style="display:flex;gap:0.6em;align-items:center;padding:0.3em 0.6em">
<button type="button" style="min-width:4.5em">Play</button>
<input type="range" min="0" max="{last}" value="{last}" step="1" style="flex:1"
 aria-label="Step of the animation">
</div></div>
<noscript>The slider needs JavaScript: this is the last step.</noscript>
<script>{_SCRIPT.format(name=name)}</script>
</div>"""


def em_frame(
    x: ArrayLike, steps: Sequence[GaussianMixture], log_likelihoods: Sequence[float], step: int
) -> str:
    """SVG of one step of EM in the plane: above the data and components, below the likelihood.

    Parameters
    ----------
    x : (N, 2) array, m
        Coloured by the responsibilities of ``steps[step]``.
    steps : sequence of GaussianMixture
        Of at most four components; each is drawn with its ellipses of one and two standard
        deviations.
    log_likelihoods : sequence of float
        Of every step, per observation.
    step : int
    """
    points = finite("x", x)
    mixture = steps[step]
    low, high = points.min(axis=0), points.max(axis=0)
    low, high = low - 0.08 * (high - low), high + 0.08 * (high - low)
    scale = float(min((WIDTH - 2 * MARGIN) / (high - low)[0], (HEIGHT - MARGIN) / (high - low)[1]))
    origin = np.array([0.5 * WIDTH, 0.5 * (HEIGHT - MARGIN)]) - 0.5 * scale * (low + high) * [1, -1]

    def place(where: Array) -> Array:
        return np.asarray(origin + scale * where * np.array([1.0, -1.0]))

    marks = [
        f'<circle cx="{px:.1f}" cy="{py:.1f}" r="3" fill="{colour}"/>'
        for (px, py), colour in zip(
            place(points), _blend(mixture.responsibilities(points)), strict=True
        )
    ]
    for k in range(mixture.components):
        marks += _component(mixture, k, place(mixture.means[k]), scale)
    marks += _scale_bar(scale)
    marks += _likelihood_strip(np.asarray(log_likelihoods), step)
    return (
        f'<svg viewBox="0 0 {WIDTH:.0f} {HEIGHT + STRIP:.0f}" width="100%" role="img" '
        f'aria-label="Step {step} of EM: data, components and log-likelihood" '
        f'font-family="sans-serif" font-size="17">{"".join(marks)}</svg>'
    )


def _blend(shares: Array) -> list[str]:
    """One colour for each row of shares (N, K) of the components' colours."""
    rgb = np.array([[int(c[i : i + 2], 16) for i in (1, 3, 5)] for c in COLOURS])
    mixed = np.round(shares @ rgb[: shares.shape[1]]).astype(int)
    return ["#{:02x}{:02x}{:02x}".format(*row) for row in mixed]


def _component(mixture: GaussianMixture, k: int, centre: Array, scale: float) -> list[str]:
    # 39.3 % of the probability lie within one standard deviation
    one = gaussian.confidence_ellipse(
        mixture.means[k], mixture.covariances[k], 1.0 - float(np.exp(-0.5))
    )
    x, y = centre
    turn = -np.rad2deg(one.angle)
    style = f'fill="none" stroke="{COLOURS[k]}" stroke-width="2.5"'
    ellipses = [
        f'<ellipse rx="{n * scale * one.semi_axes[0]:.1f}" ry="{n * scale * one.semi_axes[1]:.1f}" '
        f'transform="translate({x:.1f} {y:.1f}) rotate({turn:.1f})" {style}/>'
        for n in (1, 2)
    ]
    label = (
        f'<text x="{x:.1f}" y="{y + 6:.1f}" text-anchor="middle" font-weight="bold" stroke="#fff" '
        f'stroke-width="4" paint-order="stroke">{mixture.weights[k]:.2f}</text>'
    )
    return [*ellipses, label]


def _scale_bar(scale: float) -> list[str]:
    y = HEIGHT - 30.0
    return [
        f'<path d="M {MARGIN:.1f} {y:.1f} h {scale:.1f}" stroke="#111" stroke-width="3"/>',
        f'<text x="{MARGIN:.1f}" y="{y - 8:.1f}">1 m</text>',
    ]


def _likelihood_strip(values: Array, step: int) -> list[str]:
    top, bottom = HEIGHT + 14.0, HEIGHT + STRIP - 26.0
    span = float(np.ptp(values)) or 1.0
    xs = np.linspace(MARGIN, WIDTH - MARGIN, len(values)) if len(values) > 1 else [0.5 * WIDTH]
    ys = bottom - (values - values.min()) / span * (bottom - top)
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in zip(xs, ys, strict=True))
    return [
        f'<path d="M {MARGIN:.0f} {bottom + 8:.0f} H {WIDTH - MARGIN:.0f}" stroke="#999"/>',
        f'<polyline points="{line}" fill="none" stroke="#111" stroke-width="2"/>',
        f'<circle cx="{xs[step]:.1f}" cy="{ys[step]:.1f}" r="6" fill="{ORANGE}"/>',
        f'<text x="{0.5 * WIDTH:.0f}" y="{HEIGHT + STRIP - 2:.0f}" text-anchor="middle">'
        "log-likelihood over the steps</text>",
    ]
