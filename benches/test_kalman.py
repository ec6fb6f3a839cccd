"""Cost of the filter, its object, the smoother and the fit of the noise from Python."""

import numpy as np
import pytest

from tertia.kalman import AngleFilter, SingerModel, filter_series, fit_noise, smooth_series

MODEL = SingerModel(5.0, 1 / 20, 0.003)
R = 0.01
SHAPES = pytest.mark.parametrize("shape", [(10_000,), (1_000, 200), (20_000, 50)], ids=str)
GAPS = pytest.mark.parametrize("gaps", [0.0, 0.05], ids=["no gaps", "5 % gaps"])


def plots(shape, gaps):
    rng = np.random.default_rng(1)
    z = 10.0 * np.sin(np.arange(shape[-1]) / 50) + R**0.5 * rng.standard_normal(shape)
    z[rng.random(shape) < gaps] = np.nan
    return z


@SHAPES
@GAPS
@pytest.mark.parametrize("store", ["final", "mean", "all"])
def test_filter_series(benchmark, shape, gaps, store):
    z = plots(shape, gaps)
    benchmark.extra_info["plots"] = z.size
    benchmark(filter_series, z, R, MODEL, store=store, n_threads=1)


@SHAPES
@GAPS
def test_smooth_series(benchmark, shape, gaps):
    z = plots(shape, gaps)
    benchmark.extra_info["plots"] = z.size
    benchmark(smooth_series, z, R, MODEL, n_threads=1)


@pytest.mark.parametrize("period", [None, 360.0])
def test_step(benchmark, period):
    track = AngleFilter(MODEL, R, period=period)
    for plot in plots((100,), 0.0):
        track.step(plot)
    benchmark(track.step, 1.0)


def test_fit_noise(benchmark):
    benchmark(fit_noise, plots((1_000,), 0.0), dt=5.0, n_threads=1)
