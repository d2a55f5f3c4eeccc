"""Positions that a vehicle cannot have flown: motion capture that lost it, a pose that froze, or
another body's place. `lost_rows` finds them by the flight's own speeds, and a mend made by
`without_positions` leaves them empty.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from trexton.flights.flight import Flight, area_around

FEWEST = 5  # positions from which on a flight has speeds of its own
WINDOW = 5  # positions whose median is a place, and steps over whose median a speed is sustained
JUMP = 4.0  # times the top sustained speed: no vehicle goes from one row to the next so fast
FROZEN, STILL = 3, 0.01  # equal rows in sequence; a step of this share of the usual is none
LEAVES = 2.0  # times the top sustained speed by which a frozen pose is left
LONGEST = 0.3  # of the rows: where more seem lost it is the flight that jumps
NEAR = 0.25  # of how far rows lie away: so near the way goes on where they are lost
MANY, AROUND = 0.4, 15  # of the rows, where each is lost for itself; rows that show the others
SMALLEST = 0.05  # metres: what is nearer is noise
GAP = 5.0  # times the usual time between rows, from where both sides are judged for themselves
MOST_PIECES = 1000  # between jumps, back to which a way is looked for
SET_BACK = "was a clock set back?"  # in what is said of one, for the check to find
NAMED = 12  # ranges of frames that are told one by one

Lost = tuple[str, np.ndarray, bool]  # in words, the rows, and whether it is sure which they are


class Doubt(str):
    """A sentence; `mend` does what it advises, where that can be done, and `done` says so."""

    mend: Callable[[Flight], Flight] | None
    done: str

    def __new__(
        cls, text: str, done: str = "", mend: Callable[[Flight], Flight] | None = None
    ) -> Doubt:
        made = super().__new__(cls, text)
        made.mend, made.done = mend, done
        return made


def lost_rows(time: np.ndarray, place: np.ndarray) -> list[Lost]:
    """What is lost; empty where all can have been flown.

    Parameters
    ----------
    time : (N,) array
        Seconds, increasing.
    place : (N, D) array
        Metres, the first two columns x and y; NaN where there is none.
    """
    rows = np.flatnonzero(np.isfinite(place[:, :2]).all(axis=1))
    if len(rows) < FEWEST:
        return []
    time, position = time[rows], place[rows, :2]
    top = _top_speed(time, position)
    if not top > 0:
        return []
    zero, frozen, flown = _parted(time, position, top)
    if 0 < (slow := _slow_top_speed(time, position)) < top / 2:  # many are lost one by one?
        other = _parted(time, position, slow)
        kept = np.flatnonzero(other[2])
        alone = np.diff(kept, prepend=-1, append=len(time)).max() <= AROUND
        if alone and _returns(position, other[2], flown & ~other[2]):
            (zero, frozen, flown), top = other, slow
    jumped = ~(flown | frozen | zero)
    found: list[Lost] = []
    if jumped.mean() > LONGEST and (jumped.mean() > MANY or not _returns(position, flown, ~flown)):
        said = f"{jumped.sum()} of {len(rows)} positions cannot be flown to from the others"
        said += f", at {JUMP:g} times the top speed of {top:.2g} m/s"
        return [(said, rows[jumped], False)]
    for chosen, how in ((zero, "at exactly (0, 0)"), (jumped, "where none can be flown to")):
        if chosen.any():
            place = position @ (1, 1j)  # where it was between those it can have flown
            between = np.interp(time[chosen], time[flown], place[flown])
            apart = np.abs(place[chosen] - between).max()
            said = f"{how}, up to {apart:.4g} m from those before and after"
            found.append((said, rows[chosen], True))
    if frozen.any():
        how = "at one place to the last digit while the vehicle flew on"
        found.append((how, rows[frozen], True))
    return found


def _parted(
    time: np.ndarray, position: np.ndarray, top: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The rows at (0, 0), the frozen ones, and those that can have been flown, as masks."""
    zero = _zeros(time, position, JUMP * top)
    frozen = _frozen(time, position, top) & ~zero
    kept = np.flatnonzero(~(frozen | zero))
    flown = np.zeros(len(time), dtype=bool)
    flown[kept[longest_chain(time[kept], position[kept], JUMP * top)]] = True
    return zero, frozen, flown


