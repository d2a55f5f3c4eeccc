"""Hypotheses of where the vehicle is, each a Gaussian over an augmented state, and how they are
managed: prediction, Kalman update, the switch of a velocity bias, birth, pruning.

The augmented state is that of the motion model (any `LinearMotion`), the error that neighbouring
frames share, and the bias of the velocity that comes with the frames; the latter two are
first-order Gauss-Markov processes.
"""

import numpy as np

from trexton.field.likelihood import ErrorModel
from trexton.field.linear_motion import LinearMotion

CLUTTER_PROBABILITY = 1e-3  # that a frame, or a velocity, says nothing, whatever it looks like
BIAS_SIGMA = 0.3  # m/s along an axis, of a velocity that is biased
VELOCITY_GATE_SIGMA = 5.0  # innovation gate for velocity aiding
BIAS_TIME_S = 5.0  # time constant of the bias: it turns with the vehicle
BIAS_DECAY_S = 2.6  # time constant of the weight of a bias that explains nothing
BIAS_SWITCH_PROBABILITY = 1e-3  # a frame, that the bias sets in or ends
SEPARATION = 5.0  # cells between the births of two hypotheses
STEADY_STEPS = 300  # of prediction and update, after which a covariance stays as it is
NEGLIGIBLE_WEIGHT = 1e-6  # of a hypothesis, over that of the best


