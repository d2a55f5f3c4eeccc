"""Headers that cannot be read."""

from trexton.flights.header import read_header


def test_a_number_of_very_many_digits_is_a_sentence(tmp_path):
    (tmp_path / "flight.toml").write_text("format = " + "9" * 5000)
    header, faults = read_header(tmp_path / "flight.toml")
    assert header is None and "not valid TOML" in faults[0]
