"""Errors as they are in the field, and the tables of `docs/honesty.md` made with them."""

import zlib
from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt

from studies.montecarlo import generator
from studies.pages import markdown

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

# coverage of 95 % outside of these is set in bold
LOW, HIGH = 0.85, 0.99
STOPS = 10
OUTLIERS = {f"{share} % outliers": share / 100 for share in (10, 20, 30)}
CORRELATIONS = {"AR(.5)": 0.5, "AR(.9)": 0.9}
MISSTATED = {"sigma × ½": 2.0, "sigma × 2": 0.5}
CASES = (
    "white",
    *CORRELATIONS,
    "biased per stop",
    "direction-dependent",
    *MISSTATED,
    *OUTLIERS,
)


class Draw:
    """A source of errors of measurement in units of the stated sigma, of one of the `CASES`.

    Every sensor has its own; the last axis is time, the one before it the sensor.
    """

    def __init__(self, case: str, rng: np.random.Generator) -> None:
        """Take the case and the source of randomness."""
        self.case, self.rng = case, rng

    def __call__(self, shape: tuple[int, ...], azimuth: FloatArray | None = None) -> FloatArray:
        """Return errors of this shape, (..., sensors, steps).

        `azimuth`, of the same shape, in radians: where the targets are, for errors that depend on
        the direction. By default they pass through a third of a circle.
        """
        white = self.rng.standard_normal(shape)
        if self.case in CORRELATIONS:
            return _autoregressive(white, CORRELATIONS[self.case])
        if self.case in MISSTATED:
            return MISSTATED[self.case] * white
        if self.case in OUTLIERS:
            hit = self.rng.uniform(size=shape) < OUTLIERS[self.case]
            size = self.rng.uniform(5.0, 15.0, shape) * self.rng.choice([-1.0, 1.0], shape)
            return white + np.where(hit, size, 0.0)
        if self.case == "biased per stop":
            return white + self.rng.standard_normal((*shape[:-1], STOPS))[..., stops(shape[-1])]
        if self.case == "direction-dependent":
            if azimuth is None:
                azimuth = np.linspace(0.0, 2 * np.pi / 3, shape[-1])
            return white + self._deviation(shape[:-1], azimuth)
        return white

    def _deviation(self, sensors: tuple[int, ...], azimuth: FloatArray) -> FloatArray:
        """Return a Fourier series of the azimuth of order two, of variance one."""
        size, phase = (
            self.rng.standard_normal((2, *sensors, 1)),
            self.rng.uniform(0.0, 2 * np.pi, (2, *sensors, 1)),
        )
        first, second = (size[i] * np.sin((i + 1) * azimuth + phase[i]) for i in range(2))
        return np.asarray(first + second)


def stops(steps: int) -> IntArray:
    """Return which of the stops each step belongs to: the groups that share a systematic error."""
    return np.arange(steps) * STOPS // steps


def coverage_table(estimators: Mapping[str, Callable[[Draw], BoolArray]], study: int) -> str:
    """Return how often each estimator's 95 % region holds the truth, case by case.

    An estimator gets the source of errors and returns, for each of its runs, whether the truth was
    inside; nan or no estimate counts as outside.
    """
    rows = []
    for name, inside in estimators.items():
        cells = []
        for case in CASES:
            rng = generator(study, zlib.crc32(f"{name}, {case}".encode()))
            share = float(np.mean(inside(Draw(case, rng))))
            cells.append(f"{share:.0%}" if LOW <= share <= HIGH else f"**{share:.0%}**")
        rows.append([name, *cells])
    return markdown(["claimed 95 %", *CASES], rows)


def _autoregressive(white: FloatArray, correlation: float) -> FloatArray:
    errors: FloatArray = white.copy()
    scale = np.sqrt(1 - correlation**2)
    for step in range(1, white.shape[-1]):
        errors[..., step] = correlation * errors[..., step - 1] + scale * white[..., step]
    return errors
