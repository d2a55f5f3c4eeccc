"""Kept records have the keys of today."""

from __future__ import annotations

import copy
import json

import pytest
from conftest import ROOT
from renamed_records import renamed


@pytest.mark.parametrize(
    "path", sorted((ROOT / "data" / "reference").glob("*.json")), ids=lambda p: p.stem
)
def test_no_kept_record_has_a_key_of_before(path):
    record = json.loads(path.read_text())
    if "experiment" in record:
        assert renamed(copy.deepcopy(record)) == record


def test_keys_are_renamed_below_any_name():
    old = {"experiment": "fine", "values": {"floors": {"a": {"askew": 1}, "b": {"askew": 2}}}}
    new = {"a": {"tilt_bias": 1}, "b": {"tilt_bias": 2}}
    assert renamed(old)["values"]["floors"] == new
