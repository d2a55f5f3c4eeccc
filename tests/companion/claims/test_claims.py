"""The ledger: each rule by hand-made cases, and the tables it reads."""

import json

import numpy as np
import pytest
from conftest import mocap_record

from trexton.base.errors import ParameterError, TrextonError
from trexton.base.records import Record
from trexton.companion.claims.ledger import (
    Claim,
    Finding,
    count_verdicts,
    judge,
    judge_all,
    load_claims,
    load_records,
    write_ledger,
)
from trexton.companion.claims.page import claims_html, counts_html, filters_html
from trexton.companion.claims.rules import VERDICTS, Quantity
from trexton.companion.experiments.printed import published
from trexton.companion.experiments.registry import EXPERIMENTS

REPRODUCED, DIRECTION, BETTER, INCONCLUSIVE, FAILED, CONSTRUCTED, UNTESTABLE = VERDICTS


def claim(kind, ours="mosaic:q", **fields):
    if kind == "order":
        ours = None
    return Claim(
        id="c",
        place="somewhere",
        text="a claim",
        kind=kind,
        experiment="mosaic",
        ours=ours,
        **fields,
    )


def records(**values):
    return {"mosaic": Record(experiment="mosaic", flight="f", parameters={}, values=values)}


def interval(value, low, high):
    return {"value": value, "low": low, "high": high}


@pytest.mark.parametrize(
    ("ours", "printed", "verdict"),
    [
        (interval(50, 40, 61), 60, REPRODUCED),  # inside the interval, within a quarter
        (interval(50, 40, 130), 60, INCONCLUSIVE),  # the interval reaches beyond twice
        (interval(50, 29, 61), 60, INCONCLUSIVE),  # and below half
        (interval(40, 32, 61), 60, INCONCLUSIVE),  # inside, but a third away
        (interval(50, 49, 51), 60, DIRECTION),  # near, but excluded
        (interval(44, 43, 46), 60, BETTER),
        (interval(44, 43, 61), 60, INCONCLUSIVE),
        (interval(76, 70, 80), 60, FAILED),
        (interval(2, 1, 3), 60, BETTER),
        (24, 50, BETTER),
        (0, -60, FAILED),
        (interval(0, -1, 1), 0, INCONCLUSIVE),
    ],
)
def test_the_rule_for_a_printed_value(ours, printed, verdict):
    assert judge(claim("value", printed=printed, better="less"), records(q=ours)).verdict == verdict


def test_more_is_better_only_where_the_claim_says_so():
    landing = interval(0.95, 0.9, 0.99)
    assert judge(claim("value", printed=0.6, better="more"), records(q=landing)).verdict == BETTER
    assert judge(claim("value", printed=0.6, better="less"), records(q=landing)).verdict == FAILED
    assert judge(claim("value", printed=0.6), records(q=landing)).verdict == FAILED
    worse = judge(
        claim("value", printed=2 / 3, better="more"), records(q=interval(0.34, 0.21, 0.5))
    )
    assert worse.verdict == FAILED  # half as often is no direction


def test_how_much_better_is_said():
    finding = judge(claim("value", printed=31, better="less"), records(q=interval(2.2, 1.8, 2.9)))
    assert finding.reason == "14 times better"
    finding = judge(claim("value", printed=61, better="less"), records(q=interval(32, 25, 40)))
    assert finding.reason == "better by 48 %"


@pytest.mark.parametrize(
    ("kind", "ours", "bound", "verdict"),
    [
        ("below", interval(8, 5, 9), 10, REPRODUCED),
        ("below", interval(8, 5, 11), 10, INCONCLUSIVE),
        ("below", interval(12, 5, 20), 10, INCONCLUSIVE),
        ("below", interval(12, 11, 20), 10, FAILED),
        ("above", interval(12, 11, 20), 10, REPRODUCED),
        ("above", interval(12, 9, 20), 10, INCONCLUSIVE),
        ("above", interval(9, 5, 9.5), 10, FAILED),
        ("exact", 301625, 301625, REPRODUCED),
        ("exact", 301624, 301625, FAILED),
    ],
)
def test_the_rules_for_bounds_and_counts(kind, ours, bound, verdict):
    assert judge(claim(kind, bound=bound), records(q=ours)).verdict == verdict