def _returns(position: np.ndarray, flown: np.ndarray, lost: np.ndarray) -> bool:
    """Whether the way goes on near where it was before the lost rows, which lie far from both: who
    flies fast, or is measured badly, does not come back like that.
    """
    others, kept = np.flatnonzero(lost), np.flatnonzero(flown)
    after = np.searchsorted(kept, others)
    within = (after > 0) & (after < len(kept))
    others, after = others[within], after[within]
    before, after = position[kept[after - 1]], position[kept[after]]
    apart = np.hypot(*(position[others] - (before + after) / 2).T)
    ways = np.hypot(*(after - before).T)
    return len(others) > 0 and bool(np.quantile(ways / np.maximum(apart, 1e-9), 0.85) < NEAR)


def _slow_top_speed(time: np.ndarray, position: np.ndarray) -> float:
    """The top speed where up to a half of the rows may be lost, each for itself: of each row to the
    nearest in time that suits it best, and of a third of the rows around.
    """
    if len(time) < 2 * AROUND:
        return np.inf
    speeds = np.full(len(time), np.inf)
    for apart in range(1, WINDOW):
        speed = _speeds(time, position, apart)
        speeds[apart:] = np.minimum(speeds[apart:], speed)
        speeds[:-apart] = np.minimum(speeds[:-apart], speed)
    around = np.lib.stride_tricks.sliding_window_view(speeds, AROUND)
    return float(np.quantile(np.quantile(around, 0.35, axis=1), 0.95))


