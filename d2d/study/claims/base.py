"""A claim of the thesis, and the evidence that judges it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

Verdict = Literal["confirmed", "qualified", "refuted"]


@dataclass(frozen=True)
class Evidence:
    """What a check measured.

    Attributes
    ----------
    verdict : "confirmed", "qualified" or "refuted"
        Decided by the check from the numbers.
    because : str
        One sentence why.
    numbers : dict of str to float
        What was measured, by name with its unit.
    """

    verdict: Verdict
    because: str
    numbers: dict[str, float]

    def __str__(self) -> str:
        """The verdict and the numbers, three significant digits each."""
        rows = [f"  {name}: {value:.3g}" for name, value in self.numbers.items()]
        return "\n".join([f"{self.verdict}: {self.because}", *rows])


@dataclass(frozen=True)
class Claim:
    """One row of the ledger.

    Attributes
    ----------
    id : str
    section : str
        Of the thesis.
    claim : str
        In our words.
    check : callable
        Measures and judges; seeded, and able to come out otherwise.
    verdict : str
        On record: what ``check`` found when the chapter was written. The tests compare.
    figure : str
        Label of the figure of the book that shows it, without ``fig-``.
    telling : tuple of str
        Names of the numbers of the evidence that tell the most, one or two.
    holds : str
        When the claim does hold, unless it is confirmed as it stands.
    """

    id: str
    section: str
    claim: str
    check: Callable[[], Evidence]
    verdict: Verdict
    figure: str = ""
    telling: tuple[str, ...] = ()
    holds: str = ""


def show(*claims: Claim) -> None:
    """Print the claims with a fresh check of each, as the chapters' last cells do."""
    for claim in claims:
        print(f"[{claim.id}] {claim.claim} (thesis {claim.section})")
        print(claim.check())
        print()
