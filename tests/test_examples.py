"""The examples of the docstrings print what they say."""

import doctest
import importlib
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "d2d"
WITH_EXAMPLES = sorted(
    ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)
    for path in PACKAGE.rglob("*.py")
    if ">>>" in path.read_text(encoding="utf-8")
)


@pytest.mark.parametrize("module", WITH_EXAMPLES)
def test_examples_print_what_they_say(module):
    """Breaks if a number of a docstring is out of date, or an example is not found."""
    found = doctest.DocTestFinder().find(importlib.import_module(module), module)
    assert any(test.examples for test in found)
    for test in found:
        said: list[str] = []
        failed, _ = doctest.DocTestRunner(verbose=False).run(test, out=said.append)
        assert not failed, "".join(said)


def test_there_are_examples():
    """Breaks if the search above finds nothing, and so nothing is run."""
    assert len(WITH_EXAMPLES) > 10
