"""Findings: one sentence a page, its numbers and its verdicts from the record alone."""

import importlib
import re

import pytest
from conftest import ROOT
from jinja2 import UndefinedError
from plain_book import Prose

from trexton.base.records import Record
from trexton.companion.build import notebook
from trexton.companion.build.notebook import Given
from trexton.companion.experiments.rates import wilson_interval
from trexton.companion.experiments.registry import EXPERIMENTS, LEDGER
from trexton.companion.wording import apart, beside, fixed, interval, number, percent, times


def entry(middle, low, high):
    return {"value": middle, "low": low, "high": high}


def found(experiment, values, timings=None, series=None, parameters=None):
    record = Record(experiment, "f", parameters or {}, values, series or {}, {}, timings or {})
    said = importlib.import_module(f"trexton.companion.experiments.{experiment}").finding(record)
    return plain(said)


def plain(said):
    """What a page says first, as it is, once it is plain enough to be read at a glance."""
    faults = Prose("finding", [said], []).faults()
    assert not [fault for fault in faults if fault[0].isdigit()], faults  # sentences, paragraphs
    assert ";" not in said
    return said


def test_findings_of_the_long_runs_are_plain():
    for path in (ROOT / "data" / "reference").glob("*.json"):
        if path.stem in EXPERIMENTS:
            module = importlib.import_module(f"trexton.companion.experiments.{path.stem}")
            plain(module.finding(Record.load(path)))


def test_every_experiment_says_what_it_found_at_the_top_of_its_page():
    for name in EXPERIMENTS.keys() - {LEDGER}:
        assert importlib.import_module(f"trexton.companion.experiments.{name}").finding.__doc__, (
            name
        )
        text = (ROOT / "notebooks" / f"{name}.md").read_text()
        assert text.count("page.finding(") == 1, name
        assert text.index("page.finding(") < text.index("page.show("), name


def mocap(error, knn, lag_cm, within):
    return {
        "filter": {"mean_cm": entry(error, error - 10, error + 10)},
        "knn": {"mean_cm": entry(knn, knn, knn)},
        "lag": {"s": 1.92, "error_cm": lag_cm},
        "spread": {"within_two": entry(within, within, within)},
    }


def test_the_filter_that_trails_and_is_too_sure():
    text = found("mocap_training", mocap(102, 48.4, 68, 0.234))
    assert "102 [92, 112] cm" in text and "2.1 times as much as" in text
    assert "trails the vehicle by 1.92 s" in text
    assert "covers 23 % of the errors, and should cover 95 %" in text


def test_the_same_words_are_not_said_of_a_filter_that_is_right():
    text = found("mocap_training", mocap(20, 40, 19, 0.951))
    assert "50 % of the plain mean" in text and "trails" not in text
    assert "covers 95 % of the errors, as it should" in text


def homography(**maps):
    return {name: {"mean_cm": entry(v, v - 1, v + 1), "missing": 3.0} for name, v in maps.items()}


def test_homography():
    values = homography(mosaic=3.4) | {"tilt_offset_cm": 3.5}
    text = found("homography_baseline", values)
    assert "3.4 [2.4, 4.4] cm" in text and "in 3 frames" in text
    assert "Tilt moves the image's centre by 3.5 cm" in text
    assert found("homography_baseline", homography(mosaic=3.4)).endswith("in 3 frames.")
    assert found("homography_baseline", {"mosaic": {"missing": 80.0}}) == (
        "A homography finds no frame on the stitched map."
    )


@pytest.mark.parametrize(("noise", "said"), [((6, 5), True), ((6, 68), False)])
def test_jitter_is_named_as_the_cause_only_where_it_orders_the_errors(noise, said):
    names, values = ("filter", "remedy"), {}
    for name, error, width in zip(names, (73, 100), noise, strict=True):
        values |= {
            name: {"mean_cm": entry(error, 0, 0)},
            f"{name}_knn": {"mean_cm": entry(50, 0, 0)},
            f"{name}_process_std_cm": width,
        }
    text = found("homography_training", values)
    assert "73 cm, and of 100 cm where" in text and ("jitter" in text) is said


