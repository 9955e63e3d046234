"""The picture of the conventions."""

import matplotlib.pyplot as plt

from d2d.radar import Mounting
from d2d.study.guides.conventions import draw_conventions


def test_the_picture_has_the_conventions():
    """Breaks if a name is missing from the picture, or drawn for another mounting."""
    _, ax = plt.subplots()
    draw_conventions(ax, Mounting(3.4, 0.8, 0.7))
    words = " ".join(text.get_text() for text in ax.texts)
    for word in ("x, forward", "y, left", "boresight", "azimuth > 0", "doppler > 0", "x = 3.4 m"):
        assert word in words
