"""HTML that cells show, from the templates in the folder ``templates``."""

from typing import Any

import jinja2

_TEMPLATES = jinja2.Environment(
    loader=jinja2.PackageLoader("d2d.study.book"),
    autoescape=True,
    trim_blocks=True,
    lstrip_blocks=True,
    undefined=jinja2.StrictUndefined,
)


def render(template: str, **values: Any) -> str:
    """Fill a template; text among the values is escaped."""
    return _TEMPLATES.get_template(template).render(values)
