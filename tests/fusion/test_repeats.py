"""Radars that repeat their plots."""

import copy

import numpy as np
import pytest

from tertia import simulate
from tertia.fusion import AngleFusion, fuse_series
from tertia.kalman import SingerModel

MODEL = SingerModel(5.0, 1 / 20, 0.003)
SIGMA, RUNS, STEPS = 0.1, 40, 120
FAULTY = ("robust", "adaptive", "adaptive-matrix")


def plots(radars, rng=3, step=None):
    scene = simulate.radars(MODEL, STEPS, sigma=(SIGMA,) * radars, batch=RUNS, rng=rng)
    return (scene.z if step is None else step * np.round(scene.z / step)), scene.truth


def inside(track, truth, scans):
    off = np.abs(track.mean - truth)[:, scans, 0]
    return np.mean(off < 1.96 * track.sigma[:, scans, 0])


@pytest.mark.parametrize("radars", [2, 3])
@pytest.mark.parametrize("start", [1, 60])
def test_a_radar_that_is_stuck_is_left_out(radars, start):
    """From its second plot, and from the middle on; without it, the others make the track."""
    z, truth = plots(radars)
    z[:, -1, start:] = z[:, -1, start - 1, np.newaxis]
    track = fuse_series(z, SIGMA**2, MODEL)
    late = slice(max(start, 20), STEPS)
    assert inside(track, truth, late) > 0.93
    alone = fuse_series(z[:, :-1], SIGMA**2, MODEL)
    error, others = (
        np.sqrt(np.mean((found.mean - truth)[:, late, 0] ** 2)) for found in (track, alone)
    )
    assert error < 1.05 * others
    assert track.repeated[:, -1, late].mean() > 0.95
    assert not track.repeated[:, :-1].any()
    assert track.outlier[track.repeated].all()
    assert f"repeated plots of radar {radars}" in repr(track)


@pytest.mark.parametrize("method", FAULTY)
def test_a_target_that_is_fast(method):
    """Successive plots are far apart, and tell nothing of the steps in which they are recorded."""
    z = 3.0 * np.arange(40.0) + SIGMA * np.random.default_rng(4).standard_normal((3, 40))
    z[0, 25:] = z[0, 24]
    track = fuse_series(z % 360, SIGMA**2, MODEL, period=360.0, method=method)
    assert track.repeated[0, 26:].all()
    assert not track.repeated[1:].any()


# errors of rounding last if the target hardly moves
@pytest.mark.filterwarnings("ignore:radars differ for long")
@pytest.mark.parametrize("step", [0.1, 0.2])
def test_coarse_steps_are_no_fault(step):
    z, _ = plots(2, step=step)
    track = fuse_series(z, SIGMA**2 + step**2 / 12, MODEL)
    assert not track.repeated.any()
    assert "repeated" not in repr(track)


SLOW = SingerModel(5.0, 1 / 60, 0.02, exact=True)


@pytest.mark.parametrize("sigma", [0.5, 1.0])
def test_coarse_steps_while_another_radar_sees_the_target_move(sigma):
    """The track stayed with the radar that is stuck: RMSE 7.6 degrees, and 58 % inside."""
    random = np.random.default_rng(6)
    truth = 40.0 + 0.25 * np.arange(200) + np.cumsum(0.05 * random.standard_normal((40, 200)), -1)
    z = np.round(truth[:, np.newaxis] + sigma * random.standard_normal((40, 2, 200)))
    healthy = fuse_series(z, sigma**2 + 1 / 12, SLOW)
    assert not healthy.repeated.any()
    z[:, 1, 60:140] = z[:, 1, 59, np.newaxis]
    with pytest.warns(UserWarning, match="were stuck"):
        track = fuse_series(z, sigma**2 + 1 / 12, SLOW)
    off = track.mean[:, 5:, 0] - truth[:, 5:]
    assert np.median(np.sqrt(np.mean(off**2, axis=-1))) < 1.9
    assert np.mean(np.abs(off) < 1.96 * track.sigma[:, 5:, 0]) > 0.82
    assert track.repeated[:, 1, 100:140].mean() > 0.8
    assert track.repeated[:, 0].mean() < 0.005


def test_outliers_between_equal_plots_are_no_motion():
    """After an outlier, all plots were left out until the next one: RMSE 0.45 to 45 degrees."""
    random = np.random.default_rng(7)
    z = 40.4 + 0.2 * random.standard_normal((40, 2, 200))
    wrong = random.random(z.shape) < 0.1
    z[wrong] += 20.0 * random.standard_normal(wrong.sum())
    track = fuse_series(np.round(z), 0.2**2 + 1 / 12, SLOW)
    assert track.repeated[~wrong].mean() < 0.08
    assert np.sqrt(np.mean((track.mean[:, 5:, 0] - 40.4) ** 2)) < 1.0


def test_healthy_radars_do_not_repeat():
    z, _ = plots(3, step=0.01)
    assert fuse_series(z, SIGMA**2, MODEL).repeated.mean() < 1e-3
    assert not fuse_series(plots(3)[0], SIGMA**2, MODEL).repeated.any()


@pytest.mark.parametrize("method", ["central", "paper", "equal"])
def test_other_rules_take_plots_as_they_are(method):
    z, _ = plots(2)
    z[:, 1, 60:] = z[:, 1, 59, np.newaxis]
    assert not fuse_series(z, SIGMA**2, MODEL, method=method).repeated.any()


def test_a_stream_tells_of_repetitions():
    z = plots(3)[0][0]
    z[1, 30:90] = z[1, 29]
    track = fuse_series(z, SIGMA**2, MODEL)
    centre = AngleFusion(MODEL, [SIGMA**2] * 3)
    for step in range(STEPS):
        centre.step(z[:, step]) if step else centre.update(z[:, step])
        if step % 25 == 24:
            centre = copy.deepcopy(centre)
        now = centre.repeated if not np.isnan(z[:, step]).any() else None
        np.testing.assert_array_equal(now, track.repeated[:, step])
        np.testing.assert_array_equal(centre.mean, track.mean[step])


def test_a_state_from_before_repetitions_were_sought():
    centre = AngleFusion(MODEL, [SIGMA**2] * 2)
    centre.update([1.0, 1.2])
    lists, *rest = centre.__getstate__()
    old = AngleFusion(MODEL, [SIGMA**2] * 2)
    old.__setstate__((lists[:-2], *rest))
    assert old.step([1.1, 1.3]) == centre.step([1.1, 1.3])
    with pytest.raises(ValueError, match="not the state of an AngleFusion"):
        old.__setstate__((lists[:-1], *rest))
