"""Pacing of a simulation by the wall clock."""

from __future__ import annotations

import time
from collections.abc import Callable

MAX_LAG = 0.25  # s of simulated time by which the simulation may be late; with more, the schedule restarts


class RealTimePacer:
    """Sleeps until simulated instants are due.

    Args:
        rate: Simulated seconds per second.
        now: Simulated time, s.

    Attributes:
        lag: How late the simulation was at the last instant, s of simulated time.
    """

    def __init__(self, rate: float, now: float) -> None:
        self.rate = rate
        self.lag = 0.0
        self.restart(now)

    @property
    def is_late(self) -> bool:
        """Whether the simulation is too late to catch up: this machine is too slow for the rate."""
        return self.lag > MAX_LAG

    def restart(self, now: float) -> None:
        """Restart the schedule, with a simulated time, s, that is due now."""
        self._started_at, self._simulated_start = time.monotonic(), now

    def wait_until(self, instant: float, *, last: float, period: float, on_tick: Callable[[float], None]) -> None:
        """Sleep until an instant is due.

        Args:
            instant: Simulated time, s.
            last: Simulated time of the instant before, s.
            period: Simulated time between ticks, s.
            on_tick: Called with the simulated time, s, at every tick between both instants.
        """
        self.lag = self._due_time() - instant
        if self.is_late:
            self.restart(instant)
        tick = last
        while (remaining := instant - self._due_time()) > 0.0:
            if tick + period < instant - period / 2:
                time.sleep(max(min(tick + period - self._due_time(), remaining), 0.0) / self.rate)
                tick += period
                on_tick(tick)
            else:
                time.sleep(remaining / self.rate)

    def _due_time(self) -> float:
        """Simulated time that is due now, s."""
        return self._simulated_start + (time.monotonic() - self._started_at) * self.rate
