"""Errors of radars over the time of a recording, versus those that were simulated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from studies.pages import markdown, repetitions
from studies.registration import ERRORS, SET_UPS, columns
from studies.registration_bound import CONSTANT, DURATION, LIMITS, STEP, Scene, scene, step_of
from tertia import simulate
from tertia._arrays import FloatArray
from tertia.registration import Registration, register

# scenes are others than those of the bound
FIRST, SCENES = 100, repetitions(20, 1)
# when the errors of the second radar change, in seconds, and by how much
CHANGE = 330.0
STEPS = {
    "0.2° at once": ("azimuth", np.radians(0.2).item()),
    "0.8° at once": ("azimuth", np.radians(0.8).item()),
    "300 m at once": ("range", 300.0),
}
TAKEN = "drifting, taken as constant"
COURSES = ("constant", "drifting", TAKEN, *STEPS)


def recording(name: simulate.SetUpName, course: str, seed: int) -> Scene:
    """Return a recording with errors that are constant, drift or change suddenly."""
    found = scene(name, "drifting" if course.startswith("drifting") else "normal", FIRST + seed)
    if course == TAKEN:
        return replace(found, stated=[replace(radar, bias=CONSTANT) for radar in found.stated])
    if course not in STEPS:
        return found
    kind, size = STEPS[course]
    plots, errors = found.plots, found.errors.copy()
    errors[step_of(np.arange(0.0, DURATION, STEP) + STEP / 2) >= CHANGE / STEP, 1] += size * (
        np.array(ERRORS) == kind
    )
    later = (plots.sensor == 1) & (plots.time >= CHANGE)
    if kind == "azimuth":
        moved = replace(plots, azimuth=plots.azimuth + size * later)
    else:
        moved = replace(plots, range=plots.range + size * later)
    return replace(found, plots=moved, errors=errors)


def off(found: Registration, one: Scene) -> tuple[FloatArray, FloatArray]:
    """Return errors over their sigmas and over the limits, except near a change, (T, K, 4)."""
    edges = found.bias_history.edges
    middle = (edges[:-1] + edges[1:]) / 2
    far = np.abs(middle - CHANGE) > edges[1] - edges[0]
    value, sigma = (
        np.stack([columns(bias, suffix) for bias in found.bias_history.bias])[far]
        for suffix in ("", "_sigma")
    )
    error = value - one.errors[step_of(middle[far])]
    return error / sigma, error / LIMITS


def row(name: simulate.SetUpName, course: str) -> list[str]:
    """Return how many errors are within two sigmas, their size, and the numbers of changes."""
    each, found, others = [], 0, 0
    for seed in range(SCENES):
        one = recording(name, course, seed)
        registration = register(one.plots, one.stated)
        each.append(off(registration, one))
        edges = registration.bias_history.edges
        near = sum(
            course in STEPS and sensor == 1 and abs(time - CHANGE) < 2 * (edges[1] - edges[0])
            for time, sensor in registration.changes
        )
        found += near > 0
        others += len(registration.changes) - near
    normalised, size = (np.concatenate(one) for one in zip(*each, strict=True))
    inside = np.mean(np.abs(normalised) < 2.0, axis=(0, 1))
    rms = np.sqrt(np.mean(size**2, axis=(0, 1)))
    cells = [*(f"{share:.0%}" for share in inside), *(f"{one:.2f}" for one in rms)]
    changes = f"{found} of {SCENES}" if course in STEPS else "-"
    return [name, course, *cells, changes, f"{others}"]


def table() -> str:
    """Tabulate how many errors are within two sigmas, their size, and changes."""
    kinds = ("range", "gain", "azimuth", "time")
    head = ["", "errors", *(f"within 2σ: {kind}" for kind in kinds)]
    head += [*(f"{kind}, in limits" for kind in kinds), "changes found", "false changes"]
    return markdown(head, [row(name, course) for name in SET_UPS for course in COURSES])
