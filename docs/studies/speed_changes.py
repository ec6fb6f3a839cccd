"""Changes of speed in the tracker: with their model, and as if speeds never changed."""

from __future__ import annotations

import numpy as np

from studies.montecarlo import WITHIN_95
from studies.pages import markdown
from studies.smooth_tracks import PARTS, RADARS, Errors, of_table, parts, plots_of
from tertia.tracker import ImmModel, track

# flights of no other table
SEED = 1
KIND = "turns and speed changes"


def table() -> str:
    """Return errors of position and velocity with and without the model, by what targets do."""
    rows = []
    for radars, sensors in RADARS.items():
        plots = plots_of(KIND, radars, SEED)
        without, found = (
            of_table(KIND, track(plots, sensors, motion=motion), SEED)
            for motion in (ImmModel(steady_time=1e12), ImmModel())
        )
        for part in parts(KIND):
            pair = (without, found)
            rows.append(
                [
                    radars,
                    PARTS[part],
                    *(f"{of.rms(part):.1f}" for of in pair),
                    *(f"{of.rms(part, 'velocity'):.1f}" for of in pair),
                    *(f"{of.nees(part, 'velocity_nees'):.2f}" for of in pair),
                    *(f"{inside(of, part):.0%}" for of in pair),
                ]
            )
    names = ("position, m", "velocity, m/s", "NEES, velocity", "velocities inside 95 %")
    head = [f"{name}{with_it}" for name in names for with_it in (" (without)", "")]
    return markdown(["radars", "part", *head], rows)


def inside(of: Errors, part: int) -> float:
    """Return the share of velocities within the 95 % region."""
    own = of.velocity_nees[of.counted & (of.part == part)]
    return float(np.mean(2 * own <= WITHIN_95[2]))
