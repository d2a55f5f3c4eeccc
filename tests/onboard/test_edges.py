"""Edges that declare themselves: a stranger's sink in one file, and what is made of
declarations.
"""

from __future__ import annotations

import argparse
import sys

import pytest
from conftest import ROOT
from onboard_tools import make_fix, surroundings

from trexton.base.arguments import add_options, chosen_options
from trexton.base.errors import ParameterError
from trexton.cli.main import build_parser
from trexton.companion.build.prose import context, render
from trexton.onboard import sinks
from trexton.onboard.edges import classes_of_options, edge_classes

STRANGER = '''
"""One line of text a fix, in any unit."""

from dataclasses import dataclass

from trexton.onboard.sinks.files import FileSink
from trexton.base.options import Options, option


@dataclass(frozen=True)
class PlainOptions(Options):
    """Plain text"""

    unit: str = option("m", "unit of length", choices=("m", "cm"))
    digits: int = option(2, "digits after the point", low=0, high=9)
    prefix = "plain"


class Plain(FileSink):
    addresses = {"plain:FILE": "a line of text a position"}
    options = PlainOptions

    def write(self, fix):
        x, y = fix.position * {"m": 1, "cm": 100}[self.chosen.unit]
        self.add(f"{x:.{self.chosen.digits}f} {y:.{self.chosen.digits}f}")
'''


@pytest.fixture
def plain(tmp_path, monkeypatch):
    (tmp_path / "plain_sink.py").write_text(STRANGER)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setitem(sinks.SINKS, "plain", "plain_sink:Plain")
    yield
    sys.modules.pop("plain_sink", None)


def onboard_page(tmp_path):
    """The page of the book, with its tables."""
    names = context(tmp_path, {}, lambda page, words: words)
    return render(ROOT / "book" / "onboard.md", names)


def parsed(*words: str):
    parser = argparse.ArgumentParser()
    kinds = classes_of_options(edge_classes("sinks", sinks.SINKS))
    for kind in kinds:
        add_options(parser, kind)
    arguments = parser.parse_args(words)
    return parser, {kind: chosen_options(arguments, kind) for kind in kinds}


def arguments_of(words: list[str]):
    return build_parser("onboard", words).parse_args(words)


def test_a_strangers_sink_in_one_file_of_forty_lines(plain, tmp_path):
    assert len(STRANGER.strip().splitlines()) <= 40
    parser, options = parsed("--plain-unit", "cm", "--plain-digits", "1")
    assert "Plain text" in parser.format_help() and "unit of length" in parser.format_help()
    sink = sinks.open_sink(f"plain:{tmp_path}/out", surroundings(), options)
    sink.open()
    sink.write(make_fix(1.0, (1.25, 2.0)))
    sink.close()
    assert (tmp_path / "out").read_text() == "125.0 200.0\n"
    table = onboard_page(tmp_path)
    assert "| `plain:FILE` | a line of text a position |" in table
    assert "| `--plain-digits` | `2` | digits after the point |" in table


def test_an_installed_sink_is_asked_for_where_words_are_not_of_the_library(installed, capsys):
    installed("plain_sink", STRANGER, "sinks", "plain = plain_sink:Plain")
    words = ["onboard", "map.npz", "--output", "csv:out", "--rate", "5", "-q"]
    assert arguments_of(words).output == ["csv:out"] and "plain_sink" not in sys.modules
    for more in (["--output=plain:out"], ["--plain-unit", "cm"], ["--plain-un=cm"]):
        arguments = arguments_of(words + more)
        (kind,) = (each for each in arguments.kinds if each.prefix == "plain")
        assert chosen_options(arguments, kind).unit == ("m" if "plain:out" in more[0] else "cm")
    for asked in ("--help", "-qh", "--hel"):
        with pytest.raises(SystemExit):
            arguments_of(["onboard", asked])
        shown = capsys.readouterr().out
        assert "--plain-unit m|cm" in shown and "crazyflie:URI" not in shown
        kinds = " ".join(shown.split()).partition(" (default json)")[0].split()
        assert {"plain", "plain,"} & {*kinds}


@pytest.mark.parametrize("words", [["--plain-unit", "ell"], ["--plain-digits", "10"]])
def test_its_options_are_checked_and_named_as_typed(plain, words):
    with pytest.raises(ParameterError, match=words[0]):
        parsed(*words)


def test_the_book_shows_the_tables_that_the_declarations_make(tmp_path):
    page = onboard_page(tmp_path)
    sources, sinks_ = page.index("| `--camera` | |"), page.index("| `--output` | |")
    assert sources < page.index("| `--laps` | `1` |") < sinks_
    assert sinks_ < page.index("| `udpout:HOST:PORT` |") < page.index("| `--origin` |")
