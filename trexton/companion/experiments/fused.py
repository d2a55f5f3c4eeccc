"""Can the autopilot believe it? What receivers like EKF2 and EKF3 make of what they are sent.

Reports of each method are fused with simulated accelerometers; the record holds the consistency
(NEES, NIS) and coverage of the fused position.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trexton.base.errors import ParameterError
from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.calibration import METHODS
from trexton.companion.experiments.declaration import POSITIONS, Experiment, MapParameters, option
from trexton.companion.experiments.evaluation import runs_by_method
from trexton.companion.experiments.receivers import RECEIVERS, Receiver, Settings, readings
from trexton.companion.experiments.style import COLORS, canvas, with_intervals
from trexton.companion.experiments.track import HELD
from trexton.companion.wording import number, percent
from trexton.evaluation.metrics import euclidean, mean_with_interval
from trexton.flights.flight import Flight
from trexton.localization.estimate import Estimate

SENT = {"sent": "as it is sent", "plain": "as if each were news"}
BAND = {"low": 0.8, "high": 0.97}  # of the truth in the fused 90 % region: that is honest
SETTLED_S = 4.0  # receivers begin with no idea of the velocity


@dataclass(frozen=True)
class Parameters(MapParameters):
    """What can be chosen."""

    repeats: int = option(3, "independent runs of each filter over the test flight", low=1)
    vehicles: int = option(10, "accelerometers that each run is fused with", low=1)


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Fly the test flight with each method, send what flies, and fuse it.

    Each report is sent once, and only where a vehicle may steer by it. Beside what is sent stands
    the same with each report's own covariance, whatever it shares with the ones before. A method
    that says all the time that it is lost sends nothing, and is in no figure.

    Raises
    ------
    ParameterError
        All of them do.
    """
    pushes = readings(
        test.position, test.time, parameters.vehicles, stream(parameters.seed, "accelerometers")
    )
    period = float(np.median(np.diff(test.time)))
    values: dict[str, Any] = {"order": [], "silent": [], "band": BAND}
    series: dict[str, Any] = {"time_s": test.time - test.time[0]}
    for name, tracked in runs_by_method(
        train, test, parameters, methods=METHODS, repeats=parameters.repeats, purpose="fused"
    ):
        flights = [track.estimates for track in tracked]
        measured = flights[0][-1].measurement
        alike = 1.0 if measured is None else max(1.0, measured.independent_s / period)
        usable = [not estimate.lost_in(test.area) for flown in flights for estimate in flown]
        if not any(usable):
            values["silent"].append(name)
            continue
        values["order"].append(name)
        values[name] = {"alike": alike, "usable_rate": np.mean(usable)}
        for receiver, settings in RECEIVERS.items():
            values[name][receiver] = {}
            for sent in SENT:
                # A report an age is news, whatever it shares with the one before.
                every = period if sent == "sent" else np.inf
                runs = [_fuse(settings, flown, every, test, pushes) for flown in flights]
                rng = stream(parameters.seed, "intervals")
                summary = _summary(runs, alike if sent == "sent" else 1.0, rng)
                values[name][receiver][sent] = summary
                if (receiver, sent) == ("ekf2", "sent"):
                    series[name] = runs[0].track()
    if not values["order"]:
        raise ParameterError(
            f"every method says of every frame of {test.name} that it is lost, and so nothing is "
            "sent: train on more of the floor"
        )
    values["counts"] = {
        "test": len(test), "repeats": parameters.repeats, "vehicles": parameters.vehicles
    }  # fmt: skip
    return parameters.record(train, test, values=values, series=series)


@dataclass(frozen=True, eq=False)
class _Fused:
    """One flight as its receivers came to believe it; arrays ``(N, R)``, NaN before the first.

    Attributes
    ----------
    error, claimed : arrays
        Length of the error, and the root of what was believed of its square, metres.
    squared : array
        Errors over what was believed of them, squared.
    nis : array
        Squared innovations over what was expected of them; NaN where nothing was sent.
    first : int
        Frame from which on it counts.
    """

    error: np.ndarray
    claimed: np.ndarray
    squared: np.ndarray
    nis: np.ndarray
    first: int

    def track(self) -> dict[str, np.ndarray]:
        """Of the first receiver, cm."""
        return {"error_cm": 100 * self.error[:, 0], "claimed_cm": 100 * self.claimed[:, 0]}


