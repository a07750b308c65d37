"""Intel's map beside the published ones (Kümmerle et al. 2009, table 1; Hess et al. 2016, table II)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from wherry.experiments.slam import Result, Settings, run
from wherry.mapping.backends import BACKENDS


@dataclass(frozen=True, slots=True)
class Row:
    """A method's error on Intel.

    Attributes:
        method: What it is called.
        translational_error_m: Mean.
        translational_sd_m: Standard deviation; None where it is not at hand.
    """

    method: str
    translational_error_m: float
    translational_sd_m: float | None


PUBLISHED = (
    Row("scan matching", 0.220, 0.296),
    Row("RBPF, 50 particles (gmapping)", 0.070, 0.083),
    Row("graph mapping", 0.031, 0.026),
    Row("Cartographer", 0.0229, None),
)


def reproduce(data: Path) -> tuple[Result, ...]:
    """Map Intel with every method.

    Args:
        data: The folder that holds ``intel/``.

    Raises:
        InputError: A file is missing.
    """
    intel = data / "intel"
    log, dense = intel / "intel_910_rawodom.clf.gz", intel / "intel_rawodom_dense.txt.gz"
    relations = intel / "intel.relations.gz"
    return tuple(run(Settings(log, dense, relations, backend)) for backend in BACKENDS)


def table(results: Sequence[Result]) -> str:
    """The results under the published rows, as text."""
    lines = [f"{'Intel Research Lab, 910 scans':<32} {'mean, m':>8} {'sd, m':>8} {'ms a scan':>10}"]
    for row in PUBLISHED:
        deviation = "" if row.translational_sd_m is None else f"{row.translational_sd_m:8.3f}"
        lines.append(f"{row.method:<32} {row.translational_error_m:8.3f} {deviation}".rstrip())
    for result in results:
        if result.translational_error_m is not None and result.translational_sd_m is not None:
            lines.append(
                f"{'wherry, ' + result.backend:<32} {result.translational_error_m:8.3f}"
                f" {result.translational_sd_m:8.3f} {result.ms_per_scan_median:10.2f}"
            )
    return "\n".join(lines)
