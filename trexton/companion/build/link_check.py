"""The built pages, checked as Sphinx cannot: nothing from another host, no dead link, no picture
without words. Offers `audit`.
"""

from __future__ import annotations

import re
from pathlib import Path
from urllib.parse import unquote, urlsplit

from bs4 import BeautifulSoup, Tag

__all__ = ["audit"]

# Elements whose address the browser loads by itself; an <a> waits for a click.
_LOADED = "[src]:is(script, img, iframe, source, video, audio, embed), object[data]"
_LOADED_LINKS = ("stylesheet", "icon", "preload", "prefetch", "preconnect", "dns-prefetch",
                 "modulepreload", "shortcut")  # fmt: skip
_REMOTE = re.compile(r"//|https?:")
_REMOTE_STYLE = re.compile(r"""url\(["']?(http|//)|@import ["']http""")


def audit(html: Path) -> list[str]:
    """Faults of the built pages below `html`, as sentences; empty if there are none."""
    pages = {
        path: BeautifulSoup(path.read_text(encoding="utf-8"), "lxml")
        for path in sorted(html.rglob("*.html"))
        if "_static" not in path.relative_to(html).parts
    }
    anchors = {
        path: {str(each[key]) for key in ("id", "name") for each in page.select(f"[{key}]")}
        for path, page in pages.items()
    }
    faults = []
    for path, page in pages.items():
        links = [each for each in page.select("link[rel]") if _is_loaded(each)]
        loaded = [str(each.get("src", each.get("data"))) for each in page.select(_LOADED)]
        loaded += [str(each.get("href", "")) for each in links]
        followed = [str(each["href"]) for each in page.select("a[href]")]
        said = [f"loads {each} from another host" for each in loaded if _REMOTE.match(each)]
        said += [
            f"the picture {each.get('src', '')} has no alternative text"
            for each in page.select("img")
            if not str(each.get("alt", "")).strip()
        ]
        dead = [link for link in followed + loaded if not _leads(path, link, anchors)]
        said += [f"the link {link} leads nowhere" for link in dead]
        faults += [f"{path.relative_to(html)}: {each}" for each in said]
    for sheet in sorted(html.rglob("*.css")):
        if _REMOTE_STYLE.search(sheet.read_text(encoding="utf-8", errors="replace")):
            faults.append(f"{sheet.relative_to(html)}: loads something from another host")
    return faults


def _is_loaded(link: Tag) -> bool:
    return any(word in _LOADED_LINKS for word in link.get_attribute_list("rel"))


def _leads(path: Path, link: str, anchors: dict[Path, set[str]]) -> bool:
    parts = urlsplit(link)
    if parts.scheme or link.startswith("//") or link in ("", "#"):
        return True
    target = path if not parts.path else (path.parent / unquote(parts.path)).resolve()
    if target.is_dir():
        target = target / "index.html"
    if not target.exists():
        return False
    anchor = unquote(parts.fragment)
    return not anchor or target not in anchors or anchor in anchors[target]
