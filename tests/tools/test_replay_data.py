"""The drive that the first page replays is the one that is stored."""

import re

import numpy as np

from tools.replay_data import SCRIPT, drive, script


def numbers(text):
    return [float(each) for each in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", text)]


def test_the_stored_script_is_current():
    """Breaks if estimates, budget or tool changed: run `python tools/replay_data.py`."""
    stored, fresh = SCRIPT.read_text(encoding="utf-8"), script(drive())
    assert re.sub(r"[-\d.e]+", "", stored) == re.sub(r"[-\d.e]+", "", fresh)
    np.testing.assert_allclose(numbers(stored), numbers(fresh), rtol=2e-3, atol=1e-7)
