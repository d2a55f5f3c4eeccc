"""A Sphinx extension: MathML for mathematics. It is made when the book is built."""

import re
from typing import Any

from docutils import nodes  # type: ignore[import-untyped]
from latex2mathml.converter import convert
from sphinx.application import Sphinx

_ARG = re.compile(r"\\arg\\(max|min)")  # which the converter does not know


def mathml(tex: str, display: str = "inline") -> str:
    """A ``<math>`` element of TeX without its dollars; `display` is ``inline`` or ``block``.

    Raises `ValueError` where something of it was not understood, and would stand there as TeX.
    """
    tex = _ARG.sub(r"\\operatorname{arg\1}", tex)
    element = str(convert(tex.strip(), display=display))
    # MathML Core has no named widths, and no negative ones.
    element = re.sub(r'<mspace width="negative\w+" ?/>', "", element)
    if left := re.search(r"\\[A-Za-z]+", element):
        raise ValueError(f"{left[0]} of {tex!r} cannot be set as MathML: write it another way")
    return element


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the renderer ``mathml``."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}


def _inline(translator: Any, node: nodes.math) -> None:
    translator.body.append(mathml(node.astext()))
    raise nodes.SkipNode


def _block(translator: Any, node: nodes.math_block) -> None:
    # A wide equation scrolls in its own area, which a keyboard reaches.
    translator.body.append('<div class="math" tabindex="0" role="group" aria-label="Equation">')
    translator.body.append(mathml(node.astext(), "block") + "</div>\n")
    raise nodes.SkipNode