@pytest.mark.parametrize(
    ("less", "greater", "verdict"),
    [
        (interval(1, 0.5, 1.5), interval(3, 2, 4), REPRODUCED),
        (interval(1, 0.5, 2.5), interval(3, 2, 4), DIRECTION),
        (interval(2.1, 0.5, 2.5), interval(3, 2, 4), INCONCLUSIVE),
        (interval(3, 2, 4), interval(1, 0.5, 1.5), FAILED),
        (interval(3, 2, 4), interval(1, 0.5, 3.5), INCONCLUSIVE),
        (2, 2, INCONCLUSIVE),
    ],
)
def test_the_rule_for_an_order(less, greater, verdict):
    order = claim("order", less="mosaic:a", greater="mosaic:b")
    assert judge(order, records(a=less, b=greater)).verdict == verdict


def test_somewhat_more_ends_at_twice():
    order = claim("order", less="mosaic:a", greater="mosaic:b", at_most_times=2)
    assert judge(order, records(a=10, b=19)).verdict == REPRODUCED
    finding = judge(order, records(a=10, b=320))
    assert finding.verdict == FAILED and finding.reason.startswith("32 times as much")


def test_what_cannot_fail_is_counted_apart_and_still_checked():
    known = claim("exact", printed=4, by_construction="it is drawn that often")
    finding = judge(known, records(q=4))
    assert finding.verdict == CONSTRUCTED and finding.reason == "it is drawn that often"
    assert judge(known, records(q=5)).verdict == FAILED


def test_what_is_missing_is_not_testable_and_says_so_in_a_readers_words():
    needy = claim("value", ours="trade_off:a.b", printed=1, needs="camera images")
    finding = judge(needy, {})
    assert finding.verdict == UNTESTABLE
    assert finding.reason == (
        "“Speed against accuracy” was not run on this flight; the test needs camera images"
    )
    ran = {"trade_off": Record("trade_off", "f", {}, {"a": {}})}
    assert judge(needy, ran).reason == (
        "nothing of the kind happened on this flight; the test needs camera images"
    )
    empty = judge(claim("value", printed=1), records(q=None))
    assert empty.verdict == UNTESTABLE and "nothing of the kind" in empty.reason
    told = judge(claim("untestable", reason="no drone"), records(q=3))
    assert told.verdict == UNTESTABLE and told.reason == "no drone" and told.ours.value == 3


def test_a_path_that_no_record_has_is_an_error_and_no_verdict():
    with pytest.raises(ParameterError, match="'mosaic:q', which the record of flight 'f' does not"):
        judge(claim("value", printed=1), records(p=3))


def test_timings_are_found_where_values_have_nothing():
    spread = {"median": 5, "low": 4, "high": 5.5, "p99": 9}
    for found in (5, spread):
        record = Record("mosaic", "f", {}, {}, timings={"q": found})
        judged = judge(claim("below", bound=6), {"mosaic": record})
        assert judged.verdict == REPRODUCED and judged.ours.value == 5


def test_the_papers_claims_are_many_and_well_formed():
    claims = load_claims()
    assert len(claims) >= 25 and len({claim.id for claim in claims}) == len(claims)
    for entry in claims:
        assert entry.place and entry.text
        assert entry.measure or entry.kind == "untestable", entry.id
        assert entry.bound is None or entry.printed is None, entry.id  # ours is never "printed"
        assert entry.experiment == "none" or entry.experiment in EXPERIMENTS, entry.id
        # A page can judge its own claims only with records that were made before it.
        after = {
            entry.experiment,
            *(EXPERIMENTS[entry.experiment].after if entry.experiment != "none" else ()),
        }
        assert {reference.split(":")[0] for reference in entry.references} <= after, entry.id


def test_every_number_printed_in_a_table_of_the_paper_is_a_claim():
    covered = {entry.printed for entry in load_claims()}
    for experiment in ("homography_baseline", "mocap_training", "homography_training"):
        for key in ("error_cm", "std_cm"):
            assert {f"{experiment}.{key}.{axis}" for axis in "xy"} <= covered
            assert set(published()[experiment][key]) == {"x", "y"}


