"""The map of a simulated robot, compared with the truth."""

from __future__ import annotations

from dataclasses import replace

from wherry.experiments.mapping.simulated import ExplorationResult, explore, table
from wherry.floorplan.world_files import find_world


def test_the_smallest_world_is_mapped_within_two_centimetres() -> None:
    result = explore(find_world("small"), 0)
    assert result.scans > 100
    assert result.wall_error_m <= 0.02
    assert result.rmse_m < 0.03
    assert 0.0 < result.ms_per_scan_median < 50.0
    assert result.times_real_time > 0.0
    again = explore(find_world("small"), 0)
    times = result.ms_per_scan_median, result.times_real_time
    assert replace(again, ms_per_scan_median=times[0], times_real_time=times[1]) == result


def test_each_run_is_a_row() -> None:
    rows = table([ExplorationResult("rooms", 1, 2000, 0.0051, 0.0149, 0.312, 168.5)]).splitlines()
    assert [cell.strip() for cell in rows[-1].strip("|").split("|")] == [
        "rooms",
        "1",
        "2000",
        "0.5",
        "1.5",
        "0.31",
        "168",
    ]
