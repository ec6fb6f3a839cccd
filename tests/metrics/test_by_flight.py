"""Intervals of indicators, by flight."""

from types import SimpleNamespace

import numpy as np
import pytest
import scipy.stats

from tertia.metrics import Truth, indicators
from tertia.metrics._by_flight import mean_by_flight, share_by_flight, share_interval
from tertia.metrics._indicator import text


def test_wilson_of_962_of_1000():
    low, high = share_interval(0.962, 1000.0, np.inf, 0.95)
    assert (low, high) == (
        pytest.approx(0.9482730796686, rel=1e-12),
        pytest.approx(0.9721909954907, rel=1e-12),
    )
    # worth a quarter of them
    low, high = share_interval(0.962, 250.0, np.inf, 0.95)
    assert (low, high) == (
        pytest.approx(0.930470788439, rel=1e-12),
        pytest.approx(0.9795460428272, rel=1e-12),
    )
    # with quantiles of Student's distribution: roots of |p − s| = t sqrt(p (1 − p)/n)
    t = scipy.stats.t.ppf(0.975, 19)
    low, high = share_interval(0.962, 250.0, 19.0, 0.95)
    for p in (low, high):
        assert abs(p - 0.962) == pytest.approx(t * np.sqrt(p * (1 - p) / 250.0), rel=1e-9)
    # none of n: the probability of that is 1 − level
    low, high = share_interval(1.0, 100.0, np.inf, 0.95)
    assert (low**100, high) == (pytest.approx(0.05), 1.0)
    low, high = share_interval(0.0, 100.0, np.inf, 0.95)
    assert (low, (1 - high) ** 100) == (0.0, pytest.approx(0.05))


def test_the_design_effect_by_hand():
    hits, counts = np.array([8.0, 10.0, 3.0]), np.array([10.0, 10.0, 5.0])
    share = 21 / 25
    spread = 3 / 2 * np.sum((hits - share * counts) ** 2) / 25**2
    found = share_by_flight(hits, counts, 0.95, None, least=True)
    assert found.value == pytest.approx(share)
    assert found.count == 25
    assert found.effective_number == pytest.approx(share * (1 - share) / spread)
    assert (found.low, found.high) == share_interval(share, found.effective_number, 2.0, 0.95)
    # one flight says nothing about how flights differ
    alone = share_by_flight(hits[:1], counts[:1], 0.95, None, least=True)
    assert alone.effective_number == 2.5


@pytest.mark.parametrize("flights", [3, 20, 60])
def test_intervals_hold_where_flights_differ(flights):
    """Hits of flights are beta-binomial: some flights are seen worse than others all the time."""
    random = np.random.default_rng(flights)
    cover = {"share": [], "root": [], "independent": []}
    for _ in range(600):
        counts = random.integers(40, 160, flights).astype(float)
        hits = random.binomial(counts.astype(int), random.beta(19, 1, flights)).astype(float)
        found = share_by_flight(hits, counts, 0.95, None, least=True)
        cover["share"].append(found.low <= 0.95 <= found.high)
        low, high = share_interval(found.value, counts.sum(), np.inf, 0.95)
        cover["independent"].append(low <= 0.95 <= high)
        scale = random.gamma(4.0, 0.25, flights)
        squares = scale * random.chisquare(2 * counts) / 2
        found = mean_by_flight(squares, counts, 0.95, None, count=1, root=True)
        cover["root"].append(found.low <= 1.0 <= found.high)
    # few flights may all be seen alike, and the usual design effect is then assumed
    assert 0.90 < np.mean(cover["share"]) < (1.0 if flights == 3 else 0.985)
    assert 0.90 < np.mean(cover["root"]) < 0.985
    # as if all updates were independent
    assert np.mean(cover["independent"]) < 0.75


def drawn_ages(random, flights):
    """Return integrals of the age of the data, and times; some flights are seen worse."""
    gaps = random.geometric(random.beta(19, 1, (flights, 1)), (flights, 80)).astype(float)
    return np.sum(gaps**2, axis=1) / 2, np.sum(gaps, axis=1)


@pytest.mark.parametrize("flights", [3, 12, 60])
def test_intervals_of_the_mean_age_hold_where_flights_differ(flights):
    random = np.random.default_rng(flights)
    integrals, times = drawn_ages(random, 200_000)
    true = np.sum(integrals) / np.sum(times)
    held = []
    for _ in range(600):
        found = mean_by_flight(*drawn_ages(random, flights), 0.95, None, count=1)
        held.append(found.low <= true <= found.high)
    assert 0.82 < np.mean(held) < 0.985


def test_limits_are_met_not_met_or_not_shown():
    time = np.arange(0.0, 400.0, 4.0)
    place = np.column_stack([100.0 * time, 0.0 * time])
    flights = [np.column_stack([place[:, 0], np.full(len(time), 5e3 * k)]) for k in range(10)]
    truth = Truth(np.tile(time, 10), np.repeat(np.arange(10), len(time)), np.concatenate(flights))
    kept = np.random.default_rng(2).random(10 * len(time)) < 0.95
    tracks = SimpleNamespace(
        time=truth.time[kept],
        track=np.repeat(np.arange(10), len(time))[kept],
        position=np.concatenate(flights)[kept] + 30.0,
    )
    verdicts = {}
    for limit in (0.9, 0.95, 0.99):
        found = indicators(
            tracks,
            truth,
            max_distance=500,
            update_interval=4,
            limits={"probability_of_update": limit, "rmse": 100.0},
        )
        verdicts[limit] = found.probability_of_update.verdict
    assert verdicts == {0.9: "met", 0.95: "not shown", 0.99: "not met"}
    assert found.rmse.verdict == "met"
    assert found.rmse.value == pytest.approx(30 * np.sqrt(2))
    assert found.long_gap_ratio.verdict == ""
    options = {"max_distance": 500, "update_interval": 4}
    wider = indicators(tracks, truth, confidence_level=0.99, **options).probability_of_update
    assert wider.low < found.probability_of_update.low < found.probability_of_update.high
    for wrong, message in (
        ({"limits": {"speed": 1.0}}, "limits has 'speed'; it may have continuity, "),
        ({"confidence_level": 1.0}, "confidence_level is 1"),
    ):
        with pytest.raises(ValueError, match=message):
            indicators(tracks, truth, **options, **wrong)


def test_texts_of_intervals():
    assert text(0.0, 0.0, 1.2) == ("0.0", "(0.0 to 1.2)")
    assert text(0.0, 0.0, np.inf) == ("0.00", "(at least 0.00)")
    assert text(2.0, 1.0, 5000.0) == ("2.0", "(at least 1.0)")
    assert text(2.0, 1.5, 2.5) == ("2.0", "(1.5 to 2.5)")
