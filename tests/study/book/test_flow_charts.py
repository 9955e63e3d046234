"""Charts: what the text says is what is drawn."""

import pytest
from matplotlib.colors import to_hex
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

from d2d.study.book.flow_charts import BLUE, MARKED, WHITE, flow_chart

TEXT = r"""
    start: (Initial guess) |
    step: *Newton // step* | again: Update $\theta$
    end: (Motion)          |

    start -> step -> end: converged
    step -> again
    again |- start
"""


@pytest.fixture
def chart():
    figure = flow_chart(TEXT)
    figure.canvas.draw()
    (ax,) = figure.axes
    return ax


def test_every_box_is_drawn_as_what_it_is_with_its_label_inside(chart):
    """Breaks if a label is lost, overflows, or a mark of the text shows in the chart."""
    boxes = [patch for patch in chart.patches if isinstance(patch, FancyBboxPatch)]
    labels = [text for text in chart.texts if text.get_text() != "converged"]
    expected = {"Initial guess": BLUE, "Newton\nstep": MARKED, r"Update $\theta$": WHITE}
    assert [text.get_text() for text in labels] == [*expected, "Motion"]
    for box, label, color in zip(boxes, labels, [*expected.values(), BLUE], strict=True):
        assert to_hex(box.get_facecolor()) == color.lower()
        inside, text = box.get_window_extent(), label.get_window_extent()
        assert inside.x0 <= text.x0 < text.x1 <= inside.x1
        assert inside.y0 <= text.y0 < text.y1 <= inside.y1


def test_arrows_go_from_border_to_border(chart):
    """Breaks if an arrow joins other boxes, bends at the wrong corner, or loses its label."""
    start, step, again, end = (
        patch.get_window_extent() for patch in chart.patches if isinstance(patch, FancyBboxPatch)
    )
    arrows = [patch for patch in chart.patches if isinstance(patch, FancyArrowPatch)]
    paths = [
        chart.transData.transform(arrow.get_path().vertices)
        for arrow in arrows
        if arrow.get_linewidth() < 2.0  # the others are the white edges
    ]
    down, on, across, back = paths
    middle = 0.5 * (start.x0 + start.x1)
    for path, above, below in ((down, start, step), (on, step, end)):
        assert path[0] == pytest.approx((middle, above.y0), abs=4.0)
        assert (abs(path[:, 1] - below.y1) < 4.0).any()
    assert across[0] == pytest.approx((step.x1, 0.5 * (step.y0 + step.y1)), abs=4.0)
    corner = 0.5 * (again.x0 + again.x1), 0.5 * (start.y0 + start.y1)
    assert (abs(back - corner).max(axis=1) < 4.0).any()
    assert (abs(back[:, 0] - start.x1) < 4.0).any()
    label = next(text for text in chart.texts if text.get_text() == "converged")
    assert step.y0 > label.get_window_extent().y1 > label.get_window_extent().y0 > end.y1