def test_landing():
    one = {"inside": 13, "landings": 38, "never_triggered": 12, "attempts": 50}
    one |= {"inside_rate": entry(13 / 38, 0.212, 0.501), "trigger_error_cm": {"median": 82.3}}
    one |= {"perfect": {"landings": 46, "inside": 41}, "first_flights": {"inside": 1}}
    text = found("triggered_landing", one)
    for words in ("13 of 50 flights", "25 landed beside it", "12 never", "4 of 6", "here 1.",
                  "brought 41 inside"):  # fmt: skip
        assert words in text
    none = {"landings": 0, "attempts": 3}
    assert found("triggered_landing", none) == "None of 3 flights triggered a landing."


@pytest.mark.parametrize(
    ("train", "test", "words"),
    [
        (
            (0.15, -0.03, 0.28),
            (0.57, 0.31, 0.78),
            ("is not shown to predict", "(0.15 [-0.03, 0.28]) but predicts"),
        ),
        ((0.15, 0.05, 0.28), (0.57, 0.31, 0.78), ("predicts the errors on", "and predicts")),
        ((-0.2, -0.3, -0.1), (0.0, -0.1, 0.1), ("goes against the", "but is not shown")),
    ],
)
def test_map_loss(train, test, words):
    correlations = {
        name: dict(zip(("value", "low", "high"), correlation, strict=True))
        for name, correlation in (("correlation", train), ("test_filter", test))
    }
    text = found("map_loss", {"prediction": correlations})
    assert all(each in text for each in words)


def test_kidnapping():
    def one(rate, after, wrong):
        when = {"median": after} if after else None
        lost = {"wrong_frames_rate": wrong}
        low, high = wilson_interval(round(3 * rate), 3)
        return {"recovered_rate": entry(rate, low, high), "recovery_s": when, "lost": lost}

    plain, augmented, field = one(0.0, None, 0.0), one(1.0, 0.24, 0.32), one(1.0, 0.08, 0.97)
    text = found("kidnapping", {"plain": plain, "augmented": augmented, "field": field})
    assert "filter recovers from 0 % of the kidnappings, and calls 0 %" in text
    assert "it recovers from every kidnapping, after 0.24 s" in text and "calls 32 %" in text
    assert "The field recovers from every kidnapping" in text and "calls 97 %" in text
    always = one(1.0, 0.08, None)  # found in the first frame, each time
    text = found("kidnapping", {"plain": plain, "augmented": augmented, "field": always})
    assert text.endswith("after 0.08 s in the median.")


def test_dictionary_and_mosaic():
    values = {"fit": {"error": 11.9, "effective": 16.7}, "patches": 100_000}
    text = found("texton_dictionary", values, parameters={"textons": 20})
    assert "its nearest texton by 11.9 grey levels" in text
    assert "the 20 count as 16.7 that are equally frequent" in text
    values = {"used": 799, "frames": 800, "anchors": 12}
    values["frame_position_error_cm"] = {"median": 0.53, "p95": 1.22}
    values |= {"links": 990, "rejected_links": 10, "doubt": ""}
    text = found("mosaic", values)
    assert "positions of 12." in text and "0.53 cm off" in text and text.endswith("own position.")
    text = found("mosaic", values | {"links": 41, "rejected_links": 129, "doubt": "it wobbles"})
    assert "129 of 170 links contradict the others: the floor repeats itself" in text
    assert text.endswith("not to be trusted: it wobbles.")


def test_times_and_stages():
    timings = {"total_ms": {"median": 0.45, "low": 0.4, "high": 0.5}}
    text = found("timing", {}, timings)
    assert text.startswith("On this machine a frame takes 0.45 ms from its histogram on")
    timings |= {"histogram_share": 0.5, "homography_ms": {"median": 90, "p99": 100}}
    text = found("timing", {}, timings)
    assert "50 % of it" in text and "200 times as long" in text


