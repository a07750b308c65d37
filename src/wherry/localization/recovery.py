"""Probability of random particles when the likelihood of scans drops (Probabilistic Robotics, table 8.3)."""

from __future__ import annotations


class RecoveryProbability:
    """Compares a slow and a fast moving average of the scans' likelihood; recovery starts when the fast one is lower.

    Args:
        alpha_slow: Decay rate of the slow average, 0 ≤ alpha_slow ≪ alpha_fast; 0 turns recovery off.
        alpha_fast: Decay rate of the fast average.
    """

    def __init__(self, alpha_slow: float, alpha_fast: float) -> None:
        self._alpha_slow = alpha_slow
        self._alpha_fast = alpha_fast
        self.reset()

    def reset(self) -> None:
        """Forget all likelihoods."""
        self._slow = 0.0
        self._fast = 0.0

    def update(self, likelihood: float) -> None:
        """Update both averages with the likelihood of a scan, which is averaged over the particles."""
        if self._slow == 0.0:
            self._slow = self._fast = likelihood
        self._slow += self._alpha_slow * (likelihood - self._slow)
        self._fast += self._alpha_fast * (likelihood - self._fast)

    @property
    def value(self) -> float:
        """Probability that a particle is replaced by a random one, 0 to 1."""
        return max(0.0, 1.0 - self._fast / self._slow) if self._slow > 0.0 else 0.0