def test_all_times_of_the_papers_computers_fall_under_one_rule():
    for entry in load_claims():
        if entry.printed is not None and entry.unit in ("ms", "Hz"):
            assert entry.kind == "untestable", entry.id


def test_faulty_claims_are_refused_when_they_are_loaded(tmp_path):
    with pytest.raises(ParameterError, match="expected one of"):
        claim("roughly")
    with pytest.raises(ParameterError, match="expected EXPERIMENT:PATH"):
        claim("value", ours="moon:q")
    with pytest.raises(ParameterError, match="has 1 references"):
        Claim("c", "p", "t", "order", less="mosaic:q")
    table = '[[claim]]\nid = "a"\nplace = "p"\ntext = "t"\nexperiment = "mosaic"\n'
    for rest, message in (
        ('kind = "value"\nours = "mosaic:q"\nprinted = "nowhere.at_all"', "expected a number"),
        (
            'kind = "value"\nours = "mosaic:q"\nprinted = "mocap_training.place"',
            "expected a number",
        ),
        ('kind = "above"\nours = "mosaic:q"', "neither a bound nor a printed value"),
    ):
        (tmp_path / "claims.toml").write_text(table + rest)
        with pytest.raises(ParameterError, match=message):
            load_claims(tmp_path / "claims.toml")


def test_the_tables_keep_their_columns_apart_and_offer_filters():
    bound = claim("below", bound=10, measure="the slope", unit="cm")
    printed = claim("value", printed=61, measure="the error", better="less")
    rows = judge_all({"cyberzoo": records(q=interval(8, 5, 9))}, [bound, printed])
    first, second = claims_html(rows).split("</tr>")[1:3]
    assert '<td data-label="Printed"></td>' in first and "at most 10 cm" in first
    assert '<td data-label="Printed">61</td>' in second
    assert 'data-verdicts="better than the paper"' in second and "8 <small>[5, 9]</small>" in second
    assert "CyberZoo flight (real, unit in doubt)" in counts_html(rows)
    assert '<th scope="row"><span class="verdict reproduced">' in counts_html(rows)
    assert "2 of 2 claims" in filters_html(rows) and "hidden>" in filters_html(rows)


def test_other_data_than_the_flight_stand_at_their_value():
    walks = claim("below", bound=10, measure="the slope", data="Walks")
    both = [walks, claim("value", printed=61, measure="the error")]
    rows = [(each, [Finding("cyberzoo", REPRODUCED, Quantity(8, 5, 9))]) for each in both]
    ledger, page = claims_html(rows), claims_html(rows[:1])
    assert ledger.count("Walks") == 1 and page.count("Walks") == 2


def test_the_ledger_is_written_from_records(tmp_path):
    for flight, value in (("a", 61.0), ("b", np.nan)):
        mocap_record(flight, value).save(tmp_path / flight)
    rows = write_ledger(tmp_path)
    stored = json.loads((tmp_path / "claims.json").read_text())
    entry = next(entry for entry in stored["claims"] if entry["id"] == "mocap-x")
    assert [finding["verdict"] for finding in entry["findings"]] == [REPRODUCED, UNTESTABLE]
    assert entry["printed"] == 61
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


def test_a_verdict_that_turns_when_parts_are_exchanged_says_so():
    held = records(q=interval(50, 40, 61), exchanged={"q": interval(90, 80, 99)})
    finding = judge(claim("value", printed=60), held)
    assert finding.verdict == REPRODUCED
    assert finding.reason == "with training and test exchanged: not reproduced (90 [80, 99])"
    both = records(q=interval(50, 40, 61), exchanged={"q": interval(52, 40, 63)})
    assert not judge(claim("value", printed=60), both).reason
    other = records(q=interval(50, 40, 61), exchanged={"else": interval(90, 80, 99)})
    assert judge(claim("value", printed=60), other).reason == "judged one way only"


def test_too_few_groups_of_trials_test_nothing():
    rate = interval(1.0, 0.4, 1.0) | {"clusters": 3}
    finding = judge(claim("above", bound=0.9), records(q=rate))
    assert finding.verdict == UNTESTABLE and "3 independent groups" in finding.reason
    many = interval(1.0, 0.96, 1.0) | {"clusters": 100}
    assert judge(claim("above", bound=0.9), records(q=many)).verdict == REPRODUCED
