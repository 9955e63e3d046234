"""HTML that cells show, from the templates in the folder ``templates``."""

import re
from typing import Any

import jinja2
from markupsafe import Markup, escape

_TEMPLATES = jinja2.Environment(
    loader=jinja2.PackageLoader("d2d.study.book"),
    autoescape=True,
    trim_blocks=True,
    lstrip_blocks=True,
    undefined=jinja2.StrictUndefined,
)


# Of a plain text: its pattern, and how a formula or a sentence writes it.
_TYPESET = (
    (r"(?<![\w.)])-(?=[\d.])", "−"),
    (r"(?<=\d)%", "\u202f%"),
    (r"(?<=\d)e(?:\+|(-))0*(\d+)\b", r" · 10<sup>\1\2</sup>"),
    (r"(?<=<sup>)-", "−"),
    (r"\b([tv])_([xy])\b", r"<i>\1<sub>\2</sub></i>"),
    ("φ", "<i>φ</i>"),
    (r"\bomega\b", "<i>ω</i>"),
    (r"&#34;(.+?)&#34;", r"“\1”"),
    (r"(?<=\w)&#39;(?=s\b)", "’"),
)


def typeset(text: str) -> Markup:
    """Return a cell as HTML: symbols as in formulas, a true minus, powers of ten."""
    html = str(escape(text))
    for pattern, written in _TYPESET:
        html = re.sub(pattern, written, html)
    return Markup(html)


_TEMPLATES.filters["typeset"] = typeset


def render(template: str, **values: Any) -> str:
    """Fill a template; text among the values is escaped."""
    return _TEMPLATES.get_template(template).render(values)
