"""The built pages, checked: nothing from another host, no dead link, every picture described."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

__all__ = ["audit"]

# Elements whose address the browser loads by itself; an <a> waits for a click.
_LOADED = {
    "script": "src",
    "img": "src",
    "iframe": "src",
    "source": "src",
    "video": "src",
    "audio": "src",
    "embed": "src",
    "object": "data",
}
_LOADED_LINKS = {
    "stylesheet",
    "icon",
    "preload",
    "prefetch",
    "preconnect",
    "dns-prefetch",
    "modulepreload",
    "shortcut",
}


class _Page(HTMLParser):
    def __init__(self, path: Path):
        super().__init__()
        self.loaded: list[str] = []
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.undescribed: list[str] = []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        values = {name: value or "" for name, value in attributes}
        self.anchors |= {values[key] for key in ("id", "name") if key in values}
        if tag in _LOADED and _LOADED[tag] in values:
            self.loaded.append(values[_LOADED[tag]])
        elif tag == "link" and _LOADED_LINKS & set(values.get("rel", "").split()):
            self.loaded.append(values.get("href", ""))
        elif tag == "a" and "href" in values:
            self.links.append(values["href"])
        if tag == "img" and not values.get("alt", "").strip():
            self.undescribed.append(values.get("src", ""))


def audit(html: Path) -> list[str]:
    """Faults of the built pages below `html`, as sentences; empty if there are none."""
    pages = {
        path: _Page(path)
        for path in sorted(html.rglob("*.html"))
        if "_static" not in path.relative_to(html).parts
    }
    faults = []
    for path, page in pages.items():
        name = path.relative_to(html)
        faults += [
            f"{name}: loads {address} from another host"
            for address in page.loaded
            if _is_remote(address)
        ]
        faults += [
            f"{name}: the picture {source} has no alternative text" for source in page.undescribed
        ]
        faults += [
            f"{name}: the link {link} leads nowhere"
            for link in page.links + page.loaded
            if not _leads(path, link, pages)
        ]
    for sheet in sorted(html.rglob("*.css")):
        text = sheet.read_text(encoding="utf-8", errors="replace")
        if any(
            mark in text
            for mark in (
                "url(http",
                'url("http',
                "url('http",
                "url(//",
                '@import "http',
                "@import 'http",
            )
        ):
            faults.append(f"{sheet.relative_to(html)}: loads something from another host")
    return faults


def _is_remote(address: str) -> bool:
    return address.startswith("//") or urlsplit(address).scheme in ("http", "https")


def _leads(path: Path, link: str, pages: dict[Path, _Page]) -> bool:
    parts = urlsplit(link)
    if parts.scheme or link.startswith("//") or link in ("", "#"):
        return True
    target = path if not parts.path else (path.parent / unquote(parts.path)).resolve()
    if target.is_dir():
        target = target / "index.html"
    if not target.exists():
        return False
    return (
        not parts.fragment
        or target not in pages
        or unquote(parts.fragment) in pages[target].anchors
    )
