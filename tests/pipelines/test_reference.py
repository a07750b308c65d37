"""What a comparison with a reference says: the same frame, another one, another clock, or a contradiction."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wherry.pipelines.logs.reference import Reference, ReferenceErrors
from wherry.space.pose import Floats, compose
from wherry.space.trajectory import Trajectory

TIMES = np.arange(0.0, 60.0, 0.5)


def true_poses(times: Floats) -> Floats:
    """A drive along an eight, [N, 3] m, m, rad, at 0.4 m/s on average."""
    phase = times / 10.0
    return np.column_stack([4.0 * np.sin(phase), 2.0 * np.sin(2.0 * phase), phase])


def errors_of(reference: Floats, times: Floats = TIMES) -> ReferenceErrors:
    """The errors of the true poses against a reference with poses [N, 3] m, m, rad, at times [N] s."""
    return Reference(Path("reference.txt"), Trajectory(times, reference), TIMES).errors(true_poses(TIMES))


@pytest.mark.parametrize(
    ("name", "transform"),
    [
        ("mirrored", np.array([1.0, -1.0, -1.0])),
        ("in millimetres", np.array([1000.0, 1000.0, 1.0])),
        ("of half the size", np.array([0.5, 0.5, 1.0])),
    ],
)
def test_a_reference_that_no_alignment_fits_contradicts_the_trajectory(name: str, transform: Floats) -> None:
    found = errors_of(true_poses(TIMES) * transform)
    assert found.reference_verdict is not None, name
    assert found.reference_verdict.startswith("Trajectory and reference contradict each other, by ")
    assert f"after alignment by {found.aligned_rmse_m:.2f} m" in found.reference_verdict
    assert found.rmse_m is not None
    assert found.rmse_m > 0.5


@pytest.mark.parametrize("frame", [[0.0, 0.0, 0.0], [3.0, -2.0, 1.0]])
@pytest.mark.parametrize(("ahead", "text"), [(1.3, "1.3 s ahead of"), (-2.0, "2.0 s behind")])
def test_a_reference_of_another_clock_is_said(ahead: float, text: str, frame: list[float]) -> None:
    found = errors_of(compose(np.array([frame]), true_poses(TIMES)), TIMES + ahead)
    assert found.reference_verdict is not None
    assert (
        f"; its clock is probably {text} the log's, with which the aligned error would be 0.0"
        in found.reference_verdict
    )


@pytest.mark.parametrize("frame", [[0.0, 0.0, 0.0], [3.0, -2.0, 1.0]])
def test_a_reference_of_the_same_clock_has_no_remark_on_it(frame: list[float]) -> None:
    noise = np.random.default_rng(0).normal(scale=0.15, size=(len(TIMES), 3)) * [1.0, 1.0, 0.0]
    found = errors_of(compose(np.array([frame]), true_poses(TIMES) + noise))
    assert found.reference_verdict is not None
    assert "clock" not in found.reference_verdict
    assert found.reference_verdict.endswith("; 120 of 120 scans are compared.")
    assert (found.reference_offset is None) == (frame == [0.0, 0.0, 0.0])
