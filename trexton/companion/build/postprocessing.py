"""The last hand at built pages: lighter, for any width, by keyboard, with or without scripts.

Jupyter Book gives good pages for a developer with a fast line. Here they lose what they do not
need (an icon font, a script host, maps of sources), figures go into the page, every table can be
scrolled by keyboard and taken home as CSV, and everything to download is listed.
"""

from __future__ import annotations

import csv
import io
import re
import shutil
from pathlib import Path

import cv2
from bs4 import BeautifulSoup, Tag

from trexton.base.files import atomic_file
from trexton.companion.build.charts import inline_figure, is_figure

__all__ = ["finish_book", "finish_page"]

_UNWANTED = re.compile(r"fontawesome|sphinx-thebe|mathjax")
_SENTENCE = 8  # words
_COLUMNS = 6  # of numbers, that a phone may scroll
_DESCRIPTION = 155  # characters of a description that search engines show
_FORMATS = {"ipynb": "notebook", "md": "notebook as text", "json": "record"}


def finish_book(html: Path) -> None:
    """Finish every page below `html`, and drop files that no page asks for."""
    for path in sorted(html.rglob("*.html")):
        # A player is whole as it is.
        if "_static" not in path.relative_to(html).parts and not path.stem.endswith("-player"):
            text = finish_page(path)
            with atomic_file(path) as stream:
                stream.write(text)
    static = html / "_static"
    for folder in (static / "vendor", static / "mathjax"):
        shutil.rmtree(folder, ignore_errors=True)
    for pattern in ("*.map", "*thebe*"):
        for path in static.rglob(pattern):
            path.unlink()


def finish_page(path: Path) -> str:
    """The finished text of one page; tables are written as CSV beside it."""
    page = BeautifulSoup(path.read_text(encoding="utf-8"), "lxml")
    _head(page)
    article = page.find("article") or page
    assert isinstance(article, Tag)
    for element in page.select("#jb-print-docs-body"):  # a second title and contents, never shown
        element.decompose()
    _frame(page)
    if path.stem != "search":
        _figures(article, path)
        _tables(article, path)
        _downloads(article, path)
        _images(article, path)
        _hold_together(article)
    return str(page)


def _head(page: BeautifulSoup) -> None:
    head = page.head
    assert head is not None
    for element in page.find_all(["script", "link"]):
        address = f"{element.get('src', '')} {element.get('href', '')}"
        if _UNWANTED.search(address) or re.search("THEBE|MathJax", element.string or ""):
            element.decompose()
    # Twice the same would be an error where it says const, and a waste elsewhere.
    scripts: set[str] = set()
    for element in page.find_all("script", src=False):
        text = (element.string or "").strip()
        if text.startswith("var toggle") and text in scripts:
            element.decompose()
        scripts.add(text)
    for element in head.find_all("meta", attrs={"name": "viewport"})[1:]:
        element.decompose()
    if head.find("meta", attrs={"name": "description"}) is None:
        if said := _first_words(page):
            head.append(page.new_tag("meta", attrs={"name": "description", "content": said}))
    scripted = page.new_tag("script")
    scripted.string = "document.documentElement.classList.add('scripted')"
    head.append(scripted)


def _first_words(page: BeautifulSoup) -> str:
    """The finding, the lead or the first paragraph, cut at a word."""
    chosen = page.select_one("article p.finding, article .lead p, article p")
    words = " ".join(chosen.get_text(" ").split()) if chosen else ""
    if len(words) <= _DESCRIPTION:
        return words
    return words[:_DESCRIPTION].rsplit(" ", 1)[0] + " …"


def _frame(page: BeautifulSoup) -> None:
    """Names for what the theme leaves without: buttons, checkboxes, the areas of the page."""
    names = {
        "button.primary-toggle": "Contents of the book",
        "button.secondary-toggle": "Contents of this page",
    }
    for selector, name in names.items():
        for element in page.select(selector):
            element["aria-label"] = name
    for element in page.select("input.sidebar-toggle"):
        element["aria-hidden"] = "true"
        element["tabindex"] = "-1"
    for element in page.select(".citation-list[role=list] > .citation"):
        element["role"] = "listitem"
    for element in page.select(".bd-sidebar-primary .caption[role=heading]"):
        del element["role"], element["aria-level"]


def _figures(article: Tag, path: Path) -> None:
    """Our figures into the page; one without a caption gets what it shows as its caption."""
    for count, image in enumerate(article.find_all("img"), start=1):
        source, alt = str(image.get("src", "")), str(image.get("alt", ""))
        if "_images/" not in source:
            continue
        text = (path.parent / source).read_text("utf-8") if source.endswith(".svg") else ""
        figure = image.find_parent("figure")
        if "hero" in image.get_attribute_list("class"):
            (image.find_parent("a", class_="image-reference") or image).wrap(
                _new("div", class_="hero", tabindex="0", role="group", aria_label=alt)
            )
        elif figure is None:
            figure = image.wrap(_new("figure"))
            caption = _new("figcaption")
            caption.append(alt + ("" if alt.endswith(".") else "."))
            figure.append(caption)
        if figure is not None:
            figure["class"] = " ".join(["plate", *map(str, figure.get_attribute_list("class"))])
        if is_figure(text):
            drawn = BeautifulSoup(inline_figure(text, f"f{count}", alt), "html.parser")
            (image.find_parent("a", class_="image-reference") or image).replace_with(drawn)


