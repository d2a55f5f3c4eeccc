"""Features have names: maps and flights of others, or in another order, are refused."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import small_flight

from trexton.base.errors import FlightError, ParameterError
from trexton.cli.main import main
from trexton.companion.build.flight_pairs import load_pair
from trexton.flights.flight import Flight
from trexton.flights.folder import read_flight
from trexton.flights.importing import import_flight
from trexton.flights.writing import write_flight
from trexton.localization.localizer import Localizer
from trexton.localization.map_files import load_map
from trexton.localization.renewal import renewed

SENSORS = "mx", "my", "mz", "light"


def table(path, names=SENSORS, seed=0):
    """A walk to and fro, with what sensors of these names sense on it."""
    rng = np.random.default_rng(seed)
    x, y = np.cumsum(rng.normal(0, 0.2, (2, 120)), axis=1)
    sensed = {name: np.sin(x * n + y) + 0.1 * seed for n, name in enumerate(SENSORS, 1)}
    sensed["aux"] = np.cos(y)
    columns = {"x": x, "y": y} | {name: sensed[name] for name in names}
    rows = [",".join(map(str, row)) for row in zip(*columns.values(), strict=True)]
    path.write_text("\n".join([",".join(columns), *rows]))
    return path


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A folder with the flight ``S`` and the map ``M.npz`` of it."""
    folder = tmp_path_factory.mktemp("named")
    import_flight(table(folder / "s.csv"), folder / "S", kind="features")
    assert main(["train", str(folder / "S"), "-o", str(folder / "M.npz"), "--method", "paper"]) == 0
    return folder


def test_names_are_written_and_read_again(trained, tmp_path):
    flight = read_flight(trained / "S")
    assert flight.feature_names == SENSORS
    assert (trained / "S" / "histograms.csv").read_text().startswith("frame,mx,my,mz,light\n")
    again = read_flight(write_flight(flight, tmp_path / "again"))
    assert again.data_hash == flight.data_hash
    assert again.data_hash != replace(flight, feature_names=()).data_hash
    assert load_map(trained / "M.npz").feature_names == list(SENSORS)


@pytest.mark.parametrize(
    "names, said",
    [
        (("mx", "my", "aux", "light"), "feature 3 'aux' where feature 3 'mz'"),
        (("my", "mx", "mz", "light"), "feature 1 'my' where feature 1 'mx'"),
        (("mx", "my", "mz"), "3 features a frame where 4 features"),
    ],
)
def test_other_features_fly_no_map_test_none_and_renew_none(trained, tmp_path, capsys, names, said):
    import_flight(table(tmp_path / "w.csv", names, seed=1), tmp_path / "W", kind="features")
    assert main(["onboard", str(trained / "M.npz"), "--camera", str(tmp_path / "W")]) == 1
    assert said in capsys.readouterr().err
    with pytest.raises(FlightError, match=said):
        load_pair(trained / "S", tmp_path / "W")
    rng = np.random.default_rng(0)
    with pytest.raises(FlightError, match=said):
        renewed(load_map(trained / "M.npz"), read_flight(tmp_path / "W"), rng=rng)


def test_names_asked_for_bring_them_in_order(trained, tmp_path, capsys):
    source = table(tmp_path / "w.csv", ("aux", "my", "mx", "mz", "light"), seed=1)
    chosen = {"names": ",".join(SENSORS)}
    flight, _ = import_flight(source, tmp_path / "W", kind="features", settings=chosen)
    assert flight.feature_names == SENSORS
    assert main(["onboard", str(trained / "M.npz"), "--camera", str(tmp_path / "W")]) == 0
    log = tmp_path / "log.csv"
    readings = (f"{stamp},b{n % 2},{-60 - n},1,1\n" for n, stamp in enumerate(range(100, 104)))
    log.write_text("stamp,source,value,x,y\n" + "".join(readings))
    beacons = {"names": "b3,b1,b0"}
    flight, _ = import_flight(log, tmp_path / "B", settings=beacons)
    assert flight.feature_names == ("b3", "b1", "b0")
    assert (flight.histograms[:, 0] == -100).all() and (flight.histograms[1:, 1:] > -100).all()


