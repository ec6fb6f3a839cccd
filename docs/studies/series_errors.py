"""Series fused of sensors that are stuck, rounded to coarse steps, or slowly wrong."""

from dataclasses import dataclass

import numpy as np

from studies.honesty import FloatArray
from studies.montecarlo import autoregressive, generator
from studies.pages import markdown, repetitions
from tertia import simulate
from tertia.fusion import fuse_series
from tertia.kalman import SingerModel

RUNS = repetitions(100, 4)
# scans until filters have settled
SETTLED = 5
# quantile of the normal distribution for 95 %
LIMIT = 1.96


@dataclass(frozen=True)
class Scene:
    """A target whose rate is given, and its sensors: steps of rounding, white and slow noise."""

    model: SingerModel
    steps: int
    rate: float
    unit: str
    white: tuple[float, ...]
    step: float = 0.0
    slow: tuple[float, ...] = ()
    kept: tuple[float, ...] = ()
    """Times for which slow errors are kept."""

    @property
    def stated(self) -> FloatArray:
        """Return the sigmas of whole errors, (K, 1)."""
        variance = np.square(self.white) + self.step**2 / 12
        if self.slow:
            variance = variance + np.square(self.slow)
        return np.sqrt(variance)[:, np.newaxis]

    @property
    def bias(self) -> FloatArray:
        """Return what to state as `bias_sigma`: slow errors, or steps that all sensors share."""
        if self.slow:
            return self.stated[:, 0]
        return np.full(len(self.white), self.step * np.sqrt(len(self.white) / 12))

    def record(self, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Return measured values, (runs, K, steps), and true ones, (runs, steps)."""
        start = rng.uniform(0.0, 1.0, (RUNS, 1, 1))
        drawn = simulate.radars(
            self.model, self.steps, sigma=self.white, rate=self.rate, batch=RUNS, rng=rng
        )
        z = drawn.z + start
        for sensor, (size, kept) in enumerate(zip(self.slow, self.kept, strict=True)):
            z[:, sensor] += size * self._slow(kept, rng)
        return rounded(z, self.step), drawn.truth[..., 0] + start[:, 0]

    def _slow(self, kept: float, rng: np.random.Generator) -> FloatArray:
        """Return errors of variance one that are kept for a time, (runs, steps)."""
        errors = rng.standard_normal((RUNS, self.steps))
        return autoregressive(errors, float(np.exp(-self.model.dt / kept)))


FINDERS = SingerModel(5.0, 1 / 60, 1e-4, exact=True)
AWAY = SingerModel(5.0, 1 / 60, 3e-5, exact=True)
ROOM = SingerModel(60.0, 1 / 3000, 1e-7, exact=True)
CLIMB = SingerModel(1.0, 1 / 20, 0.3, exact=True)
SLOW = {
    "3 thermometers, steps of 0.5 K, noise of 0.05 K": Scene(
        ROOM, 400, 0.0, " K", (0.05, 0.05, 0.05), step=0.5
    ),
    "2 finders, steps of 1°, noise of 0.1°": Scene(AWAY, 200, 0.01, "°", (0.1, 0.1), step=1.0),
    "barometer and satellite receiver, slow errors": Scene(
        CLIMB, 600, 0.0, " m", (0.2, 1.0), slow=(1.5, 4.0), kept=(300.0, 40.0)
    ),
}


def rounded(z: FloatArray, step: float) -> FloatArray:
    """Round values to steps, if there are any."""
    return step * np.round(z / step) if step else z


def fused(scene: Scene, z: FloatArray, truth: FloatArray, **options: object) -> str:
    """Return the RMSE of fused values and the share within the 95 % intervals."""
    found = fuse_series(z, scene.stated**2, scene.model, **options)  # type: ignore[arg-type]
    error = (found.mean[..., 0] - truth)[:, SETTLED:]
    inside = np.abs(error) < LIMIT * found.sigma[:, SETTLED:, 0]
    return f"{np.sqrt(np.mean(error**2)):.2g}{scene.unit}; {inside.mean():.0%}"


def slow() -> str:
    """Tabulate errors and coverage of sensors whose errors are not new in each measurement."""
    rows = []
    for number, (name, scene) in enumerate(SLOW.items()):
        z, truth = scene.record(generator(621, number))
        options: tuple[dict[str, object], ...] = (
            {},
            {"correlation_time": None},
            {"bias_sigma": scene.bias},
        )
        rows.append([name, *(fused(scene, z, truth, **one) for one in options)])
    return markdown(["sensors", "default", "`correlation_time=None`", "`bias_sigma`"], rows)


def stuck() -> str:
    """Tabulate the same of finders in whole degrees of which the last is stuck for a while."""
    rows = []
    for sigma in (0.5, 1.0, 2.0):
        row = [f"{sigma:g}°"]
        for count in (2, 3):
            scene = Scene(FINDERS, 200, 0.05, "°", (sigma,) * count, step=1.0)
            z, truth = scene.record(generator(622, round(10 * sigma), count))
            row.append(fused(scene, z, truth))
            z[:, -1, 60:140] = z[:, -1, 60:61]
            row.append(fused(scene, z, truth))
        rows.append(row)
    head = ["σ", "2 finders", "one of 2 is stuck", "3 finders", "one of 3 is stuck"]
    return markdown(head, rows)
