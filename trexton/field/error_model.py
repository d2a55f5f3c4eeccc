"""How the errors of single frames hang together in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["ErrorModel", "unknown"]

LEAST_KNOWN = 0.02  # share of the signal that is known of any place


@dataclass(frozen=True, eq=False)
class ErrorModel:
    """How single frames err: a part that stays for a while, and a part that is new in each.

    Attributes
    ----------
    lasting, fresh : float
        Standard deviations along one axis, metres.
    lasts_s : float
        Time in seconds after which the lasting part is down to 1/e.
    """

    lasting: float
    fresh: float
    lasts_s: float

    def independent_s(self, period_s: float) -> float:
        """Seconds between frames whose errors are as good as independent: 1 + 2 sum of the
        autocorrelations, in frames of that period.
        """
        memory = np.exp(-period_s / self.lasts_s)
        share = self.lasting**2 / (self.lasting**2 + self.fresh**2)
        return float(period_s * (1 + 2 * share * memory / (1 - memory)))

    @classmethod
    def of(cls, errors: np.ndarray, time: np.ndarray, finest: float) -> ErrorModel:
        """From ``(N, 2)`` errors of frames; `finest` is the least that `fresh` may be.

        Outliers are shortened to three median lengths: they are the likelihood's affair.
        """
        length = np.hypot(*errors.T)
        limit = max(3 * float(np.median(length)), finest)
        errors = errors * np.minimum(1, limit / np.maximum(length, 1e-12))[:, None]
        period = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
        variance = float(np.square(errors).mean())

        def correlation(lag: int) -> float:
            regular = np.abs(time[lag:] - time[:-lag] - lag * period) < 0.5 * period
            if regular.sum() < 4 or variance <= 0:
                return 0.0
            return float((errors[lag:] * errors[:-lag])[regular].mean() / variance)

        first, second = correlation(1), correlation(2)
        if first < 0.05 or second <= 0:
            return cls(np.sqrt(variance / 2), max(np.sqrt(variance / 2), finest), period)
        memory = float(np.clip(second / first, 0.2, 0.98))
        share = float(np.clip(first / memory, 0.25, 1.0))
        fresh = max(np.sqrt(variance * (1 - share)), finest)
        return cls(np.sqrt(variance * share), fresh, -period / np.log(memory))


def unknown(variances: np.ndarray) -> np.ndarray:
    """``(M, 3)`` terms with which errors grow: always the same, as the root of what is unknown over
    what is known of a place, and as that itself, of `variances` ``(M,)`` as shares of the signal.

    A place that is known badly is found less exactly; one that is hardly known is not told from
    others.
    """
    variances = np.maximum(variances, 0.0)
    over_known = variances / np.maximum(1 - variances, LEAST_KNOWN)
    return np.column_stack([np.ones_like(over_known), np.sqrt(over_known), over_known])