class Hypotheses:
    """A few Gaussians with weights, best first.

    Parameters
    ----------
    motion : LinearMotion
        Of D states.
    limit : int
        How many are kept at most, and as many again that take the velocity to be biased.
    cell : float, metres

    Attributes
    ----------
    states : (T, D + 4) array
        Of the motion, correlated error of the frames, velocity bias.
    covariances : (T, D + 4, D + 4) array
    weights : (T,) array, summing to one
    outliers : (T,) array
        Probability that the last frame was an outlier, given the hypothesis.
    frame, velocity : (2, D + 4) array
        Measurement matrices H: of the measured place of a frame, of a measured velocity.
    """

    def __init__(self, motion: LinearMotion, errors: ErrorModel, limit: int, cell: float):
        self.motion, self.limit, self.radius = motion, limit, SEPARATION * cell
        self._order = order = len(motion.prior_variance)
        axes = np.eye(2)
        self.error_variance = errors.correlated_sigma**2 * axes
        self._error_time_s = errors.time_constant_s
        self._prior, self._bias = np.zeros((2, order + 4, order + 4))
        self._prior[:order, :order] = np.diag(motion.prior_variance)
        self._prior[order:-2, order:-2] = self.error_variance
        self._bias[-2:, -2:] = BIAS_SIGMA**2 * axes
        self._period = self._over(float(motion.period_s))
        self.frame, self.velocity = np.zeros((2, 2, order + 4))
        self.frame[:, :2] = self.frame[:, order:-2] = axes
        self.velocity[:, 2:4] = self.velocity[:, -2:] = axes
        self.clear()

    def __len__(self) -> int:
        return len(self.states)

    def clear(self) -> None:
        """Forget all."""
        size = self._order + 4
        self.states, self.covariances = np.empty((0, size)), np.empty((0, size, size))
        self.weights, self.outliers = np.empty((2, 0))

    @property
    def biased(self) -> np.ndarray:
        """``(T,)`` whether a hypothesis takes the measured velocity to be biased."""
        return self.covariances[:, -1, -1] > 0

    def _append(self, states: np.ndarray, covariances: np.ndarray, outliers: np.ndarray) -> None:
        self.states = np.concatenate([self.states, states])
        self.covariances = np.concatenate([self.covariances, covariances])
        self.outliers = np.concatenate([self.outliers, outliers])

    def switch_bias(self) -> None:
        """Beside each hypothesis that has none near, one begins that takes the velocity to be
        biased where the other does not, and to be unbiased where it does.
        """
        biased, places = self.biased, self.states[:, :2]
        offset = places[:, None] - places
        near = np.hypot(offset[..., 0], offset[..., 1]) < 2 * self.radius
        alone = np.flatnonzero(~(near & (biased[:, None] != biased)).any(axis=1))
        states, covariances = self.states[alone], self.covariances[alone]
        states[:, -2:] = covariances[:, -2:] = covariances[:, :, -2:] = 0
        covariances[~biased[alone]] += self._bias
        self._append(states, covariances, self.outliers[alone])
        weights = np.concatenate([self.weights, BIAS_SWITCH_PROBABILITY * self.weights[alone]])
        self.weights = weights / weights.sum()

    def _over(self, seconds: float) -> tuple[np.ndarray, np.ndarray]:
        """``(D + 4, D + 4)`` transition and process noise over so many seconds."""
        order, axes = self._order, np.eye(2)
        error_memory, bias_memory = np.exp(-seconds / np.array([self._error_time_s, BIAS_TIME_S]))
        transition, noise = np.zeros((2, order + 4, order + 4))
        transition[:order, :order], noise[:order, :order] = self.motion.over(seconds)
        transition[order:-2, order:-2] = error_memory * axes
        transition[-2:, -2:] = bias_memory * axes
        noise[order:-2, order:-2] = (1 - error_memory**2) * self.error_variance
        return transition, noise

    def predict(self, seconds: float | None = None) -> None:
        """So many seconds later, or a period; a model that is not linear knows no other step."""
        transition, noise = self._period if seconds is None else self._over(seconds)
        order, states = self._order, self.states
        self.states = states @ transition.T
        jacobian = self.motion.jacobian(states[:, :order])
        if jacobian.ndim == 3:  # of a model that is not linear
            transition = np.repeat(transition[None], len(states), axis=0)
            transition[:, :order, :order] = jacobian
            self.states[:, :order] = self.motion.moved(states[:, :order])
        grown = np.where(self.biased, 1 - transition[..., -1, -1] ** 2, 0.0)
        covariances = transition @ self.covariances @ np.swapaxes(transition, -1, -2) + noise
        self.covariances = covariances + grown[:, None, None] * self._bias

    def innovation(
        self, matrix: np.ndarray, noise: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Of a measurement z = H x + v, v ~ N(0, R), with H ``(2, D + 4)`` and R ``(2, 2)``: the
        mean ``(T, 2)`` predicted, the covariance S = H P H' + R of the innovation, its inverse, and
        the gain ``(T, D + 4, 2)``.
        """
        across = self.covariances @ matrix.T
        spread = matrix @ across + noise
        precision = np.linalg.inv(spread)
        return self.states @ matrix.T, spread, precision, across @ precision

    def update(self, innovation: np.ndarray, gain: np.ndarray, known: np.ndarray) -> None:
        """Update by an innovation ``(T, 2)``, whose covariance was larger by `known` ``(T, 2, 2)``
        than that of the measurement given.
        """
        self.states = self.states + np.einsum("tij,tj->ti", gain, innovation)
        covariances = self.covariances - gain @ known @ gain.transpose(0, 2, 1)
        self.covariances = (covariances + covariances.transpose(0, 2, 1)) / 2

    def independent_s(self, white: np.ndarray, velocity_sigma: float | None = None) -> float:
        """Seconds between estimates whose errors are as good as independent: a period times 1 + 2
        sum of the autocorrelations in the steady state, in which an error goes on by (I - K H) F
        (Anderson and Moore, "Optimal Filtering", 1979, Sec. 4.4).

        A frame's place has the ``(2, 2)`` noise `white`, a velocity a deviation in m/s.
        """
        transition, noise = (each[:-2, :-2] for each in self._period)
        measured = [(self.frame[:, :-2], white)]
        if velocity_sigma is not None:
            measured.append((self.velocity[:, :-2], velocity_sigma**2 * np.eye(2)))
        covariance, own = noise, np.eye(len(noise))
        for _ in range(STEADY_STEPS):
            covariance, goes_on = transition @ covariance @ transition.T + noise, transition
            for matrix, variance in measured:
                across = covariance @ matrix.T
                left = own - across @ np.linalg.solve(matrix @ across + variance, matrix)
                covariance, goes_on = left @ covariance, left @ goes_on
        later = goes_on @ np.linalg.pinv(own - goes_on) @ covariance  # what is never seen stays
        return float(self.motion.period_s * (1 + 2 * later[0, 0] / covariance[0, 0]))

    def usual(self, velocity: np.ndarray | None, sigma: float) -> np.ndarray | None:
        """A velocity of so many m/s; None where no vehicle has it, nor NaN."""
        variance = float(self.motion.speed) ** 2 + BIAS_SIGMA**2 + sigma**2
        gate = VELOCITY_GATE_SIGMA * np.sqrt(variance)
        return velocity if velocity is not None and np.abs(velocity).max() <= gate else None

    def update_velocity(self, velocity: np.ndarray, noise: np.ndarray, biased: bool = True) -> None:
        """Update by a measured velocity with its ``(2, 2)`` noise covariance, which may be
        biased or not.

        Weights change by the likelihood over that of a velocity of which nothing is known. Where
        the velocity is biased it says nothing about the place: the hypotheses that take it to be
        gain as much as the one that gains most, a little less each time.
        """
        if not len(self):
            return
        prior = self._prior[2:4, 2:4] + noise
        matrix = self.velocity.copy()
        matrix[:, -2:] *= biased
        expected, spread, precision, gain = self.innovation(matrix, noise)
        innovation = velocity - expected
        self.update(innovation, gain, spread)
        squared = np.einsum("ti,tij,tj->t", innovation, precision, innovation)
        squared -= velocity @ np.linalg.solve(prior, velocity)
        ratio = np.linalg.det(precision) * np.linalg.det(prior)
        likelihood = np.maximum(np.sqrt(ratio) * np.exp(-0.5 * squared), CLUTTER_PROBABILITY)
        if biased:
            decay = np.exp(-float(self.motion.period_s) / BIAS_DECAY_S)
            likelihood[self.biased] = decay * likelihood.max()
        weights = self.weights * likelihood
        self.weights = weights / weights.sum()

    def give_birth(self, mean: np.ndarray, covariance: np.ndarray) -> None:
        """One more, at the measured place of a frame: its ``(2,)`` mean and ``(2, 2)``
        covariance, in metres; the caller gives it a weight by `prune`.
        """
        order = self._order
        state, prior = np.zeros(order + 4), self._prior.copy()
        state[:2] = mean
        # The position is the measured place less the correlated error.
        prior[:2, :2] = covariance + self.error_variance
        prior[:2, order:-2] = prior[order:-2, :2] = -self.error_variance
        self._append(state[None], prior[None], np.zeros(1))

    def prune(self, log_weights: np.ndarray, held: float = 1.0) -> int:
        """Keep the best that differ, with weights summing to one; which row the best was before.
        The one that was the best stays first while its weight is at least `held`.
        """
        kept: list[int] = []
        apart, speed = 0.25 * self.radius, 0.5 * float(self.motion.speed)
        biased = self.biased
        for row in np.argsort(-log_weights, kind="stable"):
            alike = [other for other in kept if biased[other] == biased[row]]
            if len(alike) == self.limit:
                continue
            offset = self.states[alike] - self.states[row]
            far = np.hypot(offset[:, 0], offset[:, 1]) > apart
            if (far | (np.hypot(offset[:, 2], offset[:, 3]) > speed)).all():
                kept.append(int(row))
        weights = np.exp(log_weights[kept] - log_weights[kept[0]])
        rows = np.array(kept)[weights > NEGLIGIBLE_WEIGHT]
        weights = weights[weights > NEGLIGIBLE_WEIGHT]
        weights /= weights.sum()
        order = np.argsort((rows > 0) | (weights < held), kind="stable")
        rows, weights = rows[order], weights[order]
        self.states, self.covariances = self.states[rows], self.covariances[rows]
        self.outliers, self.weights = self.outliers[rows], weights
        return int(rows[0])
