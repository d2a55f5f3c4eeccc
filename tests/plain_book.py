"""How plainly the book is written: every page is measured, and what is out of bounds is named.

``measure`` reads a page as a reader meets it: every value of its template is a 7, and all that it
may say is there, without code, equations and figures. ``make prose`` prints all pages, and a test
holds them to the bounds.
"""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from pathlib import Path

import yaml
from markdown_it import MarkdownIt
from mdit_py_plugins.deflist import deflist_plugin

from trexton.base.cache import repository_root

__all__ = ["BOOK", "Prose", "measure", "pages"]

# Looked up, not read: as long as they must be. The other bounds hold for them too.
REFERENCE = {"CHANGELOG", "claims", "glossary", "library", "paper_map", "references", "trust"}
SENTENCE, PARAGRAPH, PAGE, README, BOOK = 35, 90, 900, 450, 16_000  # words at most
PAGES = 30  # at most
MOST = {"mean": 18.0, "marks": 0.15, "numbers": 2.0, "idiom": 3.0}
# What this project said to itself, and nobody could look up.
IDIOM = re.compile(
    r"\b(?:told|foretold|foretells?|unheard|misled|misleads?|heeds?|gives? way|askew|surprise"
    r"|bumps|doubts|strange(?:ness)?|carried away|errs?|what (?:is|it) claim(?:s|ed)"
    r"|claims? too (?:much|little)|looks? at a place|contradicted|in vain|to and fro|speaks? for)\b"
)
WORD = re.compile(r"[^\W_]+(?:['’.,/-][^\W_]+)*")
END = re.compile(r"(?<=[.!?])[\"')*]*\s+(?=[\"'(*\[]*[A-Z0-9])")
CELL = re.compile(r"^```\{code-cell\}.*?^```", re.M | re.S)
# Of a template: whole lines of tags and tags within a line, links, values that are words, others.
TEMPLATE = (
    (re.compile(r"^ *\{%[^%\n]*%\}\n", re.M), ""),
    (re.compile(r"\{%.*?%\}|\{##.*?##\}", re.S), " "),
    (re.compile(r"""\{\{ see\(["']\w+["'], ["'](.*?)["']\) \}\}"""), r"\1"),
    (re.compile(r"\{\{ (?:\w+\([^}]*\)|[^}]*(?:\| text|\.stale)) \}\}"), "words"),
    (re.compile(r"\{\{.*?\}\}", re.S), "7"),
)
ASIDE = re.compile(
    r"\A---\n.*?\n---\n|\$\$.*?\$\$|<[!/a-z].*?>|^:{3,}.*?$|^:[\w-]+:.*?$|\{cite[:a-z]*\}`[^`]*`",
    re.M | re.S,
)


@dataclass
class Prose:
    """The paragraphs and items of a page, and the cells of its tables, as plain text."""

    name: str
    paragraphs: list[str]
    cells: list[str]

    def measures(self) -> dict[str, float]:
        """Words; the mean sentence; semicolons and colons in one; numbers in a hundred words,
        idiom in a thousand.
        """
        text = "\n".join(self.paragraphs)
        words, sentences = max(_words(text), 1), _sentences(self.paragraphs)
        return {
            "words": words,
            "mean": words / max(len(sentences), 1),
            "marks": len(re.findall(r"[;:](?!\S)", text)) / max(len(sentences), 1),
            "numbers": 100 * len(re.findall(r"(?<![\w.])\d[\d,.]*", text)) / words,
            "idiom": 1000 * len(IDIOM.findall(text.lower())) / words,
        }

    def faults(self) -> list[str]:
        """Every bound that the page breaks, and the sentence that does."""
        most = MOST | {"words": README if self.name == "README" else PAGE}
        measures = self.measures()
        if self.name in REFERENCE:
            del most["words"]
        found = [f"{k}: {measures[k]:.4g}, at most {m}" for k, m in most.items() if measures[k] > m]
        texts = [(each, SENTENCE) for each in _sentences(self.paragraphs + self.cells)]
        texts += [(each, PARAGRAPH) for each in self.paragraphs]
        return found + [f"{n} words, at most {m}: {t}" for t, m in texts if (n := _words(t)) > m]


def _words(text: str) -> int:
    return len(WORD.findall(text))


def _sentences(texts: list[str]) -> list[str]:
    return [each for text in texts for each in END.split(text) if _words(each)]


def measure(path: Path) -> Prose:
    """One page of Markdown; of a notebook's cells, what they say counts too."""
    text = path.read_text(encoding="utf-8")
    text = CELL.sub(lambda c: "\n\n".join(re.findall(r'say\(r"""\n(.*?)"""', c[0], re.S)), text)
    text = ASIDE.sub("", re.sub(r"\{(?:doc|term)\}`([^`<]*?) ?(?:<[^`]*>)?`", r"\1", text))
    for pattern, words in TEMPLATE:
        text = pattern.sub(words, text)
    page = Prose(path.stem, [], [])
    kind = ""
    for token in MarkdownIt().enable("table").use(deflist_plugin).parse(text):
        if token.type == "inline" and not kind.startswith("heading"):
            parts = (
                "Code" if each.type == "code_inline" else each.content or " "
                for each in token.children or ()
                if each.type != "image"
            )
            plain = re.sub(r"\$[^$]+\$", "x", "".join(parts))
            (page.cells if kind.startswith(("td", "th")) else page.paragraphs).append(plain)
        kind = token.type
    return page


def pages(root: Path) -> list[Prose]:
    """README, CHANGELOG and the pages of the book: prose with the notebooks that stand on it."""
    toc = yaml.safe_load((root / "book" / "_toc.yml").read_text(encoding="utf-8"))
    chapters = [each for part in toc["parts"] for each in part["chapters"]]
    files = {"README": ["README"], "CHANGELOG": ["CHANGELOG"], toc["root"]: [f"book/{toc['root']}"]}
    for each in chapters:
        notebooks = [name for name in each.get("notebooks", ()) if name != "*"]
        files[each["file"]] = [f"book/{each['file']}", *(f"notebooks/{n}" for n in notebooks)]
    found = []
    for name, paths in files.items():
        own = [measure(path) for each in paths if (path := root / f"{each}.md").is_file()]
        if own:
            cells = [text for page in own for text in page.cells]
            found.append(Prose(name, [text for page in own for text in page.paragraphs], cells))
    return found


if __name__ == "__main__":
    book = pages(repository_root() or Path("."))
    total = sum(each.measures()["words"] for each in book[2:])
    for page in book:
        print(f"{page.name:20}", *(f"{key} {v:6.3g} " for key, v in page.measures().items()))
    faults = [f"{page.name}: {fault}" for page in book for fault in page.faults()]
    for number, most, what in ((total, BOOK, "words"), (len(book) - 2, PAGES, "pages")):
        if number > most:
            faults.append(f"book: {number:,} {what}, at most {most:,}")
    print(f"{len(book) - 2} pages, {total:,} words beside README and CHANGELOG", *faults, sep="\n")
    sys.exit(bool(faults))
