"""The last hand at built pages: lighter, for any width, by keyboard, with or without scripts.

Jupyter Book gives good pages for a developer with a fast line. Here they lose what they do not
need (an icon font, a script host), figures go into the page, and every table can be scrolled by
keyboard and read on a phone.
"""

import re
from pathlib import Path

from bs4 import BeautifulSoup, Tag

from trexton.base.files import write_file
from trexton.companion.build.charts import inline_figure, is_figure

_UNWANTED = re.compile(r"fontawesome|sphinx-thebe|mathjax|THEBE|MathJax")
_SENTENCE = 8  # words
_COLUMNS = 6  # of numbers, that a phone may scroll
_STEP = re.compile(r'id="step-(\d+)-')  # of a figure's layers
_STILL = re.compile(r'id="step-(\d+)-\d+"')
_TOGETHER = re.compile(r"(?<=\d,) (?=-?[\d.,]+\])|(?<=[\d\]]) (?=%|(?:[ckm]?m|[mu]?s|Hz|[kMG]B)\b)")
# What the theme leaves without: names of buttons, and what a keyboard or a reader must know.
_ATTRIBUTES = (
    ("button.primary-toggle", {"aria-label": "Contents of the book"}),
    ("button.secondary-toggle", {"aria-label": "Contents of this page"}),
    ("input.sidebar-toggle", {"aria-hidden": "true", "tabindex": "-1"}),
    (".citation-list[role=list] > .citation", {"role": "listitem"}),
    ("article pre", {"tabindex": "0"}),
)


def finish_book(html: Path) -> None:
    """Finish every page below `html`."""
    for path in sorted(html.rglob("*.html")):
        # A player is whole as it is.
        if "_static" not in path.relative_to(html).parts and not path.stem.endswith("-player"):
            text = finish_page(path)
            write_file(path, text)


def finish_page(path: Path) -> str:
    """The finished text of one page."""
    page = BeautifulSoup(path.read_text(encoding="utf-8"), "lxml")
    article = page.find("article") or page
    assert isinstance(article, Tag)
    _frame(page)
    if path.stem != "search":
        _figures(article, path)
        _tables(article)
        # A number and its unit stay on one line, and so does an interval.
        for text in article.find_all(string=_TOGETHER):
            if text.find_parent(["pre", "code", "script", "svg", "math"]) is None:
                text.replace_with(_TOGETHER.sub("\N{NO-BREAK SPACE}", text))
        for link in article.select('a[href^="#"]'):
            if len(str(link["href"])) > 1 and article.find(id=str(link["href"])[1:]) is None:
                link.unwrap()  # to what a flight does not have
    return str(page)


def _frame(page: BeautifulSoup) -> None:
    """What stands around the article: without other hosts, with names for what has none."""
    assert page.head is not None
    for element in page.find_all(["script", "link"]):
        address = f"{element.get('src', '')} {element.get('href', '')} {element.string or ''}"
        if _UNWANTED.search(address):
            element.decompose()
    scripted = page.new_tag("script")
    scripted.string = "document.documentElement.classList.add('scripted')"
    page.head.append(scripted)
    for element in page.select("#jb-print-docs-body"):  # a second title and contents, never shown
        element.decompose()
    for selector, attributes in _ATTRIBUTES:
        for element in page.select(selector):
            element.attrs.update(attributes)
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
            outer = image.find_parent("a", class_="image-reference") or image
            scrolled = {"class": "hero", "tabindex": "0", "role": "group", "aria-label": alt}
            outer.wrap(Tag(name="div", attrs=scrolled))
        elif figure is None:
            figure = image.wrap(Tag(name="figure"))
            caption = Tag(name="figcaption")
            caption.append(alt + ("" if alt.endswith(".") else "."))
            figure.append(caption)
        if figure is not None:
            figure["class"] = " ".join(["plate", *map(str, figure.get_attribute_list("class"))])
        if is_figure(text):
            drawn = BeautifulSoup(inline_figure(text, f"f{count}", alt), "html.parser")
            (image.find_parent("a", class_="image-reference") or image).replace_with(drawn)
            if figure is not None and (steps := sorted({*map(int, _STEP.findall(text))})):
                still = int(_STILL.findall(text)[0])
                caption = figure.find("figcaption") or figure
                caption.insert_before(_stepper(f"f{count}-step", steps, still))


def _stepper(group: str, steps: list[int], still: int) -> BeautifulSoup:
    """A choice among the steps of a figure, of which CSS shows the one that is chosen."""
    choices = "".join(
        f'<label><input type="radio" name="{group}" value="{step}"'
        f"{' checked' if step == still else ''}><span>{step + 1}</span></label>"
        for step in steps
    )
    text = f'<fieldset class="steps"><legend>Frame</legend>{choices}</fieldset>'
    return BeautifulSoup(text, "html.parser")


def _tables(article: Tag) -> None:
    """Every table: an area that scrolls by keyboard, named by its caption or the heading above;
    on a phone a list of cards where it is wide or wordy.
    """
    for table in article.find_all("table"):
        rows = [[cell.get_text(" ") for cell in row.select("td, th")] for row in table.select("tr")]
        if table.find_parent("table") or not any(rows):
            continue
        for cell in table.select("thead th"):
            if not cell.get_text().strip():
                cell.name = "td"
        # Sentences beside the first column are too much for a phone's columns.
        wordy = any(len(cell.split()) >= _SENTENCE for row in rows[1:] for cell in row[1:])
        # What is wider than long stays short as cards, and nothing is out of sight.
        wide = len(rows[0]) > max(_COLUMNS, len(rows))
        classes = {*map(str, table.get_attribute_list("class"))}
        if wordy or wide:
            classes.add("stacked")
            table["class"] = " ".join(sorted(classes))
        if "stacked" in classes:
            _label_cells(table)
        area = table.find_parent(class_="pst-scrollable-table-container")
        if area is None:
            scrolled = {"class": "pst-scrollable-table-container"}
            area = table.wrap(Tag(name="div", attrs=scrolled))
        name = table.caption or table.find_previous(["h1", "h2", "h3"])
        label = name.get_text().strip("#\n ") if name else "Table"
        area.attrs.update({"tabindex": "0", "role": "region", "aria-label": label})


def _label_cells(table: Tag) -> None:
    """Each cell with the name of its column, which a phone shows before it."""
    heads = [cell.get_text().strip() for cell in table.select("thead tr th, thead tr td")]
    for row in table.select("tbody tr"):
        for head, cell in zip(heads, row.find_all(["td", "th"]), strict=False):
            cell["data-label"] = cell.get("data-label") or head
            if not cell.get_text().strip():
                cell["class"] = "nothing"