def test_settings_and_choices():
    values = {"default": {"axis_mean_cm": entry(66, 60, 70)}, "applies": {"samples": True}}
    text = found("trade_off", values, series={"grid": [1, 2]})
    assert text == "With the paper's settings its filter has an error of 66 cm an axis."
    values |= {
        "fewest_samples_error_cm": entry(68, 0, 0),
        "full_sampling_error_cm": entry(63, 0, 0),
    }
    assert "from 68 cm to 63 cm" in found("trade_off", values, series={"grid": [1]})
    values["tuned_setting"] = {"particles": 400, "neighbors": 3, "samples": None}
    values |= {"tuned": {}, "tuned_error_cm": entry(55, 50, 60)}
    text = found("trade_off", values, series={"grid": [1, 2]})
    assert "Of 2 settings a replay of the training flight chooses" in text
    assert "400 particles, k = 3, all samples, with 55 [50, 60] cm" in text
    values["applies"]["samples"] = False
    assert "400 particles, k = 3, with" in found("trade_off", values, series={"grid": [1]})
    variants = {
        "paper": {"label": "as the paper says", "mean_cm": entry(99, 83, 120)},
        "motion_25": {"label": "noise of 25 cm", "mean_cm": entry(46, 37, 56)},
        "mean": {"label": "the mean", "mean_cm": entry(101, 85, 122)},
    }
    text = found("choices", {"variants": variants})
    assert "Of 2 choices 1 differ beyond chance" in text and "in hindsight" in text
    assert "noise of 25 cm, with 46 [37, 56] cm" in text


def test_numbers_as_words():
    assert [number(v) for v in (1234.5, 1234, 101.7, 48.39, 0.0578, 2.0)] == (
        ["1,230", "1,234", "102", "48.4", "0.058", "2"]
    )
    assert [percent(v) for v in (0.342, 1.0, 0.0, 0.018, 0.05)] == (
        ["34 %", "100 %", "0 %", "1.8 %", "5 %"]
    )
    assert percent(entry(0.05, 0.018, 0.5)) == "5 % [1.8, 50]"
    assert percent(entry(0.0, 0.0, 0.0)) == "0 %"
    assert percent(entry(0.9, None, None)) == "90 %"  # of a single floor
    assert number(None) == fixed(None, 2) == "–"
    said = ["62 % of", "about as much as", "1.2 times as much as", "twice as much as"]
    assert [beside(v) for v in (0.62, 1.04, 1.2, 2.0)] == said
    assert [times(v) for v in (2.02, 2.1, 31.7)] == ["twice", "2.1 times", "32 times"]
    assert interval(entry(1, 0.5, 2)) == "1 [0.5, 2]"
    assert apart(entry(1, 0, 2), entry(4, 3, 5)) and not apart(entry(1, 0, 3), entry(4, 3, 5))
    assert not re.search(r"\d\.\d{4}", interval(entry(0.123456, 0.1, 0.2), "cm"))


def test_a_page_says_what_its_record_says(tmp_path):
    values = {"filter": {"mean_cm": entry(102, 85, 122)}, "pages": 3}
    record = Record("mocap_training", "f", {"samples": 400}, values, timings={"step_s": 0.5})
    parameters = importlib.import_module(
        "trexton.companion.experiments.mocap_training"
    ).Parameters()
    page = notebook.Page(record, Given("f", None, str(tmp_path), parameters))
    text = "{{ filter.mean_cm | span }} of {{ parameters.samples }}, {{ timings.step_s }}, {{ x }}"
    assert page.say(text, x=7).data == "102 [85, 122] of 400, 0.5, 7"
    with pytest.raises(UndefinedError, match="moon"):
        page.say("{{ moon }}")
    record.values.update(mocap(102, 48.4, 68, 0.234))
    assert page.finding().data.startswith(
        '<p class="finding">The paper&#x27;s filter has an error of'
    )