def _fuse(
    settings: Settings, flown: list[Estimate], every_s: float, test: Flight, pushes: np.ndarray
) -> _Fused:
    vehicles = pushes.shape[1]
    receiver = Receiver(settings, vehicles)
    error, claimed, squared, nis = (np.full((len(flown), vehicles), np.nan) for _ in range(4))
    for row, (time, estimate) in enumerate(zip(test.time, flown, strict=True)):
        if row and receiver.begun:
            receiver.drive(pushes[row - 1], float(time - test.time[row - 1]))
        if not estimate.lost_in(test.area):
            report = estimate.for_fusion(every_s)
            ratios = receiver.fuse(float(time), report.position, np.diagonal(report.covariance))
            nis[row] = ratios.sum(axis=1)
        if receiver.begun:
            error[row] = euclidean(receiver.position, test.position[row])
            claimed[row] = np.sqrt(receiver.variance.sum(axis=1))
            squared[row] = receiver.squared_error(test.position[row])
    first = int(np.searchsorted(test.time, test.time[0] + SETTLED_S))
    return _Fused(error, claimed, squared, nis, min(first, len(flown) // 2))


def _summary(runs: list[_Fused], alike: float, rng: np.random.Generator) -> dict[str, Any]:
    """How honest the receivers are; `alike` reports share an error and say so.

    Innovations are as large as ever where the covariance that is sent grew by so much: their ratio
    is expected to be 2 over that. Its band holds 95 % of the means of as many independent ones as
    there are in the flight.
    """
    from scipy.stats import chi2

    first = runs[0].first
    error, claimed, squared, nis = (
        np.concatenate([getattr(run, name)[first:].T for run in runs])
        for name in ("error", "claimed", "squared", "nis")
    )
    held = np.where(np.isfinite(squared), squared < HELD, np.nan)
    freedom = max(2.0, 2 * np.isfinite(nis).sum(axis=1).mean() / alike)
    low, high = 2 / alike * chi2.ppf((0.025, 0.975), freedom) / freedom
    return {
        "inside": mean_with_interval(held, rng),
        "nees": np.nanmean(squared),
        "error_cm": 100 * np.nanmean(error),
        "axis_cm": 100 * np.sqrt(np.nanmean(np.square(error)) / 2),
        "claimed_cm": 100 * np.sqrt(np.nanmean(np.square(claimed)) / 2),
        "nis": {"mean": np.nanmean(nis), "low": low, "high": high},
    }


def finding(record: Record) -> str:
    """What the experiment found, in a sentence."""
    said = []
    for name in record.values["order"]:
        fused = record.values[name]["ekf2"]["sent"]
        said.append(
            f"fed with {METHODS[name]}, a receiver like EKF2 has an error of "
            f"{number(fused['axis_cm'])} cm along an axis, claims "
            f"{number(fused['claimed_cm'])} cm and has the truth in its 90 % region "
            f"{percent(fused['inside'])} of the time"
        )
    said += [
        f"{METHODS[name]} says of every frame that it is lost, and sends nothing"
        for name in record.values["silent"]
    ]
    text = "; ".join(said)
    return f"{text[0].upper()}{text[1:]}."


def truth_in_the_region(record: Record) -> Figure:
    """Share of the time that the truth lies in the fused 90 % region, by method and receiver."""
    with canvas(1, len(RECEIVERS), size=(7.2, 3.2), sharey=True) as (figure, axes):
        band, order = record.values["band"], record.values["order"]
        for plot, (receiver, settings) in zip(axes[0], RECEIVERS.items(), strict=True):
            honest = 100 * band["low"], 100 * band["high"]
            plot.axhspan(*honest, color=COLORS["zone"], alpha=0.2, linewidth=0, zorder=0)
            for place, name in enumerate(order):
                for offset, sent in zip((-0.15, 0.15), SENT, strict=True):
                    share = record.values[name][receiver][sent]["inside"]
                    with_intervals(
                        plot, np.array([place + offset]), [share], scale=100, color=COLORS[name],
                        fmt="o" if sent == "sent" else "s", markersize=6,
                        markerfacecolor=COLORS[name] if sent == "sent" else "white",
                        label=SENT[sent] if place == len(order) - 1 else None,
                    )  # fmt: skip
            plot.set_xticks(range(len(order)), [METHODS[name] for name in order], fontsize=8)
            plot.set(ylim=(0, 102), title=f"like {settings.label}")
            plot.grid(axis="x", visible=False)
        axes[0, 0].set_ylabel("truth in the fused 90 % region (%)")
        axes[0, 0].legend(loc="center left", bbox_to_anchor=(-0.02, 0.65), fontsize=8)
    return figure


def believed_over_time(record: Record) -> Figure:
    """Error of a receiver like EKF2 over the flight, and what it believes of it."""
    order = record.values["order"]
    with canvas(len(order), 1, size=(7.2, 1.7 * len(order)), sharex=True) as (figure, axes):
        time = np.array(record.series["time_s"])
        for plot, name in zip(axes[:, 0], order, strict=True):
            color = COLORS[name]
            track = record.series[name]
            believed = np.array(track["claimed_cm"], dtype=float)
            plot.fill_between(
                time, 0, believed, color=color, alpha=0.25, linewidth=0, label="error believed"
            )
            error = np.array(track["error_cm"], dtype=float)
            plot.plot(time, error, color=color, label="error")
            plot.set(ylabel="error (cm)", ylim=(0, None), title=METHODS[name])
            plot.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2, borderaxespad=0.1)
        axes[-1, 0].set_xlabel("time (s)")
    return figure


EXPERIMENT = Experiment(
    "Can the autopilot believe it?",
    Parameters,
    run,
    finding,
    needs=POSITIONS,
    after=("mocap_training",),
    cost_s=20,
)
