"""Assembly of a log from recorded scans and odometry, by the same rules for text logs and bags."""

from __future__ import annotations

from collections.abc import Sequence

from wherry.errors import InputError
from wherry.logs.beam_times import with_usable_beam_times
from wherry.logs.clocks import of_same_clock, with_spread_stamps, with_usable_stamps
from wherry.logs.lidar_log import LidarLog
from wherry.logs.majority import kept_odometry, kept_scans, without_repetitions
from wherry.logs.max_range_readings import mark_beams_without_return
from wherry.logs.odometry_at_scans import odometry_at_scans
from wherry.logs.options import ReadingOptions
from wherry.logs.recorded import RecordedOdometry, RecordedScan
from wherry.logs.rejections import Rejections, joined
from wherry.space.pose import Pose

__all__ = ["RecordedOdometry", "RecordedScan", "assemble_log"]


def assemble_log(
    source: str,
    scans: Sequence[RecordedScan],
    odometry: Sequence[RecordedOdometry],
    lidar: Pose,
    options: ReadingOptions,
    *,
    skipped: Sequence[str] = (),
    notes: Sequence[str] = (),
    skipped_scans: int = 0,
) -> LidarLog:
    """Assemble a log: judge scans and odometry by the majority, relate them in time, and find beams without a return.

    Args:
        source: Name of the file.
        scans: The scans in the order of the recording.
        odometry: The odometry in the order of the recording, without that of the scans.
        lidar: Pose of the lidar in the base_link frame.
        options: How to read.
        skipped: Lines or messages that were left out already.
        notes: Notes on what was decided already.
        skipped_scans: Number of scans among ``skipped``.

    Raises:
        InputError: There are no scans; a scan or a reading of odometry is an outlier (unless lenient), or too many are.
    """
    rejections = Rejections(source, options.lenient, list(skipped))
    if not scans:
        left_out = f" ({len(skipped):,} left out, the first: {skipped[0]})" if skipped else ""
        raise InputError(source, "", "has no scans in it" + left_out)
    total = len(scans) + len(odometry) + len(skipped)
    timed, timed_odometry, clock_note = with_usable_stamps(without_repetitions(scans), odometry)
    kept, scan_jumps_note = kept_scans(timed, rejections)
    rejections.check_share(len(timed) - len(kept) + skipped_scans, len(timed) + skipped_scans, "scans")
    readings, odometry_jumps_note = kept_odometry(kept, timed_odometry, rejections)
    rejections.check_share(len(rejections.entries), total, "lines or messages")
    kept, readings, coarse_note = with_spread_stamps(kept, readings)
    readings, difference_note = of_same_clock(kept, readings)
    at_scans, trajectory, coverage_note = odometry_at_scans(kept, readings)
    marked, marking_note = mark_beams_without_return([recorded.scan for recorded in kept], at_scans)
    final, beam_times_note = with_usable_beam_times(marked)
    all_notes = joined(
        (
            *notes,
            rejections.note(total),
            clock_note,
            coarse_note,
            scan_jumps_note or odometry_jumps_note,
            difference_note,
            coverage_note if readings or not odometry else "",  # another note says why odometry was left out
            marking_note,
            beam_times_note,
        )
    )
    return LidarLog(final, at_scans, trajectory, lidar, tuple(rejections.entries), all_notes)
