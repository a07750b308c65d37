"""Judgement of the times between the beams of scans."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wherry.robot import Scan

SWEEP_TOLERANCE = 0.1  # share of the scan period by which a sweep may be longer than it
MAX_SWEEP = 1.5  # s, longest sweep of a log of a single scan; lidars turn at least once in a second


def with_usable_beam_times(scans: Sequence[Scan]) -> tuple[tuple[Scan, ...], str]:
    """The scans without times between beams that cannot be true, and a note that says so.

    A sweep takes no longer than the time from one scan to the next.
    """
    steps = np.diff([scan.time for scan in scans])
    period = float(np.median(steps)) if len(steps) else 0.0
    limit = period * (1.0 + SWEEP_TOLERANCE) if period > 0.0 else MAX_SWEEP
    wrong = [scan for scan in scans if not math.isfinite(scan.time_increment) or scan.duration > min(limit, MAX_SWEEP)]
    if not wrong:
        return tuple(scans), ""
    refused = {id(scan) for scan in wrong}
    duration = float(np.median([scan.duration for scan in wrong]))
    used = tuple(replace(scan, time_increment=0.0) if id(scan) in refused else scan for scan in scans)
    sweep = f"by it a sweep lasts {duration:.3g} s where a scan comes every {period:.3g} s"
    return used, f"time_increment of {len(wrong):,} of {len(scans):,} scans is not used: {sweep}"
