"""The published Taxi table beside our own: every learner, both sizes."""

from __future__ import annotations

from collections.abc import Callable

from wherry.experiments.results import markdown_table
from wherry.experiments.taxi import LEARNERS, Result, Settings, TaxiExperiment

PUBLISHED = {
    "DOORMAX (ICML 2008)": {5: ("529", "13.88"), 10: ("821", "293.72")},
    "Factored Rmax (ICML 2008)": {5: ("1676", "43.59"), 10: ("19866", "306.71")},
    "Rmax (Diuk 2010)": {5: ("4151", "74")},
    "Q-learning (Diuk 2010)": {5: ("106859", "–")},
    "Q-learning, optimistic (Diuk 2010)": {5: ("29350", "–")},
    "humans, any / who play games (Diuk 2010)": {5: ("101 / 48.8", "–")},
}
SIZES = (5, 10)
REPETITIONS = 100


def reproduce(progress: Callable[[int, int], None]) -> str:
    """Run every learner on both sizes and return the table as Markdown.

    Args:
        progress: Told how many repetitions are done, of how many.
    """
    total, done = len(LEARNERS) * len(SIZES) * REPETITIONS, 0
    results: dict[str, dict[int, Result]] = {}
    for learner in LEARNERS:
        for size in SIZES:
            experiment = TaxiExperiment(Settings(size=size, learner=learner, repetitions=REPETITIONS))
            for _ in experiment.repetitions():
                done += 1
                progress(done, total)
            results.setdefault(learner, {})[size] = experiment.result()
    return markdown(results)


def markdown(results: dict[str, dict[int, Result]]) -> str:
    """Our rows under the published ones."""
    header = ["learner"] + [f"{size}×{size} {what}" for size in SIZES for what in ("steps", "95 %", "ms/step")]
    header += ["converged"]
    rows = []
    for name, sizes in PUBLISHED.items():
        cells = [sizes.get(size, ("–", "–")) for size in SIZES]
        rows.append([name, *(cell for steps, speed in cells for cell in (steps, "–", speed)), "–"])
    for learner, sized in results.items():
        figures = [cell for size in SIZES for cell in _cells(sized[size])]
        converged = ", ".join(f"{sized[size].converged}/{sized[size].repetitions}" for size in SIZES)
        rows.append([f"**wherry, {learner}**", *figures, converged])
    return (
        f"## Taxi\nSteps until the policy is optimal from six probes, mean ± standard deviation over {REPETITIONS} "
        f"repetitions; rewards learnt.\n\n{markdown_table(header, rows)}\n"
    )


def _cells(result: Result) -> list[str]:
    if result.steps_mean is None or result.steps_sd is None or result.steps_p95 is None:
        return ["–", "–", f"{result.ms_per_step:.2f}"]
    return [f"{result.steps_mean:.0f} ± {result.steps_sd:.0f}", f"{result.steps_p95:.0f}", f"{result.ms_per_step:.2f}"]
