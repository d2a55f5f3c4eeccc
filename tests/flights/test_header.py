"""Headers that cannot be read."""

import pytest

from trexton.base.errors import ParameterError
from trexton.companion.build.sweep import read_plan
from trexton.flights.header import read_header


@pytest.mark.parametrize("number", ["9" * 5000, "0x" + "f" * 50_000, "[0b" + "1" * 50_000 + "]"])
def test_a_number_of_very_many_digits_is_a_sentence(number, tmp_path):
    (tmp_path / "flight.toml").write_text(f"format = {number}")
    with pytest.raises(ParameterError, match="no readable plan"):
        read_plan(tmp_path / "flight.toml")
    header, faults = read_header(tmp_path / "flight.toml")
    assert header is None and "not valid TOML" in faults[0]


def test_a_name_is_one_line(tmp_path):
    (tmp_path / "flight.toml").write_text('name = "a\\nb: usable"\n')
    assert (
        "name is 'a\\nb: usable': expected text of one line"
        in read_header(tmp_path / "flight.toml")[1][0]
    )