def _top_speed(time: np.ndarray, position: np.ndarray) -> float:
    """The speed that is sustained in the fastest twentieth of the flight; places that come again
    and again (zeros, frozen poses) do not count where there are enough others.
    """
    rounded = np.round(position, 9)
    _, inverse, count = np.unique(rounded, axis=0, return_inverse=True, return_counts=True)
    single = count[np.reshape(inverse, -1)] == 1
    if single.sum() < max(FEWEST, len(time) / 2):
        single = position.any(axis=1)
        single |= single.sum() < FEWEST
    time, position = time[single], position[single]
    noise = float(np.quantile(_speeds(time, position), 0.6))  # which medians would not show
    if len(time) >= 3 * WINDOW:  # else a row that is lost in a few makes two steps of them
        position, time = _medians(position, WINDOW), time[WINDOW // 2 : -(WINDOW // 2)]
    steps = np.diff(position, axis=0)
    width = min(WINDOW, len(steps))
    speeds = _medians(_speeds(time, position), width)
    top = max(noise, float(np.quantile(speeds, 0.95)))
    fast = np.flatnonzero(speeds[: -(width // 2) - 1] > JUMP * top)
    flown = steps[fast + width // 2]
    bends = steps[fast + width // 2 + 1] - flown
    if len(fast) < 2 * WINDOW or np.median(np.hypot(*bends.T)) > np.median(np.hypot(*flown.T)) / 2:
        return top
    return float(np.quantile(speeds[fast], 0.95))  # it stands nearly always, and flies a way


def _speeds(time: np.ndarray, position: np.ndarray, apart: int = 1) -> np.ndarray:
    moved = np.hypot(*(position[apart:] - position[:-apart]).T)
    return np.asarray(moved / (time[apart:] - time[:-apart]))


def _medians(values: np.ndarray, width: int) -> np.ndarray:
    return np.median(np.lib.stride_tricks.sliding_window_view(values, width, axis=0), axis=-1)


def _zeros(time: np.ndarray, position: np.ndarray, fastest: float) -> np.ndarray:
    """Rows at exactly (0, 0) that are reached or left by a jump: others are an origin."""
    zero = (position == 0).all(axis=1)
    steps = np.hypot(*np.diff(position, axis=0).T)
    jumps = np.pad(steps > np.maximum(fastest * np.diff(time), SMALLEST), 1)
    edges = np.flatnonzero(np.diff(np.pad(zero.astype(int), 1)))
    for first, end in edges.reshape(-1, 2):  # the last of them is before `end`
        zero[first:end] = jumps[first] or jumps[end]
    return zero


def _frozen(time: np.ndarray, position: np.ndarray, top: float) -> np.ndarray:
    """Rows of a sequence of equal places, but its first, that is left by a jump: whoever hovers
    leaves slowly. At the start of the flight its last is kept.
    """
    gaps, steps = np.diff(time), np.hypot(*np.diff(position, axis=0).T)
    equal = steps <= max(STILL * np.median(steps[steps > 0]), 1e-9 * np.abs(position).max())
    edges = np.flatnonzero(np.diff(np.concatenate([[0], equal.astype(int), [0]])))
    result, held = np.zeros(len(time), dtype=bool), 0
    runs = sorted(
        edges.reshape(-1, 2).tolist(), key=lambda run: run[0] == 0 or run[1] == len(steps)
    )
    for first, last in runs:  # rows first to last are equal; those at an end come last
        if last - first + 1 < FROZEN or last - first == len(steps):
            continue
        if first and steps[first - 1] > max(JUMP * top * gaps[first - 1], SMALLEST):
            continue  # what lies elsewhere is found by its jump
        if 0 < first and last < len(steps):
            left = steps[last] > max(LEAVES * top * gaps[last], SMALLEST)
            held = max(held, 0 if left else last - first)  # places may be rounded, as of GPS
        else:  # whoever takes off is slow at first, and whoever lands slows down before
            next_to, near = last, steps[last : last + WINDOW]
            if first:
                next_to, near = first - 1, steps[max(0, first - WINDOW) : first]
            share = 0.5 if steps[next_to] > SMALLEST else 0.75  # noise counts in small steps
            left = steps[next_to] > share * top * gaps[next_to] and near.sum() > SMALLEST
            left &= last - first > held
        result[first + (first > 0) : last + (first > 0)] = left
    return result


def longest_chain(time: np.ndarray, position: np.ndarray, fastest: float) -> np.ndarray:
    """The rows of the most positions that follow one another at up to that speed."""
    steps = np.hypot(*np.diff(position, axis=0).T)
    gaps = np.diff(time)
    jumps = steps > np.maximum(fastest * gaps, SMALLEST)
    if not jumps.any():
        return np.arange(len(time))
    parted = jumps | (gaps > GAP * np.median(gaps))  # over a long gap nothing is a jump
    edges = np.flatnonzero(np.pad(parted, 1, constant_values=True))
    first, last = edges[:-1], edges[1:] - 1
    size = last - first + 1
    total, before = size.copy(), np.full(len(first), -1)
    for piece in range(1, len(first)):
        since = max(0, piece - MOST_PIECES)
        earlier = last[since:piece]
        apart = np.hypot(*(position[first[piece]] - position[earlier]).T)
        near = apart <= np.maximum(fastest * (time[first[piece]] - time[earlier]), SMALLEST)
        if near.any():
            best = since + int(np.where(near, total[since:piece], 0).argmax())
            total[piece], before[piece] = total[best] + size[piece], best
    chain, piece = [], int(total.argmax())
    while piece >= 0:
        chain.append(np.arange(first[piece], last[piece] + 1))
        piece = int(before[piece])
    return np.concatenate(chain[::-1])


def ranges(numbers: np.ndarray) -> str:
    """``5, 13 to 15, 21`` of rising numbers; the first of them where there are many."""
    parts = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1)
    words = [f"{part[0]} to {part[-1]}" if len(part) > 1 else f"{part[0]}" for part in parts]
    more = f" and {len(words) - NAMED} more" if len(words) > NAMED else ""
    return ", ".join(words[:NAMED]) + more


def count_of(number: int, what: str) -> str:
    """``3 frames``, ``1 frame``, ``no frames``."""
    return f"{number or 'no'} {what}{'' if number == 1 else 's'}"


def without_positions(rows: np.ndarray) -> Callable[[Flight], Flight]:
    """Leaves the positions of these rows empty, and the area without them where it was theirs."""

    def mend(flight: Flight) -> Flight:
        position = flight.position.copy()
        position[rows] = np.nan
        area, theirs = flight.area, np.array(area_around(flight.position))
        if (np.abs(theirs - area) < 0.05 * flight.diagonal).all():  # it was drawn around them
            area = area_around(position, 0.02, 0.01)
        height = None if flight.height is None else flight.height.copy()
        if height is not None:
            height[rows] = np.nan
        return replace(flight, position=position, height=height, area=area)

    return mend


def tracking_doubts(flight: Flight) -> Iterator[str]:
    """What is lost in a flight, in words."""
    columns = (flight.position, flight.height, flight.attitude)
    pose = np.column_stack([each for each in columns if each is not None])
    for how, rows, sure in lost_rows(flight.time, pose):
        frames = ranges(flight.frame[rows])
        if not sure:
            yield f"{how} (frames {frames}): stamps of another unit, or several recordings?"
            continue
        what = "position lies" if len(rows) == 1 else "positions lie"
        yield Doubt(
            f"{len(rows)} {what} {how} (frames {frames}): was tracking lost? leave x_m and y_m of "
            "these frames empty",
            f"{count_of(len(rows), 'position')} left empty, {how} (frames {frames})",
            without_positions(rows),
        )
