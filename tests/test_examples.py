"""The examples of the docstrings print what they say."""

from __future__ import annotations

import doctest
import importlib
import pkgutil

import pytest

import d2d

MODULES = sorted({"d2d"} | {module.name for module in pkgutil.walk_packages(d2d.__path__, "d2d.")})
WITH_EXAMPLES = {
    "d2d.bootstrap",
    "d2d.cost",
    "d2d.credibility",
    "d2d.radar.scans.budget",
    "d2d.radar.trust.calibration",
    "d2d.radar.trust.comparison",
    "d2d.radar.readers.csv_log",
    "d2d.radar.trust.halves",
    "d2d.radar.trust.extent",
    "d2d.radar.simulation.sensor_errors",
    "d2d.radar.tracks.track",
    "d2d.radar.tracks.tracking",
    "d2d.registration",
    "d2d.scores",
}


def examples(module: str) -> list[doctest.DocTest]:
    found = doctest.DocTestFinder().find(importlib.import_module(module), module)
    return [test for test in found if test.examples]


@pytest.mark.parametrize("module", MODULES)
def test_examples_print_what_they_say(module):
    """Breaks if a number of a docstring is out of date, or no example is found any more.

    Rounded numbers only: the examples are compared on every machine.
    """
    tests = examples(module)
    assert tests or module not in WITH_EXAMPLES
    for test in tests:
        said: list[str] = []
        failed, _ = doctest.DocTestRunner(verbose=False).run(test, out=said.append)
        assert not failed, "".join(said)