def test_features_without_names_are_taken_as_they_come(trained):
    """As flights of earlier versions have them, and maps."""
    flight = replace(read_flight(trained / "S"), feature_names=())
    texton_map = load_map(trained / "M.npz")
    assert load_pair(trained / "S", write_flight(shifted(flight), trained / "unnamed"))
    old = replace(texton_map, provenance={**texton_map.provenance, "features": []})
    assert len(renewed(old, shifted(flight), rng=np.random.default_rng(0))[0].positions) > 120
    assert Localizer(old, rng=np.random.default_rng(0)).step(flight.histograms[0]) is not None


def shifted(flight: Flight) -> Flight:
    return replace(flight, position=flight.position + 0.01)


@pytest.mark.parametrize("names", [("a", "b"), ("a", "b", "c", "c"), ("a", "b", "c", "frame")])
def test_names_that_name_no_column_are_refused(trained, names):
    with pytest.raises(FlightError, match="give one for each, all different"):
        replace(read_flight(trained / "S"), feature_names=names)


def test_names_of_networks_need_no_care(tmp_path):
    """Whatever people call them, the folder is read as it was written."""
    log = tmp_path / "log.csv"
    names = ['"Tom; Ann"', "café 5 GHz", "#1", "aa:bb:cc", '"comma, too"']
    rows = [f"{100 + n / 10},{name},{-50 - n},1,{n}\n" for n, name in enumerate(3 * names)]
    log.write_text("stamp,source,value,x,y\n" + "".join(rows))
    flight, _ = import_flight(log, tmp_path / "flight")
    again = read_flight(tmp_path / "flight")
    assert len({*again.feature_names}) == 5 and again.feature_names == flight.feature_names
    assert again.data_hash == flight.data_hash


def test_names_that_are_cleaned_to_one_are_refused(tmp_path):
    log = tmp_path / "log.csv"
    for names in (("AP 1", "AP\t1"), ("frame", "b")):
        rows = [f"{100 + n / 10},{names[n % 2]},{-50 - n},1,{n}" for n in range(20)]
        log.write_text("\n".join(["stamp,source,value,x,y", *rows]))
        with pytest.raises(FlightError, match="two features are called alike, or one 'frame'"):
            import_flight(log, tmp_path / "flight")
    source = table(tmp_path / "w.csv")
    with pytest.raises(FlightError, match="two features are called alike"):
        import_flight(source, tmp_path / "f", kind="features", settings={"names": "mx,mx"})
    with pytest.raises(FlightError, match="x tell place or time: no features"):
        import_flight(source, tmp_path / "f", kind="features", settings={"names": "mx,x"})


def test_beacons_called_as_columns_without_names_keep_theirs(tmp_path):
    log = tmp_path / "log.csv"
    rows = [f"{100 + n / 10},t{1 + n % 3},{-50 - n},1,{n}" for n in range(21)]
    log.write_text("\n".join(["stamp,source,value,x,y", *rows]))
    import_flight(log, tmp_path / "flight")
    assert read_flight(tmp_path / "flight").feature_names == ("t1", "t2", "t3")


def test_a_map_without_names_takes_those_of_a_renewal(trained):
    texton_map, flight = load_map(trained / "M.npz"), read_flight(trained / "S")
    old = replace(texton_map, provenance={**texton_map.provenance, "features": []})
    rng = np.random.default_rng(0)
    new, _ = renewed(old, replace(flight, position=flight.position + 0.05), rng=rng)
    assert new.feature_names == list(SENSORS)


def test_a_copy_with_rounded_places_is_a_copy(trained):
    flight, rng = read_flight(trained / "S"), np.random.default_rng(0)
    rounded = replace(flight, name="again", position=flight.position.round(2))
    with pytest.raises(ParameterError, match="frames of 'again' are in the map"):
        renewed(load_map(trained / "M.npz"), rounded, rng=rng)
    with pytest.raises(FlightError, match="are those it would be trained on"):
        load_pair(trained / "S", write_flight(rounded, trained / "again"))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"frame": np.r_[:5, 2, 6:40].astype(np.uint32)}, "frame 2 after 4 in row 5"),
        ({"frame": np.r_[-100, 100:139].astype(np.int16), "area": (0, np.inf, 0, 1)}, "the area"),
        ({"histograms": np.full((40, 2), np.nan), "features": "radio"}, "not finite: leave those"),
        ({"histograms": np.tile([2.0, -1.0], (40, 1))}, "a histogram that sums to 1"),
    ],
)
def test_values_that_cannot_be_are_refused(change, words):
    """Unsigned numbers that fall, frequencies below 0 and NaN among features were let pass."""
    with pytest.raises(FlightError, match=words):
        replace(small_flight(), **change)
