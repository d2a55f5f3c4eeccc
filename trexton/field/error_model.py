"""Errors of single frames are correlated in time and grow with the field's variance. Offers
`ErrorModel`, which says so in numbers, and the terms it is fitted to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["ErrorModel", "error_terms"]

MIN_EXPLAINED = 0.02  # share of the signal that the field explains of any place


@dataclass(frozen=True, eq=False)
class ErrorModel:
    """Errors of single frames: a first-order Gauss-Markov process, AR(1), and white noise.

    Attributes
    ----------
    correlated_sigma, white_sigma : float
        Standard deviations along one axis, metres.
    time_constant_s : float
        Of the correlated error.
    """

    correlated_sigma: float
    white_sigma: float
    time_constant_s: float

    def independent_s(self, period_s: float) -> float:
        """Seconds between frames whose errors are as good as independent: 1 + 2 sum of the
        autocorrelations, in frames of that period.
        """
        memory = np.exp(-period_s / self.time_constant_s)
        share = self.correlated_sigma**2 / (self.correlated_sigma**2 + self.white_sigma**2)
        return float(period_s * (1 + 2 * share * memory / (1 - memory)))

    @classmethod
    def of(cls, errors: np.ndarray, time: np.ndarray, finest: float) -> ErrorModel:
        """From ``(N, 2)`` errors of frames; `finest` is the least that `white_sigma` may be.

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
        white = max(np.sqrt(variance * (1 - share)), finest)
        return cls(np.sqrt(variance * share), white, -period / np.log(memory))


def error_terms(variances: np.ndarray) -> np.ndarray:
    """``(M, 3)`` regressors of the mean error: 1, the root of unexplained over explained variance,
    and that ratio itself, of the field's `variances` ``(M,)`` as shares of the signal.

    With a larger variance a place is located less exactly; where next to nothing is explained it is
    not told from others.
    """
    variances = np.maximum(variances, 0.0)
    ratio = variances / np.maximum(1 - variances, MIN_EXPLAINED)
    return np.column_stack([np.ones_like(ratio), np.sqrt(ratio), ratio])
