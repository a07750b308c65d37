"""Random particles when the scans fit worse than they used to (Probabilistic Robotics, table 8.3)."""

from __future__ import annotations


class RecoveryAverages:
    """A slow and a fast average of the scans' likelihood; the fast one falling below the slow one is a bad sign.

    Args:
        alpha_slow: Decay of the slow average, 0 ≤ alpha_slow ≪ alpha_fast; 0 turns recovery off.
        alpha_fast: Decay of the fast average.
    """

    def __init__(self, alpha_slow: float, alpha_fast: float) -> None:
        self._alpha_slow = alpha_slow
        self._alpha_fast = alpha_fast
        self.reset()

    def reset(self) -> None:
        """Forget all that was seen."""
        self._slow = 0.0
        self._fast = 0.0

    def observe(self, likelihood: float) -> None:
        """Take in the likelihood of a scan, averaged over the particles."""
        if self._slow == 0.0:
            self._slow = self._fast = likelihood
        self._slow += self._alpha_slow * (likelihood - self._slow)
        self._fast += self._alpha_fast * (likelihood - self._fast)

    @property
    def random_share(self) -> float:
        """Share of the particles to be drawn anywhere on the map, 0 to 1."""
        return max(0.0, 1.0 - self._fast / self._slow) if self._slow > 0.0 else 0.0
