"""Headers that cannot be read."""

import time

import pytest

from trexton.base.errors import FlightError
from trexton.companion.build.sweep import read_plan
from trexton.flights.header import read_header


@pytest.mark.parametrize("number", ["9" * 5000, "0x" + "f" * 50_000, "[0b" + "1" * 50_000 + "]"])
def test_a_number_of_very_many_digits_is_a_sentence(number, tmp_path):
    (tmp_path / "flight.toml").write_text(f"format = {number}")
    with pytest.raises(FlightError, match="not valid TOML"):
        read_plan(tmp_path / "flight.toml")
    header, faults = read_header(tmp_path / "flight.toml")
    assert header is None and "not valid TOML" in faults[0]


def test_a_name_is_one_line(tmp_path):
    (tmp_path / "flight.toml").write_text('name = "a\\nb: usable"\n')
    assert (
        "name is 'a\\nb: usable': expected text of one line"
        in read_header(tmp_path / "flight.toml")[1][0]
    )


@pytest.mark.parametrize("part", ["a", '"\\"."', "'.' \t"])
def test_a_key_of_very_many_parts_is_refused_before_it_takes_its_square(part, tmp_path):
    (tmp_path / "flight.toml").write_text(".".join([part] * 100_000) + " = 1")
    started = time.process_time()
    _, faults = read_header(tmp_path / "flight.toml")
    assert "a key has more than 30 parts" in faults[0] and time.process_time() - started < 1


def test_a_long_list_or_text_is_no_key(tmp_path):
    text = 'name = "a"\nsource = "' + "It rained. And it blew. " * 50 + '"\n'
    (tmp_path / "flight.toml").write_text(text + "notes = [" + '"1.5, 2.5", ' * 500 + "]\n")
    assert read_header(tmp_path / "flight.toml")[1] == []


def test_a_split_in_capitals_would_be_read_by_nobody(tmp_path):
    """Its test frames would train."""
    (tmp_path / "flight.toml").write_text('name = "a"\n[split]\nTrain = [0, 9]\nlater = [10, 12]\n')
    (fault,) = read_header(tmp_path / "flight.toml")[1]
    assert "[split] Train is read by nobody: name it train" in fault
