"""The ledger: each rule by hand-made cases, and the tables it reads."""

import json

import numpy as np
import pytest

from trexton.claims import (
    VERDICTS,
    Claim,
    Finding,
    count_verdicts,
    judge,
    judge_all,
    load_claims,
    load_records,
    write_ledger,
)
from trexton.errors import ParameterError, TrextonError
from trexton.experiments import EXPERIMENTS
from trexton.paper import published
from trexton.records import Record

REPRODUCED, DIRECTION, FAILED, UNTESTABLE = VERDICTS


def claim(kind, **fields):
    return Claim(id="c", place="somewhere", text="a claim", kind=kind, experiment="e", **fields)


def records(**values):
    return {"e": Record(experiment="e", flight="f", parameters={}, values=values)}


def interval(median, low, high):
    return {"median": median, "low": low, "high": high}


@pytest.mark.parametrize(
    ("kind", "ours", "target", "verdict"),
    [
        ("value", interval(50, 40, 61), 60, REPRODUCED),  # inside the interval
        ("value", interval(50, 49, 51), 60, REPRODUCED),  # within a quarter of ours
        ("value", interval(50, 49, 51), 63, DIRECTION),
        ("value", interval(50, 49, 51), 100, DIRECTION),
        ("value", interval(50, 49, 51), 101, FAILED),
        ("value", 50, 24, FAILED),
        ("value", -50, 60, FAILED),
        ("value", 0, 60, FAILED),
        ("below", interval(8, 5, 9), 10, REPRODUCED),
        ("below", interval(8, 5, 11), 10, DIRECTION),
        ("below", interval(12, 5, 20), 10, FAILED),
        ("above", interval(12, 11, 20), 10, REPRODUCED),
        ("above", interval(12, 9, 20), 10, DIRECTION),
        ("above", interval(9, 5, 20), 10, FAILED),
        ("exact", 301625, 301625, REPRODUCED),
        ("exact", 301624, 301625, FAILED),
    ],
)
def test_rules_for_one_quantity(kind, ours, target, verdict):
    assert judge(claim(kind, ours="e:q", published=target), records(q=ours)).verdict == verdict


@pytest.mark.parametrize(
    ("less", "greater", "verdict"),
    [
        (interval(1, 0.5, 1.5), interval(3, 2, 4), REPRODUCED),
        (interval(1, 0.5, 2.5), interval(3, 2, 4), DIRECTION),
        (interval(3, 2, 4), interval(1, 0.5, 1.5), FAILED),
        (2, 2, FAILED),
    ],
)
def test_the_rule_for_an_order(less, greater, verdict):
    assert (
        judge(claim("order", less="e:a", greater="e:b"), records(a=less, b=greater)).verdict
        == verdict
    )


def test_what_is_missing_is_not_testable_and_says_so():
    finding = judge(claim("value", ours="e:a.b", published=1), records(a={}))
    assert finding.verdict == UNTESTABLE and "e a.b" in finding.reason
    assert judge(claim("order", less="e:a", greater="other:b"), records(a=1)).verdict == UNTESTABLE
    assert judge(claim("value", ours="e:a", published=1), records(a=None)).verdict == UNTESTABLE
    told = judge(claim("untestable", ours="e:a", reason="no drone"), records(a=3))
    assert told.verdict == UNTESTABLE and told.reason == "no drone" and told.ours.value == 3


def test_timings_are_found_where_values_have_nothing():
    record = Record(experiment="e", flight="f", parameters={}, values={}, timings={"q": 5})
    assert judge(claim("below", ours="e:q", published=6), {"e": record}).verdict == REPRODUCED


def test_the_papers_claims_are_many_and_well_formed():
    claims = load_claims()
    assert len(claims) >= 25 and len({claim.id for claim in claims}) == len(claims)
    for entry in claims:
        references = [
            reference for reference in (entry.ours, entry.less, entry.greater) if reference
        ]
        assert entry.place and entry.text
        assert entry.published_value is not None or entry.kind in ("order", "untestable"), entry.id
        assert (
            len(references) == 2
            if entry.kind == "order"
            else len(references) == 1 or entry.kind == "untestable"
        ), entry.id
        assert entry.kind != "untestable" or entry.reason, entry.id
        assert entry.experiment == "none" or entry.experiment in EXPERIMENTS, entry.id
        assert all(reference.split(":")[0] in EXPERIMENTS for reference in references), entry.id
        # A page can judge its own claims only with records that were made before it.
        after = {
            entry.experiment,
            *(EXPERIMENTS[entry.experiment].after if entry.experiment != "none" else ()),
        }
        assert {reference.split(":")[0] for reference in references} <= after, entry.id


def test_every_number_printed_in_a_table_of_the_paper_is_a_claim():
    covered = {entry.published for entry in load_claims()}
    for experiment in ("homography_baseline", "mocap_training", "homography_training"):
        for key in ("error_cm", "std_cm"):
            assert {f"{experiment}.{key}.{axis}" for axis in "xy"} <= covered
            assert set(published()[experiment][key]) == {"x", "y"}


def test_unknown_kinds_and_places_are_refused():
    with pytest.raises(ParameterError, match="expected one of"):
        claim("roughly")
    with pytest.raises(ParameterError, match="does not have"):
        claim("value", published="nowhere.at_all").published_value  # noqa: B018


def test_the_ledger_is_written_from_records(tmp_path):
    for flight, value in (("a", 61.0), ("b", np.nan)):
        Record("mocap_training", flight, {}, {"filter": {"error_cm_x": value}}).save(
            tmp_path / flight
        )
    rows = write_ledger(tmp_path)
    stored = json.loads((tmp_path / "claims.json").read_text())
    entry = next(entry for entry in stored["claims"] if entry["id"] == "mocap-x")
    assert [finding["verdict"] for finding in entry["findings"]] == [REPRODUCED, UNTESTABLE]
    assert entry["published"] == 61
    assert stored["counts"] == count_verdicts(rows)
    assert sum(stored["counts"]["a"].values()) == len(load_claims())
    assert load_records(tmp_path).keys() == {"a", "b"}  # the ledger itself is no record
    before = (tmp_path / "claims.json").read_bytes()
    write_ledger(tmp_path)
    assert (tmp_path / "claims.json").read_bytes() == before


def test_a_folder_without_records_is_one_clear_error(tmp_path):
    with pytest.raises(TrextonError, match="no records"):
        write_ledger(tmp_path)


def test_findings_keep_the_order_of_flights():
    rows = judge_all({"b": {}, "a": {}}, [claim("untestable", reason="r")])
    assert [finding.flight for finding in rows[0][1]] == ["a", "b"]
    assert isinstance(rows[0][1][0], Finding)
