"""A claim of the thesis, and the evidence that judges it."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from types import ModuleType
from typing import Literal

import numpy as np

Verdict = Literal["confirmed", "qualified", "refuted"]


def judge(*, confirmed: bool | np.bool_, qualified: bool | np.bool_ = False) -> Verdict:
    """The verdict of the first condition that is met, or "refuted" if neither is."""
    if confirmed:
        return "confirmed"
    return "qualified" if qualified else "refuted"


@dataclass(frozen=True)
class Evidence:
    """What a check measured, and what follows from it.

    Attributes
    ----------
    verdict : "confirmed", "qualified" or "refuted"
        Decided by the check from the numbers, see `judge`.
    because : str
        One sentence that gives the reason, composed from the numbers.
    numbers : dict of str to float
        What was measured, by name with its unit.
    holds : str
        The condition under which the claim holds, composed from the numbers; not used if the claim
        is confirmed as it stands.
    """

    verdict: Verdict
    because: str
    numbers: dict[str, float]
    holds: str = ""

    def __str__(self) -> str:
        """The verdict and the numbers, three significant digits each."""
        numbers = [f"  {name}: {value:.3g}" for name, value in self.numbers.items()]
        return "\n".join([f"{self.verdict}: {self.because}", *numbers])


@dataclass(frozen=True)
class Claim:
    """One row of the ledger; its verdict is that of its evidence.

    Attributes
    ----------
    id : str
    section : str
        Section of the thesis.
    text : str
        The claim in our words.
    figure : str
        Label of the figure of the book that shows it, without ``fig-``.
    telling : tuple of str
        Names of the one or two most telling numbers of the evidence.
    check : callable
        Measures and judges, with a fixed seed; other measurements would give another verdict.
    """

    id: str
    section: str
    text: str
    figure: str
    telling: tuple[str, ...]
    check: Callable[[], Evidence]


def claim(
    id: str, *, section: str, figure: str, telling: tuple[str, ...]
) -> Callable[[Callable[[], Evidence]], Claim]:
    """Turn the decorated check into a claim, with the check's docstring as its text."""

    def decorate(check: Callable[[], Evidence]) -> Claim:
        text = " ".join((check.__doc__ or "").split())
        return Claim(id, section, text, figure, telling, check)

    return decorate


def claims_of(modules: Iterable[ModuleType]) -> dict[str, Claim]:
    """The claims that the modules define, by id, in the order of their definition.

    Raises ``ValueError`` if two claims share an id.
    """
    claims: dict[str, Claim] = {}
    for module in modules:
        for value in vars(module).values():
            if isinstance(value, Claim) and claims.setdefault(value.id, value) is not value:
                raise ValueError(f"two claims have the id {value.id!r}")
    return claims
