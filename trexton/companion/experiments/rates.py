"""Rates and means over floors or flights, and times of frames, as records hold them.

Intervals of 95 %: Wilson's score for rates, also where trials come in clusters, Student's t for
means.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.special import ndtri, stdtrit

Counts = int | Sequence[int] | np.ndarray  # of independent trials, or of each cluster's


def success_rate(successes: Counts, trials: Counts) -> dict[str, Any] | None:
    """A rate with its 95 % Wilson interval, as records hold it; None without trials.

    Counts of clusters, as `wilson_interval` takes them, leave the number of ``clusters`` beside it.
    """
    total = int(np.sum(trials))
    if not total:
        return None
    low, high = wilson_interval(successes, trials)
    rate = {"value": int(np.sum(successes)) / total, "low": low, "high": high, "trials": total}
    clusters = {"clusters": int(np.count_nonzero(trials))} if np.ndim(trials) else {}
    return rate | clusters


def wilson_interval(successes: Counts, trials: Counts) -> tuple[float, float]:
    """95 % Wilson interval of a success rate; of trials in clusters that may be alike.

    Flights over one floor count as the number of independent trials that would leave the rate as
    uncertain as the floors show it to be, fewer again as Student's t is wider for so few (Korn and
    Graubard, Survey Methodology 24, 1998, with Wilson's interval as Dean and Pagano, Journal of
    Survey Statistics and Methodology 3, 2015, have it). Where all trials came out alike each
    cluster counts once; of a single cluster nothing is known about others, and all is 0 to 1.

    Parameters
    ----------
    successes, trials : int or (K,) array of int
        Of independent trials, or of each of K clusters. Clusters of one trial each are independent.
    """
    good, tried = np.atleast_1d(successes), np.atleast_1d(trials)
    rate = good.sum() / tried.sum()
    count = _independent(good, tried) if np.ndim(trials) else float(tried.sum())
    if count == 0:
        return 0.0, 1.0
    squared = ndtri(0.975) ** 2
    middle = (rate + squared / (2 * count)) / (1 + squared / count)
    spread = rate * (1 - rate) * squared / count + (squared / (2 * count)) ** 2
    reach = np.sqrt(spread) / (1 + squared / count)
    # SciPy's interval, which takes whole trials only; its ends are met to the last bit.
    low = 0.0 if rate == 0 else middle - reach
    high = 1.0 if rate == 1 else middle + reach
    return float(low), float(high)


def _independent(successes: np.ndarray, trials: np.ndarray) -> float:
    """How many independent trials tell as much as these, of which each cluster has so many."""
    successes, trials = successes[trials > 0], trials[trials > 0]
    clusters, count = len(trials), int(trials.sum())
    if clusters == 1:
        return 0.0
    rate = successes.sum() / count
    if rate in (0, 1):
        return float(clusters)
    off = successes - rate * trials
    variance = clusters / (clusters - 1) * (off @ off) / count**2
    effect = max(1.0, variance * (count - 1) / (rate * (1 - rate)))  # of clustering
    few = stdtrit(count - 1, 0.025) / stdtrit(clusters - 1, 0.025)
    return float(count / effect * few**2)


def mean_over_groups(
    values: Sequence[float] | np.ndarray, lowest: float = 0.0, highest: float = np.inf
) -> dict[str, float | None]:
    """Mean of one value a group, which cannot lie below `lowest` or above `highest`, with its 95 %
    interval over groups, as records hold it.

    Student's, since groups are few: of two floors a bootstrap could only draw the two. Of a single
    group nothing is known about others, and ``low`` and ``high`` are None.
    """
    mean, count = float(np.mean(values)), len(values)
    if count < 2:
        return {"value": mean, "low": None, "high": None}
    reach = -float(stdtrit(count - 1, 0.025) * (np.std(values, ddof=1) / np.sqrt(count)))
    return {"value": mean, "low": max(lowest, mean - reach), "high": min(highest, mean + reach)}


def milliseconds(runs: Sequence[np.ndarray], stretch: int = 20) -> dict[str, Any]:
    """``median``, ``low``, ``high`` in ms of times in seconds.

    Single frames now and then wait for the rest of the machine; the interval is that of medians
    over `stretch` frames, which do not feel that.
    """
    pieces = [piece for run in runs for piece in np.array_split(run, max(1, len(run) // stretch))]
    low, high = np.percentile([np.median(piece) for piece in pieces], (2.5, 97.5))
    median = np.median(np.concatenate(runs))
    times = {"median": median, "low": min(low, median), "high": max(high, median)}
    return {name: 1000 * seconds for name, seconds in times.items()}


def of_frames(seconds: np.ndarray) -> dict[str, Any]:
    """Median and 99th percentile of the seconds that single frames took."""
    return {"median_s": np.median(seconds), "p99_s": np.percentile(seconds, 99)}


def frequency(time_ms: dict[str, Any]) -> dict[str, Any]:
    """The same as a rate in Hz."""
    times = {"median": "median", "low": "high", "high": "low"}
    return {name: 1000 / time_ms[time] for name, time in times.items()}
