"""Claims of thesis section 6.4: the indices of credibility."""

from d2d.credibility import credibility
from d2d.study.book.claim import Evidence, claim, judge
from d2d.study.plane.evaluation import LIKELIHOOD, NOTICEABLE, evaluated
from d2d.study.plane.measures import PESSIMISTIC
from d2d.study.plane.scenarios import OVERLAPPED


@claim(
    "nci-not-enough",
    section="6.4",
    figure="overlap-credibility",
    telling=(
        "NCI, covariance four times too large (dB)",
        "NCI, covariance four times too small (dB)",
    ),
)
def nci_not_enough() -> Evidence:
    """The NCI alone is not enough to judge an estimate."""
    found = evaluated(OVERLAPPED, LIKELIHOOD)
    wide, narrow = (credibility(found.errors, found.covariances * s) for s in (4.0, 0.25))
    alike = abs(wide.nci - narrow.nci) < NOTICEABLE
    opposite = wide.inclination < PESSIMISTIC and narrow.inclination > -PESSIMISTIC
    return Evidence(
        judge(confirmed=alike and opposite),
        "it has no sign: covariances four times too large and four times too small, of which only "
        f"the second are dangerous, have an NCI of {wide.nci:.1f} dB and {narrow.nci:.1f} dB. "
        f"Their I2 is {wide.inclination:+.1f} dB and {narrow.inclination:+.1f} dB.",
        {
            "NCI, covariance four times too large (dB)": wide.nci,
            "NCI, covariance four times too small (dB)": narrow.nci,
            "I2, covariance four times too large (dB)": wide.inclination,
            "I2, covariance four times too small (dB)": narrow.inclination,
        },
    )
