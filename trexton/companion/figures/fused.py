"""Figures of what receivers make of what they are sent."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.companion.experiments.fused import METHODS, SENT
from trexton.companion.experiments.receivers import RECEIVERS
from trexton.companion.experiments.style import COLORS, canvas

__all__ = ["believed_over_time", "truth_in_the_region"]


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
                    middle, low, high = (100 * share[key] for key in ("value", "low", "high"))
                    plot.errorbar(
                        place + offset,
                        middle,
                        [[max(middle - low, 0)], [max(high - middle, 0)]],
                        fmt="o" if sent == "sent" else "s",
                        markerfacecolor=COLORS[name] if sent == "sent" else "white",
                        color=COLORS[name],
                        markersize=6,
                        label=SENT[sent] if place == len(order) - 1 else None,
                    )
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
