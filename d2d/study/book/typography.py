"""Signs and spaces of print for text that is computed or typed on a keyboard.

Numbers of tables and cards stand in the text twin as Python formats them; readers of the HTML see
"1.6 × 10⁵", "−8" and "v" with its index.
"""

import re
from collections.abc import Callable
from html import escape

NO_BREAK = "\N{NO-BREAK SPACE}"

UNIT = (
    r"%|°/[sm]|m²?/s²?|m²|mm/m|mm|cm|km|m|ms|µs|s|dB|rad(?:/s)?|"
    r"σ|[kMG]?Hz|[kM]B|minutes?|hours?"
)
_Rule = tuple[re.Pattern[str], str | Callable[[re.Match[str]], str]]

_TOGETHER: tuple[_Rule, ...] = (
    (re.compile(rf"(?<=\d) (?=(?:{UNIT})(?![\w²³]))"), NO_BREAK),  # a number and its unit
    (re.compile(r"(?<=\d) (?=\d{3}(?!\d))"), NO_BREAK),  # groups of three digits
    (re.compile(r"(?<=\d) ± (?=\d)"), f"{NO_BREAK}±{NO_BREAK}"),
    (re.compile(r"(?<=^Fig\.) (?=\d)|(?<=^Table) (?=\d)"), NO_BREAK),
    (re.compile(r"^(\d+[a-z]?) · "), rf"\1{NO_BREAK}· "),  # the number of a chapter
)


def _exponent(match: re.Match[str]) -> str:
    mantissa, sign, power = match[1], match[2].replace("+", "").replace("-", "−"), match[3]
    factor = "" if mantissa == "1" else f"{mantissa}{NO_BREAK}×{NO_BREAK}"
    return f"{factor}10<sup>{sign}{power}</sup>"


_PRINTED: tuple[_Rule, ...] = (
    (re.compile(r"(?<![\w.])(\d+(?:\.\d+)?)e([+-]?)0*(\d+)(?![\w.]*\w)"), _exponent),
    (
        re.compile(r"\b10\^(-?)(\d+)"),
        lambda match: f"10<sup>{'−' if match[1] else ''}{match[2]}</sup>",
    ),
    (re.compile(r"(?<![\w.)/])-(?=\.?\d|log\b|sum_)"), "−"),
    (re.compile(r"(?<![\w.])[−+](?=0(?:\.0+)?(?![.\d]))"), ""),  # no sign of a zero
    (
        re.compile(r"(?<![\w.,-])\d{5,}(?![.\w])"),
        lambda match: f"{int(match[0]):,}".replace(",", NO_BREAK),
    ),
    (re.compile(r"\b([A-Za-zθσφ])_([A-Za-z])\b"), r"<i>\1</i><sub>\2</sub>"),
    (re.compile(r"\bsum_([A-Za-z])\b"), r"Σ<sub>\1</sub>"),
    (re.compile(r"\bsqrt\((\d+)\)"), r"√\1"),
    (re.compile(r"(?<=\d )sigma\b"), "σ"),  # standard deviations as a unit
    (re.compile(r"(?<=\d) deg\b(?!/)"), "°"),
    (re.compile(r"\bdeg\b"), "°"),
    (re.compile(r"\bomega\b"), "ω"),
    (re.compile(r"\bI2\b"), "I²"),
    (re.compile(r"(?<=\d )x(?= )|(?<= )x(?= \d)"), "×"),
    # Intervals, "1.28 to 1.42" or "[0.29, 0.39]", which only a phone divides; names, "sensor 3"
    (
        re.compile(r"[−+]?\d[\d.]*[%°]? to [−+]?\d[\d.]*[%°]?|\[[−+]?\d[\d.]*, [−+]?\d[\d.]*\]"),
        r'<span class="whole">\g<0></span>',
    ),
    (re.compile(r"(?<=[a-z]) (?=\d(?:,|$))"), NO_BREAK),
    (re.compile(r"(?<=\d)%"), f"{NO_BREAK}%"),  # as in the text
)


def _apply(rules: tuple[_Rule, ...], text: str) -> str:
    for pattern, better in rules:
        text = pattern.sub(better, text)
    return text


def unbroken(text: str) -> str:
    """Text in which no line ends between a number and its unit, or within a number."""
    return _apply(_TOGETHER, text)


def typeset(text: str) -> str:
    """Text as HTML, printed as a person would write it; what is between backticks is code."""
    parts = escape(text, quote=False).split("`")
    if len(parts) % 2 == 0:  # a lone backtick
        parts = ["`".join(parts)]
    return "".join(
        f"<code>{part}</code>" if i % 2 else unbroken(_apply(_PRINTED, part))
        for i, part in enumerate(parts)
    )
