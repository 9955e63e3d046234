"""The logs of the readers' project."""

import pytest

from d2d.radar import compare, track
from d2d.study.guides.project import hidden_log


@pytest.mark.parametrize("name", ["first", "second", "third"])
def test_a_hidden_fault_shows(name: str) -> None:
    """Breaks if a log has no fault that a reader could find."""
    log = hidden_log(name, 20.0)
    assert compare(track(log), log.truth).measures.anees > 2.0


def test_another_log_is_refused() -> None:
    with pytest.raises(ValueError, match=r"^name must be one of first, second, third"):
        hidden_log("fourth")
