"""A Sphinx extension that typesets formulas as MathML, which needs no script, at build time."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from math_core import LatexError, LatexToMathML
from sphinx.util import logging
from sphinx.util.math import get_node_equation_number

CONVERTER = LatexToMathML(fancy_error=False)
CLASSES = "math notranslate nohighlight"
LOGGER = logging.getLogger(__name__)
DESCENDER = re.compile("(?<=<msub>|ubsup>)<mi>[fgjpqyβγζημξρϱφϕχψ]</mi>")
TALL = re.compile("(?<=<msup>|ubsup>)(?:<m[io][^>]*>[A-ZΓΔΘΛΣΦΩbdfhklt)‖|]</m.>|<mover.*?</mover>)")
HELD = re.compile(r'[(“‘]*<span class="math .*?</span>[.,;:!?)’”–]*')


def typeset(node: nodes.Element, display: bool) -> str:
    """The MathML of a formula; one that cannot be read stays TeX, with a warning."""
    tex: str = node.astext().strip()
    try:
        formula = CONVERTER.convert_with_local_state(tex, displaystyle=display)
    except LatexError as error:
        LOGGER.warning("formula %s: %s", tex, error, location=node)
        return tex
    formula = formula.replace('−</mo><mspace width="0.1667em"/>', "−</mo>")  # a sign, no operation
    formula = DESCENDER.sub(r'<mpadded depth="0">\g<0></mpadded>', formula)
    return TALL.sub(r'<mpadded height="0.55em">\g<0></mpadded>', formula)  # as over low letters


def visit_inline(translator: Any, node: nodes.math) -> None:
    """Write a formula of the text."""
    translator.body.append(f'<span class="{CLASSES}">{typeset(node, False)}</span>')
    raise nodes.SkipNode


def visit_display(translator: Any, node: nodes.math_block) -> None:
    """Write a formula in lines of its own, with its number and a link to it."""
    translator.body.append(translator.starttag(node, "div", CLASS=CLASSES))
    if node["number"]:
        number = get_node_equation_number(translator, node)
        translator.body.append(f'<span class="eqno">({number})')
        translator.add_permalink_ref(node, "Link to this equation")
        translator.body.append("</span>")
    translator.body.append(f"{typeset(node, True)}</div>\n")
    raise nodes.SkipNode


def hold(app: Any, page: str, template: str, context: dict[str, Any], doctree: Any) -> None:
    """Keep each formula on one line with the signs around it."""
    context["body"] = HELD.sub(r'<span class="nobr">\g<0></span>', context.get("body", ""))


def setup(app: Any) -> dict[str, bool]:
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_display, None))
    app.connect("html-page-context", hold)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
