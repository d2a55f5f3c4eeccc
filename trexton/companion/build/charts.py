"""Figures set into the page itself. So they follow its theme, and weigh less."""

import base64
import re
from collections import Counter
from html import escape

import cv2
import numpy as np

from trexton.base.errors import DataError

_PICTURE = re.compile(r'"data:image/png;base64,\s*([^"]{20000,})"')  # worth compressing
_PHONE = re.compile(r"<!--phone (.*?)-->", re.DOTALL)
_QUALITY = 60
_NARROW = 400  # points, up to which a figure can be read on a phone as it is


def is_figure(svg: str) -> bool:
    """Whether this is one of our figures, which Matplotlib drew."""
    return "<dc:title>Matplotlib" in svg


def with_phone(svg: str, phone: bytes | None) -> str:
    """The SVG with its layout for phones in a comment, where notebooks leave it alone."""
    if phone is None:
        return svg
    own = re.sub(r"<!--.*?-->", "", phone.decode(), flags=re.DOTALL)
    return svg.replace("</svg>", f"<!--phone {own[own.index('<svg') :]}--></svg>")


def inline_figure(svg: str, name: str, alt: str) -> str:
    """``<svg>`` elements for a page: one, or a wide one and that for phones.

    `svg` is what `trexton.companion.experiments.figure_files.to_svg` or `with_phone` gave; anything
    else raises `DataError`. The `name` is put before every identifier, so that several figures go
    on one page; `alt` says what it shows, for who cannot see it.
    """
    start = svg.find("<svg")
    if start < 0:
        raise DataError(f"figure {name}: no SVG: run its experiment again")
    if phone := _PHONE.search(svg):
        wide = inline_figure(svg.replace(phone[0], ""), name, alt)
        narrow = inline_figure(phone[1], f"{name}p", alt)
        return wide.replace('class="chart', 'class="chart wide', 1) + narrow.replace(
            'class="chart', 'class="chart phone', 1
        )
    body = re.sub(r"<metadata>.*?</metadata>", "", svg[start:], flags=re.DOTALL)
    body = body.replace("xlink:href=", "href=")
    # Names of marks, of eleven characters, are shortened: thousands of marks carry them.
    body = re.sub(r'\b(id|href)="(#?)(m[\da-f]{6}|[^":]+)[\da-f]*"', rf'\1="\2{name}-\3"', body)
    body = body.replace("url(#", f"url(#{name}-")
    # A theme may change a colour: grey and black turn round in the dark, hues get lighter.
    body = re.sub(r"(#([\da-f]{6}))\b(?!-)", r"var(--fig-\2, \1)", body)
    body = _styles_once(_PICTURE.sub(_lighter, body), name)
    body = re.sub(r'\b(width|height)="([\d.]+)pt"', _in_pixels, body, count=2)
    box = re.search(r'viewBox="\S+ \S+ ([\d.]+)', body)
    kind = "chart narrow" if box and float(box[1]) <= _NARROW else "chart"
    label = f'<svg class="{kind}" role="img" aria-label="{escape(alt, quote=True)}"'
    return body.replace("<svg", label, 1).replace("\n", " ")


def _styles_once(body: str, name: str) -> str:
    """Styles that many marks share become classes: a page of them weighs half as much."""
    counts = Counter(re.findall(r'style="[^"]+"', body))
    shared = [style for style, count in counts.items() if count > 20]
    for number, style in enumerate(shared):
        body = body.replace(style, f'class="{name}-{number}"')
    rules = "".join(f".{name}-{number} {{{style[7:-1]}}}" for number, style in enumerate(shared))
    return body.replace(">", f"><style>{rules}</style>", 1) if shared else body


def _in_pixels(match: re.Match[str]) -> str:
    return f'{match[1]}="{float(match[2]) * 4 / 3:.0f}"'


def _lighter(match: re.Match[str]) -> str:
    raw = np.frombuffer(base64.b64decode(match[1]), np.uint8)
    picture = cv2.imdecode(raw, cv2.IMREAD_UNCHANGED)
    assert picture is not None  # matplotlib wrote it
    coded = cv2.imencode(".webp", picture, [cv2.IMWRITE_WEBP_QUALITY, _QUALITY])[1].tobytes()
    return f'"data:image/webp;base64,{base64.b64encode(coded).decode()}"'
