"""Cost of fusing the plots of several radars from Python, by method and number of radars."""

from typing import get_args

import numpy as np
import pytest

from tertia.fusion import AngleFusion, FusionMethod, InstantMethod, fuse, fuse_series
from tertia.kalman import SingerModel

MODEL = SingerModel(5.0, 1 / 20, 0.003)
R = 0.01


def plots(shape, gaps):
    rng = np.random.default_rng(1)
    z = 10.0 * np.sin(np.arange(shape[-1]) / 50) + R**0.5 * rng.standard_normal(shape)
    z[rng.random(shape) < gaps] = np.nan
    return z


@pytest.mark.parametrize("shape", [(2, 2_000), (3, 2_000), (8, 2_000), (1_000, 2, 200)], ids=str)
@pytest.mark.parametrize("gaps", [0.0, 0.05], ids=["no gaps", "5 % gaps"])
def test_fuse_series(benchmark, shape, gaps):
    z = plots(shape, gaps)
    benchmark.extra_info["plots"] = z.size
    benchmark(fuse_series, z, R, MODEL, n_threads=1)


@pytest.mark.parametrize("radars", [2, 4])
@pytest.mark.parametrize("method", get_args(FusionMethod))
def test_method(benchmark, method, radars):
    z = plots((radars, 2_000), 0.0)
    benchmark.extra_info["plots"] = z.size
    benchmark(fuse_series, z, R, MODEL, method=method, n_threads=1)


@pytest.mark.parametrize("radars", [2, 8])
def test_step(benchmark, radars):
    centre = AngleFusion(MODEL, [R] * radars)
    for scan in plots((radars, 100), 0.0).T:
        centre.step(scan)
    benchmark(centre.step, [1.0] * radars)


@pytest.mark.parametrize("correlated", [False, True], ids=["independent", "correlated"])
@pytest.mark.parametrize(("k", "m"), [(2, 3), (4, 6), (3, 12)])
@pytest.mark.parametrize("method", get_args(InstantMethod))
def test_fuse(benchmark, method, k, m, correlated):
    rng = np.random.default_rng(2)
    roots = rng.standard_normal((1_000, k, m, m))
    s = roots @ roots.swapaxes(-1, -2) + np.eye(m)
    options = {"weights": np.ones(k)} if method == "static" else {}
    if correlated:
        options["cross_covariances"] = np.broadcast_to(0.1 * np.eye(m), (1_000, k, k, m, m)).copy()
    x = rng.standard_normal((1_000, k, m))
    benchmark.extra_info["instants"] = 1_000
    benchmark(fuse, x, s, method=method, n_threads=1, **options)
