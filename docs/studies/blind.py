"""Whether the findings of a report tell which radar is faulty, and how: a table of report.md."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from studies.montecarlo import generator
from studies.pages import markdown, repetitions
from tertia import report, simulate
from tertia.sensors import Bias, Radar

SCENES, AIRCRAFT = repetitions(3, least=1), repetitions(25, 12)
DURATION = float(repetitions(900, 250))
PLACES = ((0.0, 0.0), (60e3, -30e3), (-20e3, 70e3))
# faults: their texts in findings, systematic errors, or factors of the noise
FAULTS: dict[str, tuple[str, dict[str, float]]] = {
    "range 200 m": ("range bias", {"range": 200.0}),
    "azimuth 0.3°": ("azimuth bias", {"azimuth": float(np.radians(0.3))}),
    "clock 1 s": ("clock", {"time": 1.0}),
    "noise of the range twice as large": ("range sigma", {"range_sigma": 2.0}),
    "noise of the azimuth twice as large": ("azimuth sigma", {"azimuth_sigma": 2.0}),
}
RADARS = [
    Radar(place, range_sigma=60.0, azimuth_sigma=np.radians(0.1), scan_period=4.0 + k,
          max_range=200e3, name=f"radar-{k + 1}")
    for k, place in enumerate(PLACES)
]  # fmt: skip


def findings(rng: np.random.Generator, faulty: int, fault: dict[str, float]) -> list[str]:
    """Return the findings of a quarter of an hour with one faulty radar."""
    real = list(RADARS)
    errors: dict[str, Any] = {}
    for name, value in fault.items():
        if name.endswith("sigma"):
            scaled: dict[str, Any] = {name: value * getattr(real[faulty], name)}
            real[faulty] = replace(real[faulty], **scaled)
        else:
            errors[name] = np.where(np.arange(len(real)) == faulty, value, 0.0)
    traffic = simulate.dense_traffic(AIRCRAFT, area=(150e3, 150e3), duration=DURATION, rng=rng)
    seen = simulate.radar_plots(traffic, real, clutter=10, bias=Bias(**errors), rng=rng)
    stated: list[str] = report.make(seen.plots, RADARS).summary["findings"]
    # what the errors would cost names no fault
    return [text for text in stated if not text.startswith("Without correction")]


def blind() -> str:
    """Tabulate by fault how often the findings name it, and what else they say."""
    rows = []
    for number, (title, (words, fault)) in enumerate(FAULTS.items()):
        named = others = 0
        example = ""
        for scene in range(SCENES):
            rng = generator(291, number, scene)
            faulty = int(rng.integers(len(RADARS)))
            stated = findings(rng, faulty, fault)
            right = [text for text in stated if text.startswith(f"radar-{faulty + 1}: {words}")]
            named, others = named + bool(right), others + len(stated) - len(right)
            example = example or "".join(right)
        rows.append([title, f"{named} of {SCENES}", str(others), example])
    head = ["fault of one radar", "fault named", "other findings"]
    return markdown([*head, "finding of the first recording"], rows)
