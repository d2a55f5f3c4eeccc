"""The book: numbers come from records or the build stops; built pages need no other host."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest
import yaml
from conftest import ROOT, mocap_record, small_flight

import trexton
from trexton.base.errors import DataError, TrextonError
from trexton.companion.build import make as book_flights
from trexton.companion.build.display import Outcome
from trexton.companion.build.flight_pairs import FlightPair
from trexton.companion.build.make import build_small_book, prepare_flights
from trexton.companion.build.plan import sole_writer
from trexton.companion.build.prose import context, public_names, render
from trexton.companion.build.sources import Contents, lead_from_old_addresses, stage
from trexton.companion.experiments.registry import EXPERIMENTS
from trexton.flights.folder import read_flight
from trexton.flights.writing import write_flight
from trexton.localization.landing import TouchdownZone

BUILT = ROOT / "book" / "_build" / "html"


@pytest.fixture
def built_book() -> Path:
    if not (BUILT / "index.html").exists():
        pytest.skip("no book is built here: make book")
    return BUILT


@pytest.fixture
def page(tmp_path):
    """Render the text of one page."""

    def page(text: str, **names) -> str:
        path = tmp_path / "page.md"
        path.write_text(text)
        return render(path, context(tmp_path, {}, lambda page, words: words) | names)

    return page


def test_numbers_are_filled_in_from_records(page):
    error = {"value": 61.34, "low": 50.0, "high": 1234.5}
    sim = {"mocap_training": {"error": error, "items": 3}}
    assert page("{{ sim.mocap_training.error.value | fixed(1) }} cm", sim=sim) == "61.3 cm"
    assert page("{{ sim.mocap_training.error | span }}", sim=sim) == "61 [50, 1,234]"
    assert (
        page("{{ sim.mocap_training.items }}", sim=sim) == "3"
    )  # an entry, not the method of dict
    assert page("{{ paper.parameters.samples }}") == "400"
    assert page("{{ touchdown.settled_s }}") == str(TouchdownZone((0.0, 0.0)).settled_s)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("one\ntwo {{ sim.mocap_training.eror }}", "line 2: .*eror"),
        ("{{ nothing }}", "line 1: 'nothing' is undefined"),
        ("{{ sim.other.error | fixed }}", "other"),
        ("{% if sim %}", "line 1: Unexpected end of template"),
        ("{{ 'text' | fixed }}", "line 1: .*format code"),
    ],
)
def test_a_name_that_no_record_has_stops_the_build(page, text, message):
    with pytest.raises(DataError, match=message):
        page(text, sim={"mocap_training": {"error": 1}})


def test_links_lead_to_pages_and_to_experiments_on_them_or_are_plain_text(results):
    pairs, outcomes, folder = results
    book = Contents(ROOT / "book", folder, pairs, outcomes)
    assert book.see("your_flight", "yours") == "{doc}`yours </your_flight>`"
    assert book.see("mocap_training", "it") == "{doc}`it </mocap_training>`"
    assert book.see("hall", "of `field`") == "{doc}`of field </hall>`"  # a role would end there
    assert book.see("moon", "the moon") == book.see("mosaic", "the moon") == "the moon"
    small = Contents(ROOT / "book", folder, pairs, outcomes, toc_file="_toc_small.yml")
    assert small.pages == {"small": [], "mocap_training": ["mocap_training"]}


def test_mathematics_and_attributes_of_myst_survive(page):
    text = "$\\frac{a}{b}_{t-1}^{[m]}$ {#label .class} {cite}`x` {% raw %}{{ kept }}{% endraw %}"
    assert page(text) == text.replace("{% raw %}", "").replace("{% endraw %}", "")


# --- staging
# ----------------------------------------------------------------------------------------------


@pytest.fixture
def results(tmp_path):
    """One finished and one skipped experiment on the small flight."""
    flight = write_flight(small_flight(), tmp_path / "small")
    folder = tmp_path / "results" / "small"
    folder.mkdir(parents=True)
    mocap_record("small", 61.0).save(folder)
    size = 'width="20" height="10"'
    chart = f'<svg xmlns="http://www.w3.org/2000/svg" {size}><rect {size}/></svg>'
    (folder / "mocap_training-chart.svg").write_text(chart)
    cells = [
        nbformat.v4.new_markdown_cell("# A finished experiment\n\nIt has $x^2$ in it."),
        nbformat.v4.new_markdown_cell(
            "See [itself](mocap_training.ipynb), [the map](mosaic.ipynb)."
        ),
        nbformat.v4.new_code_cell(
            "chart",
            metadata={"mystnb": {"image": {"alt": "a black box"}}, "tags": ["remove-input"]},
            execution_count=1,
            outputs=[
                nbformat.v4.new_output(
                    "display_data", {"image/svg+xml": chart, "text/plain": "chart"}
                )
            ],
        ),
        nbformat.v4.new_markdown_cell('<a href="small/mocap_training.json">record</a>'),
    ]
    nbformat.write(nbformat.v4.new_notebook(cells=cells), folder / "mocap_training.ipynb")
    outcomes = [
        Outcome("small", "mocap_training", "ran", ("no finished run",), 1.0),
        Outcome("small", "mosaic", "skipped", ("small has no images",)),
    ]
    return [FlightPair(str(flight))], outcomes, tmp_path / "results"


def test_every_experiment_stands_on_one_page_of_thirty():
    book = Contents(ROOT / "book", ROOT, (), ())
    assert sorted(book.named) == sorted({*EXPERIMENTS} - {"assessment"})  # of a flight of one's own
    toc = yaml.safe_load((ROOT / "book" / "_toc.yml").read_text())
    assert 1 + sum(len(part["chapters"]) for part in toc["parts"]) <= 30


def test_the_contents_name_only_pages_that_are_there(results, tmp_path):
    pairs, outcomes, folder = results
    staged = tmp_path / "staged"
    staged.mkdir()
    small = "_toc_small.yml"
    stage(Contents(ROOT / "book", folder, pairs, outcomes, toc_file=small), staged)
    assert (staged / "small" / "mocap_training.json").is_file()
    toc = (staged / "_toc.yml").read_text()
    assert "file: mocap_training" in toc and "mosaic" not in toc and "claims" not in toc
    assert "small has no images" in (staged / "small.md").read_text()
    # A link to an experiment without a page is plain text, and no fault of the build.
    text = (staged / "mocap_training.ipynb").read_text()
    assert "See {doc}`itself </mocap_training>`, the map." in text


def test_a_page_that_does_not_exist_stops_the_build(results, tmp_path):
    pairs, outcomes, folder = results
    source = tmp_path / "source"
    shutil.copytree(ROOT / "book", source, ignore=shutil.ignore_patterns("_build"))
    (source / "_toc_small.yml").write_text("root: small\nparts:\n- chapters:\n  - file: moon\n")
    with pytest.raises(DataError, match="the page 'moon' does not exist"):
        stage(
            Contents(source, folder, pairs, outcomes, toc_file="_toc_small.yml"),
            tmp_path,
        )


def test_the_whole_book_can_be_staged_without_the_real_flight(results, tmp_path):
    pairs, outcomes, folder = results
    staged = tmp_path / "staged"
    staged.mkdir()
    stage(
        Contents(
            ROOT / "book",
            folder,
            pairs,
            outcomes,
            absent={"cyberzoo": "the net is down"},
        ),
        staged,
    )
    for page in ("intro", "run_again"):  # plainly, and no error or path of this machine
        text = " ".join((staged / f"{page}.md").read_text().split())
        assert "was not there when this book was made" in text and "`make book` again" in text
        assert "the net is down" not in text


def test_a_small_book_is_built_and_reused(results, capsys):
    pairs, outcomes, folder = results
    index = build_small_book(pairs, outcomes, folder)
    assert "book: built" in capsys.readouterr().err
    page = (index.parent / "mocap_training.html").read_text()
    assert 'alt="a black box"' in page and "<math" in page and "MathJax" not in page
    assert "THEBE" not in page and "fontawesome" not in page
    assert 'href="small/mocap_training.json"' in page
    assert (index.parent / "small" / "mocap_training.json").is_file()
    assert sorted(path.name for path in (folder / "book").iterdir()) == [".book.stamp", "html"]
    build_small_book(pairs, outcomes, folder)
    assert "book: reused" in capsys.readouterr().err

    notebook = folder / "small" / "mocap_training.ipynb"
    notebook.write_text(
        notebook.read_text().replace("in it.", "in it, and a {doc}`lost page </moon>`.")
    )
    with pytest.raises(TrextonError, match="unknown document.*moon"):
        build_small_book(pairs, outcomes, folder)
    with sole_writer(folder), pytest.raises(TrextonError, match="another run is writing to"):
        build_small_book(pairs, outcomes, folder)
    assert index.is_file()  # the last good book stays


# --- flights of the book
# ----------------------------------------------------------------------------------


@pytest.fixture
def toy_flights(tmp_path, monkeypatch):
    """`prepare_flights` with small flights in place of the real ones; counts what is made."""
    made = []

    def make(path, pattern=None):
        made.append(Path(path).name)
        return write_flight(small_flight(name=Path(path).name), path, replace=True)

    monkeypatch.setattr(book_flights, "_simulate", make)
    monkeypatch.setattr(book_flights, "fetch", lambda name, path, replace: make(path))
    return tmp_path / "flights", made


def test_flights_are_made_once_and_again_when_damaged(toy_flights, monkeypatch):
    folder, made = toy_flights
    assert [pair.name for pair in prepare_flights(folder).pairs] == ["sim-survey", "cyberzoo"]
    names = ["cyberzoo", "sim-survey", "sim-waypoints"]
    assert sorted(made) == sorted(names)
    assert prepare_flights(folder).said == [f"flight {name}: reused" for name in names]
    frames = folder / "sim-survey" / "frames.csv"
    frames.write_text(frames.read_text().replace("1,0.0,1.0,0.0", "1,0.0,1.0,0.5"))
    said = prepare_flights(folder).said[1]
    assert re.fullmatch("flight sim-survey: made, because sim-survey [^ ]{12} -> [^ ]{12}", said)
    shutil.rmtree(folder / "sim-waypoints")
    said = prepare_flights(folder).said[2]
    assert "flight sim-waypoints: made, because sim-waypoints" in said and "-> absent" in said
    monkeypatch.setattr(book_flights, "inputs_of", lambda *_: {"module x": "other"})
    assert "flight sim-survey: made, because module" in prepare_flights(folder).said[1]
    assert read_flight(folder / "sim-survey").name == "sim-survey"


def test_a_quick_book_needs_the_real_flight_alone(toy_flights, monkeypatch):
    folder, made = toy_flights
    assert [pair.name for pair in prepare_flights(folder, quick=True).pairs] == ["cyberzoo"]
    assert made == ["cyberzoo"]
    quick = Contents(ROOT / "book", ROOT, (), (), toc_file="_toc_quick.yml")
    assert quick.named == ["mocap_training", "claims"]
    shutil.rmtree(folder)

    def unreachable(name, path, replace):
        raise DataError("go online")

    monkeypatch.setattr(book_flights, "fetch", unreachable)
    prepared = prepare_flights(folder, quick=True)
    assert [pair.name for pair in prepared.pairs] == ["sim-survey"] and prepared.absent


def test_a_real_flight_out_of_reach_is_said_and_not_fatal(toy_flights, monkeypatch):
    def unreachable(name, path, replace):
        raise DataError("cyberzoo cannot be fetched: go online")

    monkeypatch.setattr(book_flights, "fetch", unreachable)
    prepared = prepare_flights(toy_flights[0])
    assert [pair.name for pair in prepared.pairs] == ["sim-survey"]
    assert prepared.absent == {"cyberzoo": "cyberzoo cannot be fetched: go online"}


# --- the book of this clone, where one is built
# -----------------------------------------------------------


def test_every_page_offers_the_notebooks_records_and_figures_of_its_experiments(built_book):
    text = "".join(path.read_text() for path in built_book.glob("*.html"))
    records = [path for path in built_book.glob("*/*.json") if path.with_suffix(".ipynb").exists()]
    assert records
    hrefs = set(re.findall(r'href="([^"]+)"', text))
    for path in records:
        figures = path.parent.glob(f"{path.stem}-*.svg")
        names = {f"{path.parent.name}/{file.name}" for file in (path, *figures)}
        assert not names - hrefs, f"no page offers {names - hrefs}"


def test_old_addresses_lead_to_the_pages_that_took_their_place(results, tmp_path):
    pairs, outcomes, folder = results
    outcomes = [*outcomes, Outcome("small", "rooms", "ran")]
    (folder / "small" / "rooms.ipynb").write_text(
        (folder / "small" / "mocap_training.ipynb").read_text()
    )
    html = tmp_path / "html"
    (html / "cyberzoo").mkdir(parents=True)
    (html / "trust.html").write_text("a page")
    book = Contents(ROOT / "book", folder, pairs, outcomes)
    lead_from_old_addresses(book, html)
    for old, new in (
        ("data", "your_flight.html"),
        ("sim-survey/mocap_training", "../mocap_training.html#mocap-training"),
        ("cyberzoo/light", "../rooms.html"),
    ):
        assert f'content="0; url={new}"' in (html / f"{old}.html").read_text()
    assert not (html / "cyberzoo" / "mosaic.html").exists()  # which this book has not
    assert (html / "trust.html").read_text() == "a page"


# --- the page on the library
# ------------------------------------------------------------------------------


def test_the_page_of_the_library_shows_all_that_is_public(page, tmp_path):
    """As the book builds it, every warning of a docstring an error."""
    config = yaml.safe_load((ROOT / "book" / "_config.yml").read_text())["sphinx"]
    autodoc = [name for name in config["extra_extensions"] if name.startswith("sphinx.")]
    names = ("autodoc_default_options", "autodoc_typehints", "default_role", "nitpick_ignore_regex")
    options = {name: config["config"][name] for name in names}
    lines = [
        f"extensions = {['myst_parser', *autodoc]}",
        *(f"{k} = {v!r}" for k, v in options.items()),
    ]
    source = tmp_path / "source"
    source.mkdir()
    (source / "conf.py").write_text("\n".join(lines))
    text = page((ROOT / "book" / "library.md").read_text(), public_names=public_names())
    (source / "index.md").write_text(text)
    command = [sys.executable, "-m", "sphinx", "-q", "-n", "-W", "--keep-going"]
    done = subprocess.run([*command, source, tmp_path / "out"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    html = (tmp_path / "out" / "index.html").read_text()
    for name in trexton.__all__:
        assert f'id="trexton.{name}"' in html or not callable(getattr(trexton, name))


def test_what_markdown_takes_for_markup_is_made_harmless(page):
    assert (
        page("{{ words | text }}", words="<b> {role}`x` $1 *z* [l](m)")
        == r"\<b\> \{role\}\`x\` \$1 \*z\* \[l\](m)"
    )