def _tables(article: Tag, path: Path) -> None:
    """Every table: an area that scrolls by keyboard, a number, the heading above, and its CSV."""
    count, numbers = 0, {}
    for table in article.find_all("table"):
        if table.find_parent("table"):
            continue
        rows = [_cells(row) for row in table.find_all("tr")]
        if not any(rows):
            continue
        count += 1
        heading = table.find_previous(["h1", "h2", "h3"])
        title = heading.get_text().strip("#\n ") if heading else "Table"
        file = path.with_name(f"{path.stem}-table-{count}.csv")
        stream = io.StringIO()
        csv.writer(stream, lineterminator="\n").writerows(rows)
        with atomic_file(file) as out:
            out.write(stream.getvalue())
        for cell in table.select("thead th"):
            if not cell.get_text().strip():
                cell.name = "td"
        caption = table.caption
        if caption is None:
            caption = _new("caption")
            caption.append(title)
            table.insert(0, caption)
        said = caption.find(string=True, recursive=False)
        numbered = f"Table {count}. {re.sub(r'^Table [0-9]+[.] ', '', str(said or ''))}"
        said.replace_with(numbered) if said else caption.insert(0, numbered)
        numbers[table.get("id")] = count
        classes = {*map(str, table.get_attribute_list("class"))}
        if _wordy(rows) or _wide(rows):
            classes.add("stacked")
            table["class"] = " ".join(sorted(classes))
        if "stacked" in classes:
            _label_cells(table)
        words = " ".join(caption.get_text().split())
        link = _new("a", href=file.name, class_="csv", download="")
        link.string = "CSV"
        link["aria-label"] = f"CSV of: {words}"
        caption.append(" ")
        caption.append(link)
        area = table.find_parent(class_="pst-scrollable-table-container")
        if area is None:
            area = table.wrap(_new("div", class_="pst-scrollable-table-container"))
        area["tabindex"], area["role"] = "0", "region"
        area["aria-label"] = words
    for link in article.select("a.to-table"):
        if number := numbers.get(str(link["href"])[1:]):
            link.string = f"Table {number}"
        else:
            link.unwrap()
    for block in article.find_all("pre"):
        block["tabindex"] = "0"


def _wordy(rows: list[list[str]]) -> bool:
    """Whether a table says sentences beside its first column: too much for a phone's columns."""
    return any(len(cell.split()) >= _SENTENCE for row in rows[1:] for cell in row[1:])


def _wide(rows: list[list[str]]) -> bool:
    """Whether a table is wider than long: as cards it stays short, and nothing is out of sight."""
    return len(rows[0]) > max(_COLUMNS, len(rows))


def _label_cells(table: Tag) -> None:
    """Each cell with the name of its column, which a phone shows before it."""
    heads = [cell.get_text().strip() for cell in table.select("thead tr th, thead tr td")]
    for row in table.select("tbody tr"):
        for head, cell in zip(heads, row.find_all(["td", "th"]), strict=False):
            cell["data-label"] = cell.get("data-label") or head
            if not cell.get_text().strip():
                cell["class"] = "nothing"


def _cells(row: Tag) -> list[str]:
    return [" ".join(cell.get_text(" ").split()) for cell in row.find_all(["td", "th"])]


def _downloads(article: Tag, path: Path) -> None:
    """What a paragraph of downloads offers: all files of the record that it names."""
    for place in article.select("p.downloads"):
        record = path.parent / str(place["data-of"])
        place.clear()
        place.append("Take home: ")
        files = sorted(
            (each for each in record.parent.glob(f"{record.name}[-.]*") if each.suffix != ".html"),
            key=lambda each: (each.suffix not in (".json", ".ipynb", ".md"), each.name),
        )
        for index, file in enumerate(files):
            link = _new("a", href=file.relative_to(path.parent).as_posix(), download="")
            name = file.name.removeprefix(record.name).strip("-.")
            link.string = _FORMATS.get(name, name)
            place.append(link)
            if index + 1 < len(files):
                place.append(" · ")


def _images(article: Tag, path: Path) -> None:
    """Width and height of every picture, so that nothing moves when it comes."""
    for index, image in enumerate(article.find_all("img")):
        size = _size(path.parent / str(image.get("src", "")).split("?")[0])
        if size and "height" not in image.attrs:
            image["width"], image["height"] = (str(round(each)) for each in size)
            image["style"] = "height:auto;" + str(image.get("style", ""))
        if index:
            image["loading"] = "lazy"


def _size(file: Path) -> tuple[float, float] | None:
    if not file.is_file():
        return None
    if file.suffix == ".svg":
        box = re.search(r'viewBox="\S+ \S+ (\S+) (\S+)"', file.read_text("utf-8"))
        return (float(box[1]), float(box[2])) if box else None
    picture = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
    return None if picture is None else (picture.shape[1], picture.shape[0])


_UNIT = r"(?<=[\d\]]) (?=%|(?:k?m|[cm]m|[mu]?s|Hz|[kMG]B)\b)"
_WITHIN = r"(?<=\d,) (?=-?[\d.,]+\])"
_TOGETHER = re.compile(f"{_UNIT}|{_WITHIN}")


def _hold_together(article: Tag) -> None:
    """A number and its unit stay on one line, and so does an interval."""
    for text in article.find_all(string=_TOGETHER):
        if text.find_parent(["pre", "code", "script", "svg", "math"]) is None:
            text.replace_with(_TOGETHER.sub("\N{NO-BREAK SPACE}", text))


def _new(name: str, **attributes: str) -> Tag:
    """A new element; ``class_`` for class, ``aria_label`` for aria-label."""
    made = BeautifulSoup("", "lxml").new_tag(name)
    for key, value in attributes.items():
        made[key.rstrip("_").replace("_", "-")] = value
    return made
