"""Charts: what the text says is what is drawn, and what it cannot mean is refused."""

import matplotlib.pyplot as plt
import pytest

from d2d.study.book.flow_charts import Arrow, flow_chart, parse

TEXT = r"""
    start: (Initial guess) |
    step: Newton // step   | again: Update $\theta$
    end: (Motion)          |

    start -> step -> end: converged
    step -> again
    again |- start
"""


@pytest.fixture(autouse=True)
def close_figures():
    yield
    plt.close("all")


def test_boxes_and_arrows_are_read():
    chart = parse(TEXT)
    assert set(chart.boxes) == {"start", "step", "again", "end"}
    assert chart.boxes["start"].terminal
    assert chart.boxes["start"].label == "Initial guess"
    assert chart.boxes["step"].label == "Newton\nstep"
    assert (chart.boxes["again"].row, chart.boxes["again"].column) == (1, 1)
    assert chart.arrows[0] == Arrow("start", "step", "->", "")
    assert chart.arrows[1] == Arrow("step", "end", "->", "converged")
    assert chart.arrows[3] == Arrow("again", "start", "|-", "")


def test_every_label_is_drawn():
    figure = flow_chart(TEXT)
    drawn = {text.get_text() for text in figure.axes[0].texts}
    assert {"Initial guess", "Newton\nstep", r"Update $\theta$", "Motion", "converged"} <= drawn
    assert len(figure.axes[0].patches) == 4


def test_labels_stay_within_their_boxes():
    figure = flow_chart(TEXT)
    figure.canvas.draw()
    (ax,) = figure.axes
    boxes = [patch.get_window_extent() for patch in ax.patches]
    for text in ax.texts:
        if text.get_text() in {"", "converged"}:
            continue
        label = text.get_window_extent()
        assert any(
            box.x0 <= label.x0 and label.x1 <= box.x1 and box.y0 <= label.y0 and label.y1 <= box.y1
            for box in boxes
        )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: A | b", "'b'"),
        ("a: A | a: B", "'a' twice"),
        ("a: A\na -> b", "no box 'b'"),
        ("a: A |\n | b: B\na -> b", "not aligned"),
    ],
)
def test_what_cannot_be_drawn_is_refused(text, message):
    with pytest.raises(ValueError, match=message):
        parse(text)
