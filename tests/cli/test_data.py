"""Public data: taken from a cache, a folder or the net, and never without their hash."""

from __future__ import annotations

import functools
import hashlib
import http.server
import shutil
import threading

import numpy as np
import pytest

from trexton.base.cache import repository_root
from trexton.base.errors import DataError, ParameterError
from trexton.cli import main as cli
from trexton.flights import registry as data
from trexton.flights.folder import read_flight

TABLE = "mat_train_hists_texton.csv"


@pytest.fixture
def server(tmp_path):
    """A folder and the address at which this machine serves it."""
    folder = tmp_path / "served"
    folder.mkdir()
    quiet = type("Quiet", (http.server.SimpleHTTPRequestHandler,), {"log_message": lambda *_: None})
    with http.server.ThreadingHTTPServer(
        ("127.0.0.1", 0), functools.partial(quiet, directory=str(folder))
    ) as web:
        threading.Thread(target=web.serve_forever, daemon=True).start()
        yield folder, f"http://127.0.0.1:{web.server_port}"
        web.shutdown()


@pytest.fixture
def toy(server, tmp_path, monkeypatch):
    """A registry of one small file, served by `server`, and an empty data folder."""
    folder, address = server
    (folder / "toy.bin").write_bytes(b"public bytes")
    entry = {
        "key": "toys/toy.bin",
        "url": f"{address}/toy.bin",
        "sha256": hashlib.sha256(b"public bytes").hexdigest(),
    }
    monkeypatch.setattr(
        data, "registry", lambda: {"toy": {"title": "a toy", "licence": "none", "files": [entry]}}
    )
    monkeypatch.setenv("TREXTON_DATA", str(tmp_path / "cache"))
    return entry


def test_a_file_is_downloaded_once_and_then_served_from_the_cache(toy, server, tmp_path):
    (path,) = data.locate("toy")
    assert path == tmp_path / "cache" / "toys" / "toy.bin" and path.read_bytes() == b"public bytes"
    (server[0] / "toy.bin").unlink()
    assert data.locate("toy") == [path]
    out = tmp_path / "out"
    for _ in range(2):
        assert data.fetch("toy", out).read_bytes() == b"public bytes"
    (out / "toy.bin").write_bytes(b"of a person")
    with pytest.raises(DataError, match="another file is there: .* --replace"):
        data.fetch("toy", out)
    assert (out / "toy.bin").read_bytes() == b"of a person"
    assert data.fetch("toy", out, replace=True).read_bytes() == b"public bytes"


def test_a_download_with_another_hash_is_refused_and_not_kept(toy, server, tmp_path):
    (server[0] / "toy.bin").write_bytes(b"other bytes")
    with pytest.raises(DataError, match="does not match the known hash"):
        data.locate("toy")
    assert not (tmp_path / "cache" / "toys" / "toy.bin").exists()


def test_a_damaged_cache_is_fetched_again(toy, tmp_path):
    path = tmp_path / "cache" / "toys" / "toy.bin"
    path.parent.mkdir(parents=True)
    path.write_bytes(b"damaged")
    assert data.locate("toy")[0].read_bytes() == b"public bytes"
    path.write_bytes(b"damaged")
    toy["url"] = "http://127.0.0.1:9/toy.bin"
    with pytest.raises(DataError, match="toys/toy.bin is not whole and cannot be fetched"):
        data.locate("toy")


@pytest.mark.parametrize("address", ["http://127.0.0.1:9/toy.bin", None])
def test_without_a_connection_one_sentence_says_what_to_do(toy, server, address, capsys):
    if address is None:
        (server[0] / "toy.bin").unlink()  # 404
    else:
        toy["url"] = address
    assert cli.main(["data", "fetch", "toy", "--out", "unused"]) == 1
    error = capsys.readouterr().err
    assert "cannot be fetched" in error and "TREXTON_DATA" in error and "Traceback" not in error


def test_an_unknown_name_lists_the_known_ones():
    with pytest.raises(DataError, match="the names are cyberzoo, cyberzoo-floor"):
        data.locate("atlantis")


def test_each_entry_of_the_registry_is_whole():
    root = repository_root()
    for entry in data.registry().values():
        assert (
            entry["title"]
            and entry["licence"]
            and (root / "data" / "cards" / entry["card"]).is_file()
        )
        for file in entry["files"]:
            assert file["url"].startswith("https://") and len(file["sha256"]) == 64


def test_the_real_flight_as_a_flight(shared_data, tmp_path, monkeypatch):
    monkeypatch.setenv("TREXTON_DATA", str(shared_data))
    flight = read_flight(data.fetch("cyberzoo", tmp_path / "cz"))
    raw = np.loadtxt(shared_data / "cyberzoo" / TABLE, delimiter=",")
    log = np.loadtxt(
        shared_data / "cyberzoo" / "cyberzoo_pos_optitrack.csv", delimiter=",", skiprows=1
    )
    assert len(flight) == 624 and flight.frame[0] == 1 and not flight.has_images
    for frame in (1, 300, 624):  # row i of either table is frame i
        np.testing.assert_array_equal(flight.histograms[frame - 1], raw[frame])
        np.testing.assert_allclose(flight.position[frame - 1], log[frame, 1:3] / 100)
    assert len(flight.part("train")) == len(flight.part("train_mirrored")) == 325
    assert len(flight.part("test")) == len(flight.part("test_mirrored")) == 299
    assert not set(flight.part("train_mirrored").frame) & set(flight.part("test_mirrored").frame)
    assert np.diff(flight.time) == pytest.approx(0.08)


def test_a_flight_never_replaces_the_files_it_is_made_of(shared_data, tmp_path, monkeypatch):
    raw = tmp_path / "cyberzoo"
    shutil.copytree(shared_data / "cyberzoo", raw)
    monkeypatch.setenv("TREXTON_DATA", str(tmp_path))
    before = sorted(path.name for path in raw.iterdir())
    with pytest.raises(ParameterError, match="is read here"):
        data.fetch("cyberzoo", raw, replace=True)
    assert sorted(path.name for path in raw.iterdir()) == before


def test_a_read_only_complete_cache_is_enough(shared_data, tmp_path, monkeypatch):
    folder = tmp_path / "readonly"
    shutil.copytree(shared_data / "cyberzoo", folder / "cyberzoo")
    monkeypatch.setenv("TREXTON_DATA", str(folder))
    folder.chmod(0o555)
    try:
        assert [path.parent.parent for path in data.locate("cyberzoo")] == [folder, folder]
    finally:
        folder.chmod(0o755)
