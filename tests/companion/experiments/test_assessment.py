"""Will it work here? Plain words from records, on flights where the answer is known."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from small_loop import make_flight

from trexton.companion.build.small_report import write_report
from trexton.companion.experiments.advice import advice
from trexton.companion.experiments.assessment import (
    Parameters,
    error_shares,
    finding,
    over_the_floor,
    run,
)
from trexton.companion.experiments.style import COLORS


@pytest.fixture(scope="module")
def record():
    return run(make_flight(1), make_flight(2), Parameters())


def test_a_room_that_works_is_said_to(record):
    assert finding(record).startswith("It works here. The mean error of the method `field`")
    errors = record.values["errors"]
    assert errors["field"]["mean_cm"]["value"] < 0.5 * errors["centre"]["mean_cm"]["value"]
    assert any("trexton train loop -o loop.npz --method" in sentence for sentence in advice(record))


def test_the_error_to_expect_is_that_of_the_places_of_the_test():
    train = make_flight(1)
    near = run(train, make_flight(2).select(slice(0, 40)), Parameters()).values["predicted"]
    again = run(train, train.select(slice(0, 40)), Parameters()).values["predicted"]
    assert again["error_cm"] < near["error_cm"]  # where it was learned the field knows more


def test_histograms_that_say_nothing_are_found_out():
    hopeless = run(
        make_flight(1, informative=False), make_flight(2, informative=False), Parameters()
    )
    assert not finding(hopeless).startswith("It works here")
    assert any(sentence.startswith("Repeated texture") for sentence in advice(hopeless))


def test_a_filter_worse_than_its_neighbours_or_the_centre_is_named(record):
    def said(cm):
        errors = record.values["errors"]
        entry = errors["paper"]["mean_cm"]
        changed = errors["paper"] | {"mean_cm": entry | dict.fromkeys(entry, cm)}
        values = record.values | {"errors": errors | {"paper": changed}}
        return [s for s in advice(replace(record, values=values)) if "`paper` is worse" in s]

    centre, knn = (record.values["errors"][n]["mean_cm"]["value"] for n in ("centre", "knn"))
    assert knn < centre and said(0.9 * knn) == []
    assert "the plain mean of its neighbours" in said(knn + 5)[0] and "by 5 cm" in said(knn + 5)[0]
    assert "always guessing the centre: do not fly it" in said(centre + 1)[0]


def test_the_commands_carry_the_settings_that_were_flown(record):
    said = advice(record)[-1]
    assert "--textons" not in said  # histograms have no patches to draw
    assert "onboard" not in said and "a camera needs a training flight of pictures" in said
    limits = record.values["limits"] | {"blurred": 0.0}
    pictures = replace(record, values=record.values | {"limits": limits})
    said = advice(pictures)[-1]
    assert f"--textons 20`, then `trexton onboard {pictures.flight}.npz --samples 400" in said
    assert "looks for better settings." in advice(pictures)[-2]


def test_what_limits_it_is_said_by_its_share(record):
    def said(**limits):
        values = record.values | {"limits": record.values["limits"] | limits}
        return " ".join(advice(replace(record, values=values)))

    plain = said(repeated=0.05, blurred=0.05, gap_m=0.01)
    assert not any(word in plain for word in ("Blur", "Repeated", "Too few", "too short"))
    assert "Blur: 30 %" in said(blurred=0.3)
    assert "too short to tell whether its texture repeats" in said(repeated=None)
    assert "Repeated texture: for 20 %" in said(repeated=0.2)


def test_the_judgement_follows_the_best_method(record):
    def judged(cm):
        errors = record.values["errors"]
        changed = {
            name: entry | {"mean_cm": entry["mean_cm"] | dict.fromkeys(entry["mean_cm"], cm)}
            for name, entry in errors.items()
            if name in record.parameters["methods"].split()
        }
        changed_record = replace(record, values=record.values | {"errors": errors | changed})
        return finding(changed_record) + " ".join(advice(changed_record, "my flights/room"))

    centre = record.values["errors"]["centre"]["mean_cm"]["value"]
    assert judged(0.4 * centre).startswith("It works here")
    assert judged(0.6 * centre).startswith("It works poorly here")
    assert judged(1.1 * centre).startswith("It will not work here")
    assert "`trexton train 'my flights/room' -o loop.npz" in judged(0.4 * centre)
    for hopeless in (1.1 * centre, 0.99 * record.values["errors"]["centre"]["mean_cm"]["high"]):
        assert "No method is worth flying here" in judged(hopeless)
        assert "trexton train" not in judged(hopeless)


def test_places_that_were_never_flown_are_named():
    train = make_flight(1)
    half = train.select(train.position[:, 0] < 0)
    sentences = advice(run(half, make_flight(2), Parameters()))
    assert any(sentence.startswith("Too few frames") for sentence in sentences)


@pytest.mark.parametrize("frames", [18, 40])
def test_short_flights_are_judged_too(frames):
    short = run(make_flight(1, frames=frames), make_flight(2, frames=frames), Parameters())
    assert finding(short).endswith(".") and all(advice(short))


def test_by_a_few_frames_nothing_is_judged(record):
    """Four of a hundred had a position, and it worked."""
    few = replace(record, values=record.values | {"counts": {"train": 120, "test": 4}})
    assert finding(few).startswith("It cannot be judged by 4 test frames")
    said = " ".join(advice(few))
    assert "fly a longer one" in said and "trexton t" not in said


def test_a_test_too_short_to_tell_is_no_failure(record):
    errors = {name: dict(entry) for name, entry in record.values["errors"].items()}
    centre = errors["centre"]["mean_cm"]["value"]
    for method in record.parameters["methods"].split():
        wide = {"value": 0.6 * centre, "low": 0.2 * centre, "high": 2 * centre}
        errors[method]["mean_cm"] = wide
    errors["centre"]["mean_cm"] = {"value": centre, "low": 0.3 * centre, "high": 2 * centre}
    undecided = replace(record, values=record.values | {"errors": errors})
    assert finding(undecided).startswith("It cannot be judged")
    assert "fly a longer one" in " ".join(advice(undecided))


def test_another_origin_or_height_of_the_test_is_named(record):
    series = {name: values for name, values in record.series.items()}
    for name in (*record.parameters["methods"].split(),):
        series[f"{name}_m"] = np.array(series["truth_m"]) + (0.9, -0.5)
    moved = replace(record, series=series)
    assert re.search(r"All positions are off by about x 90\S* cm, y -50", " ".join(advice(moved)))
    limits = record.values["limits"] | {"heights_m": [1.0, 2.0]}
    high = replace(record, values=record.values | {"limits": limits})
    assert "The heights were 100 cm and 200 cm" in " ".join(advice(high))
    assert "The heights" not in " ".join(advice(record))


@pytest.mark.parametrize("train_to", [30, 120])
def test_the_centre_is_the_better_of_two_guesses(train_to):
    """Of a survey of one corner the mean of its places was a bar far too low."""
    test = make_flight(2)
    made = run(make_flight(1).select(slice(0, train_to)), test, Parameters(methods="paper"))
    middle = np.hypot(*test.position.T).mean()
    assert made.values["errors"]["centre"]["mean_cm"]["value"] <= 100 * middle + 1e-6


def test_any_method_has_a_page(tmp_path):
    made = run(make_flight(1), make_flight(2), Parameters(methods="hmm"))
    assert error_shares(made) and over_the_floor(made) and write_report(made, tmp_path / "r.html")


def test_test_frames_without_a_position_are_flown_and_not_judged():
    test = make_flight(2)
    gone = test.position.copy()
    gone[10:40] = np.nan
    partly = run(make_flight(1), replace(test, position=gone), Parameters(methods="paper"))
    assert partly.values["counts"]["test"] == 90 and "predicted" not in partly.series


def test_fields_of_hundreds_of_metres_read_in_metres():
    large = run(make_flight(1, scale=200), make_flight(2, scale=200), Parameters(methods="field"))
    assert " m, against " in finding(large)
    for record in (large, run(make_flight(1), make_flight(2), Parameters(methods="field"))):
        words = " ".join([finding(record), *advice(record)])
        assert len(set(re.findall(r"\d\]? (m|cm)\b", words))) == 1


def test_the_part_of_the_floor_where_it_fails_is_named(record):
    truth = np.array(record.series["truth_m"])
    corner = (truth > 1.3 / 3).all(axis=1)  # of an area from -1.3 to 1.3, in three parts a side
    wrong = truth + np.where(corner, 3.0, 0.1)[:, None]
    errors = record.values["errors"]
    best = min(("paper", "field"), key=lambda name: errors[name]["mean_cm"]["value"])
    other = replace(record, series=record.series | {f"{best}_m": wrong.tolist()})
    (said,) = [line for line in advice(other) if line.startswith("It fails most between")]
    assert "off by 424 cm on average" in said
    assert "x = 43.3 cm and 130 cm, y = 43.3 cm and 130 cm" in said


@pytest.fixture(scope="module")
def report(record, tmp_path_factory):
    """The text of its page."""
    return write_report(record, tmp_path_factory.mktemp("report") / "report.html").read_text()


def test_the_report_plays_the_flight_where_there_is_a_player(record, report, tmp_path):
    page = write_report(record, tmp_path / "report.html", "room/mocap_training-player.html")
    assert '<iframe src="room/mocap_training-player.html"' in page.read_text()
    assert "<iframe" not in report


def test_the_report_is_one_file_that_fetches_nothing(report):
    fetched = re.findall(r"""(?:src|href)="([^"]*)|url\(([^)]*)""", report)
    assert all("".join(address).startswith(("#", "data:image/")) for address in fetched)
    # Two figures, each for pages and for phones.
    assert report.count('role="img" aria-label=') == 4 and "<script" not in report
    assert "always the centre" in report and "<code>field</code>" in report


def test_the_page_has_a_verdict_what_limits_it_and_two_commands(record, tmp_path):
    limits = record.values["limits"] | {"blurred": 0.0}
    pictures = replace(record, values=record.values | {"limits": limits})
    text = write_report(pictures, tmp_path / "report.html", flight="my flights/hall").read_text()
    assert re.findall("<h2>(.*?)</h2>", text)[-4:] == [
        "What limits it", "What to do next", "To fly it", "The numbers",
    ]  # fmt: skip
    train, fly = re.findall("<pre><code>(.*?)</code></pre>", text)
    assert train.startswith("trexton train &#39;my flights/hall&#39; -o loop.npz --method field")
    assert fly == "trexton onboard loop.npz --samples 400"
    assert text.index("It works here") < text.index("The numbers")


def test_the_report_is_dark_on_screens_alone(report):
    style, body = report.split("<body>")
    dark = style.split("@media screen and (prefers-color-scheme: dark)")[1].split("@media print")[0]
    for color in ("ffffff", "000000", COLORS["field"][1:].lower()):
        assert style.count(f"--fig-{color}: ") == dark.count(f"--fig-{color}: ") == 1
    assert f"var(--fig-{COLORS['field'][1:].lower()}, " in body and "fill: #ffffff" not in body


def test_figures_draw_what_the_record_holds(record):
    floor = over_the_floor(record).axes[0]
    np.testing.assert_allclose(
        floor.lines[-1].get_xydata(), np.array(record.series["field_m"])[::5]
    )
    shares = error_shares(record).axes[0]
    assert [line.get_label() for line in shares.lines][-1] == "frames drawn at random"
    assert all(line.get_ydata()[-1] == 100 for line in shares.lines)


def test_equal_seeds_give_equal_records(record):
    again = run(make_flight(1), make_flight(2), Parameters())
    assert again.values == record.values


def test_a_bound_stands_beside_the_same_bound_of_the_centre(record):
    errors = record.values["errors"]
    best, centre = (f"{errors[name]['p95_cm']['value']:.3g}" for name in ("field", "centre"))
    assert f"off by less than {best} cm, and by less than {centre} cm where" in finding(record)
