"""Simulated bearings have the rates and sizes that they promise."""

import numpy as np
import pytest

from tertia.simulate import direction_finder


def test_the_defaults_have_the_rates_they_promise():
    records = direction_finder(100, batch=20_000, rng=1)
    clean = ~(records.single | records.burst)
    # .75 bursts of 7 measurements on average; those that meet are counted once
    assert records.burst.mean() == pytest.approx(0.0512, abs=0.001)
    assert records.single.mean() == pytest.approx(0.02 * (1 - 0.0512), abs=0.0005)
    error = (records.theta + 180) % 360 - 180
    assert error[clean].mean() == pytest.approx(0, abs=4 * 3.4 / np.sqrt(clean.sum()))
    assert error[clean].std() == pytest.approx(3.4, rel=0.005)
    single = error[records.single]
    assert (single > 0).mean() == pytest.approx(0.6, abs=0.01)
    assert np.abs(single).mean() == pytest.approx(4 * 3.4, rel=0.01)


def test_a_burst_has_one_offset():
    """Without noise, and with so few bursts that two hardly ever touch."""
    records = direction_finder(
        100, sigma=1e-9, amplitude=(1e9, 5e9), single_probability=0, period=None, batch=500, rng=2
    )
    runs = [
        theta[burst]
        for theta, burst in zip(records.theta, records.burst, strict=True)
        if 4 <= burst.sum() <= 10 and np.ptp(np.flatnonzero(burst)) == burst.sum() - 1
    ]
    assert len(runs) > 100
    assert all(1 - 1e-6 < abs(offset) < 5 + 1e-6 for run in runs for offset in run)
    assert np.mean([np.ptp(run) < 1e-7 for run in runs]) > 0.99


def test_bursts_have_the_number_length_place_sign_and_size_they_promise():
    """So few that a record hardly ever has two: what is measured is one burst."""
    records = direction_finder(
        200,
        sigma=1.0,
        bursts_per_100=0.01,
        burst_length=(3, 7),
        amplitude=(20.0, 40.0),
        single_probability=0,
        positive_probability=0.3,
        period=None,
        batch=200_000,
        rng=7,
    )
    length = records.burst.sum(axis=1)
    hit = length > 0
    count = hit.sum()
    # P(at least one of Poisson(0.02))
    expected = 1 - np.exp(-0.02)
    assert hit.mean() == pytest.approx(expected, abs=4 * np.sqrt(expected / hit.size))
    # the few records with two are 1 % and lengthen the mean by as much
    shares = np.bincount(length[hit], minlength=8)[3:8] / count
    np.testing.assert_allclose(shares, 0.2, atol=0.01 + 4 * np.sqrt(0.16 / count))
    offset = (records.theta * records.burst)[hit].sum(axis=1) / length[hit]
    assert (offset > 0).mean() == pytest.approx(0.3, abs=4 * np.sqrt(0.21 / count))
    size = np.abs(offset)[length[hit] <= 7]
    assert size.mean() == pytest.approx(30, abs=4 * 20 / np.sqrt(12 * count))
    start = records.burst[hit].argmax(axis=1)
    # uniform over the 201 - length places: mean (200 - 5)/2
    assert start.mean() == pytest.approx(97.5, abs=2.5 + 4 * 195 / np.sqrt(12 * count))
    assert start.min() < 4
    assert records.burst[:, -1].any()


def test_noise_is_normal():
    noise = direction_finder(
        500_000, sigma=2.0, single_probability=0, bursts_per_100=0, period=None, rng=8
    ).theta
    # standard errors of the standardised moments: sqrt(6/n), sqrt(24/n)
    score = (noise - noise.mean()) / noise.std()
    assert np.mean(score**3) == pytest.approx(0, abs=4 * np.sqrt(6 / noise.size))
    assert np.mean(score**4) == pytest.approx(3, abs=4 * np.sqrt(24 / noise.size))
    lag = np.mean(score[1:] * score[:-1])
    assert lag == pytest.approx(0, abs=4 / np.sqrt(noise.size))


def test_a_measurement_is_a_single_anomaly_or_in_a_burst_not_both():
    records = direction_finder(100, single_probability=0.3, bursts_per_100=3, batch=50, rng=9)
    assert not (records.single & records.burst).any()
    assert records.single.any()
    assert records.burst.any()


def test_a_seed_gives_the_same_record_and_a_generator_goes_on():
    first, second = (direction_finder(50, rng=3).theta for _ in range(2))
    np.testing.assert_array_equal(first, second)
    generator = np.random.default_rng(3)
    np.testing.assert_array_equal(direction_finder(50, rng=generator).theta, first)
    assert not np.array_equal(direction_finder(50, rng=generator).theta, first)


@pytest.mark.parametrize(("batch", "shape"), [((), (9,)), (4, (4, 9)), ((2, 0), (2, 0, 9))])
def test_shapes(batch, shape):
    record = direction_finder(9, batch=batch, rng=4)
    assert record.theta.shape == record.single.shape == record.burst.shape == shape


def test_bearings_are_wrapped_to_the_period():
    theta = direction_finder(2000, bearing=0.0, rng=5).theta
    assert theta.min() >= 0
    assert theta.max() < 360
    assert direction_finder(2000, bearing=0.0, period=None, rng=5).theta.min() < 0


def test_bursts_longer_than_the_record_fill_it():
    record = direction_finder(3, bursts_per_100=1e4, burst_length=(8, 9), rng=6)
    assert record.burst.all()


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"n": 0}, ValueError, "n is 0"),
        ({"n": 2.5}, TypeError, "n is 2.5"),
        ({"sigma": -1}, ValueError, "sigma is -1"),
        ({"sigma": "1"}, TypeError, "sigma is '1'"),
        ({"bearing": np.nan}, ValueError, "bearing is nan"),
        ({"single_probability": 1.5}, ValueError, "single_probability is 1.5"),
        ({"positive_probability": -0.1}, ValueError, "positive_probability is -0.1"),
        ({"bursts_per_100": np.inf}, ValueError, "bursts_per_100 is inf"),
        ({"burst_length": (5, 4)}, ValueError, r"burst_length is \(5, 4\)"),
        ({"burst_length": 4}, TypeError, "burst_length is 4; it must be a pair"),
        ({"amplitude": (3, np.inf)}, ValueError, "amplitude is"),
        ({"period": 0}, ValueError, "period is 0"),
        ({"batch": -1}, ValueError, "batch is -1"),
        ({"batch": 1.5}, TypeError, "batch is 1.5"),
        ({"rng": "x"}, TypeError, "rng is 'x'"),
        ({"rng": 1.5}, TypeError, "rng is 1.5"),
        ({"rng": -1}, ValueError, "rng is -1"),
    ],
)
def test_bad_parameters(options, error, message):
    with pytest.raises(error, match=message):
        direction_finder(**{"n": 10, **options})
