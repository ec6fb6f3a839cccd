"""Regions around positions, circular errors and protection levels: against formulas and truth."""

import itertools

import numpy as np
import pytest
from scipy import optimize, stats

from tertia.location import LocationStatus, Region, locate
from tertia.sensors import Bias

NAN, INF = float("nan"), float("inf")
RING = 5000 * np.stack([np.sin(np.arange(6)), np.cos(np.arange(6))], axis=-1)
TARGET = np.array([700.0, -400.0])
LEAST = {"method": "least-squares"}
TRUSTED = {**LEAST, "bias": Bias()}


def ranges_of(places, target, errors):
    """Return ranges with errors in metres."""
    return np.linalg.norm(places - target, axis=-1) + errors


def bearings_of(places, target, errors):
    """Return azimuths with errors in radians."""
    d = target - places
    return np.arctan2(d[:, 0], d[:, 1]) + errors


def outside(r, covariance):
    """Return the probability of an error beyond r, by summation over 4096 angles."""
    angle = (np.arange(4096) + 0.5) * 2 * np.pi / 4096
    way = np.stack([np.cos(angle), np.sin(angle)])
    q = np.einsum("ia,ij,ja->a", way, np.linalg.inv(covariance), way)
    return np.mean(np.exp(-(r**2) * q / 2) / q) / np.sqrt(np.linalg.det(covariance))


def level(rows, residuals, *, risk=1e-5, p=1e-4, faults=1, false_alarm=1e-3):
    """Return the protection level of whitened rows, or inf, as the formulas stand."""
    count = len(rows)

    def solved(keep):
        covariance = np.linalg.inv(rows[keep].T @ rows[keep])
        return covariance[:2, :2], (covariance @ rows[keep].T @ residuals[keep])[:2]

    own, moved = solved(np.arange(count))
    sets = [
        out for size in range(1, faults + 1) for out in itertools.combinations(range(count), size)
    ]
    modes = []
    for out in sets:
        without, shifted = solved(np.setdiff1d(np.arange(count), out))
        limit = stats.chi2.isf(false_alarm / len(sets), min(len(out), 2))
        values, vectors = np.linalg.eigh(without - own)
        along = vectors.T @ (shifted - moved)
        rank = min(len(out), 2)
        if np.sum(along[-rank:] ** 2 / values[-rank:]) > limit:
            return INF
        weight = p ** len(out) * (1 - p) ** (count - len(out))
        modes.append((weight, np.sqrt(limit * values[-1]), without))
    rest = stats.binom.sf(faults, count, p)

    def excess(r):
        total = outside(r, own) + rest
        for weight, threshold, without in modes:
            total += weight * (outside(r - threshold, without) if r > threshold else 1.0)
        return np.log(total / risk)

    if rest >= risk:
        return INF
    return optimize.brentq(excess, 1e-3, 1e6, xtol=1e-10) + np.linalg.norm(moved)


def test_an_ellipse():
    errors = np.array([3.0, -5, 8, -2, 4, 1])
    fix = locate(RING, range=ranges_of(RING, TARGET, errors), range_sigma=10.0, **LEAST)
    region = fix.region(0.9)
    values, vectors = np.linalg.eigh(fix.covariance)
    axes = np.sqrt(stats.chi2.ppf(0.9, 2) * values)
    np.testing.assert_allclose([region.semi_minor, region.semi_major], axes, rtol=1e-9)
    assert region.area == pytest.approx(np.pi * axes.prod(), rel=1e-9)
    east, north = vectors[:, -1]
    assert region.orientation == pytest.approx(np.arctan2(east, north) % np.pi, abs=1e-9)
    (ring,) = region.polygon
    d = ring - fix.position
    distance = np.einsum("ni,ij,nj->n", d, np.linalg.inv(fix.covariance), d)
    np.testing.assert_allclose(distance, stats.chi2.ppf(0.9, 2), rtol=1e-3)
    x, y = ring.T
    assert np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) / 2 == pytest.approx(region.area)
    assert outside(fix.cep(0.8), fix.covariance) == pytest.approx(0.2, rel=1e-9)
    assert "m²" in repr(region)
    assert isinstance(region, Region)


def test_a_batch_and_a_point_for_each():
    rng = np.random.default_rng(1)
    errors = rng.normal(0, 10, (7, 6))
    fixes = locate(RING, range=ranges_of(RING, TARGET, errors), range_sigma=10.0, **LEAST)
    region = fixes.region()
    assert region.area.shape == region.polygon.shape == (7,)
    assert region.contains(fixes.position).all()
    assert not region.contains([0.0, 0.0]).any()
    one = locate(RING, range=ranges_of(RING, TARGET, errors[2]), range_sigma=10.0, **LEAST)
    np.testing.assert_allclose(one.region().polygon[0], region.polygon[2][0], rtol=1e-12)
    assert fixes.cep().shape == fixes.protection_level().shape == (7,)
    with pytest.raises(ValueError, match=r"position has shape \(3, 1\)"):
        region.contains(np.zeros((3, 1)))


def test_in_space_from_above():
    places = np.column_stack([RING, [0, 400, 20, 900, 100, 5]])
    target = np.array([*TARGET, 3000.0])
    fix = locate(places, range=ranges_of(places, target, 3.0), range_sigma=10.0, **LEAST)
    horizontal = fix.covariance[:2, :2]
    determinant = np.linalg.det(horizontal)
    assert fix.region().area == pytest.approx(
        np.pi * stats.chi2.ppf(0.95, 2) * np.sqrt(determinant)
    )
    assert outside(fix.cep(), horizontal) == pytest.approx(0.5, rel=1e-9)
    assert np.isfinite(fix.protection_level())


@pytest.mark.parametrize("n", [3, 4])
def test_coverage_where_sigma_is_estimated(n):
    """The ellipse with quantiles of chi-square contained 62 and 70 %."""
    rng = np.random.default_rng([2, n])
    places, inside = (
        2000 * np.stack([np.sin(2.4 * np.arange(n)), np.cos(2.4 * np.arange(n))], -1),
        [],
    )
    azimuth = bearings_of(places, np.zeros(2), np.radians(2) * rng.standard_normal((1000, n)))
    fixes = locate(places, azimuth=azimuth, **LEAST)
    inside = fixes.region(0.95).contains([0.0, 0.0])[fixes.success]
    assert abs(inside.mean() - 0.95) < 4 * np.sqrt(0.95 * 0.05 / inside.size)
    pooled = locate(places, azimuth=azimuth, pooled=True, **LEAST)
    inside = pooled.region(0.95).contains([0.0, 0.0])[pooled.success]
    assert abs(inside.mean() - 0.95) < 4 * np.sqrt(0.95 * 0.05 / inside.size)


def test_a_curved_region():
    """Bearings from a short baseline: longer beyond the position than before it."""
    places = np.array([[0, 0], [150, 0.0]])
    target = np.array([75.0, 1000.0])
    azimuth = bearings_of(places, target, 0.0)
    fix = locate(places, azimuth=azimuth, azimuth_sigma=0.02, **LEAST)
    region = fix.region(0.9)
    north = region.polygon[0][:, 1] - fix.position[1]
    assert north.max() > 1.5 * -north.min()
    # on the outline the squares sum to the quantile
    d = region.polygon[0][:, np.newaxis] - places
    error = np.arctan2(d[..., 0], d[..., 1]) - azimuth
    np.testing.assert_allclose(
        np.sum(error**2, axis=-1) / 0.02**2, stats.chi2.ppf(0.9, 2), rtol=0.05
    )


def test_coverage_of_curved_regions():
    rng = np.random.default_rng(3)
    places = np.array([[0, 0], [100, 0], [200, 0], [300, 0.0]])
    target = np.array([150.0, 1000.0])
    azimuth = bearings_of(places, target, 0.02 * rng.standard_normal((500, 4)))
    fixes = locate(places, azimuth=azimuth, azimuth_sigma=0.02, **LEAST)
    inside = fixes.region(0.95).contains(target)[fixes.success]
    assert fixes.success.mean() > 0.9
    assert 0.92 < inside.mean() < 0.98


def test_without_a_position():
    fixes = locate(RING[:2], azimuth=[[0.0, NAN], [0.5, 1.0]], azimuth_sigma=0.1, **LEAST)
    assert fixes.status[0] == LocationStatus.TOO_FEW
    assert np.isnan(fixes.region().area[0])
    assert fixes.region().polygon[0] == ()
    assert np.isnan(fixes.cep()[0])
    assert fixes.protection_level()[0] == INF
    assert not fixes.region().contains([0, 0])[0]


@pytest.mark.parametrize("faults", [1, 2])
def test_protection_levels_are_those_of_the_formulas(faults):
    rng = np.random.default_rng(faults)
    places = 5000 * np.stack([np.sin(np.arange(8)), np.cos(np.arange(8))], axis=-1)
    sigma = rng.uniform(5, 20, 8)
    measured = ranges_of(places, TARGET, sigma * rng.normal(0, 0.7, 8))
    for options in (TRUSTED, {"bias": Bias()}):
        fix = locate(places, range=measured, range_sigma=sigma, **options)
        d = fix.position - places
        distance = np.linalg.norm(d, axis=-1)
        rows = d / distance[:, np.newaxis] / sigma[:, np.newaxis]
        expected = level(rows, (measured - distance) / sigma, faults=faults)
        assert fix.protection_level(faults=faults) == pytest.approx(expected, rel=1e-9)


def test_too_many_faults_are_refused():
    """Forty measurements have 8e8 sets of ten, which filled the memory."""
    turn = 2 * np.pi * np.arange(40) / 40
    places = 5000 * np.stack([np.sin(turn), np.cos(turn)], axis=-1)
    fix = locate(places, range=ranges_of(places, TARGET, np.zeros(40)), range_sigma=10.0)
    assert np.isfinite(fix.protection_level(faults=2))
    message = "faults is 10; of 40 measurements, it must be at most 5: every set"
    with pytest.raises(ValueError, match=message):
        fix.protection_level(faults=10)


def test_levels_that_do_not_exist():
    exact = ranges_of(RING, TARGET, np.zeros(6))
    fix = locate(RING, range=exact, range_sigma=10.0)
    assert 20 < fix.protection_level() < 100
    # two faults are likelier than the risk; of two measurements none can be checked
    assert fix.protection_level(fault_probability=1e-2) == INF
    assert np.isfinite(fix.protection_level(fault_probability=1e-2, faults=3, risk=1e-4))
    # more faults than measurements
    assert fix.protection_level(faults=2**31 - 1) == fix.protection_level(faults=6)
    few = locate(RING[:2], range=exact[:2], range_sigma=10.0, initial=TARGET, **LEAST)
    assert few.protection_level() == INF
    assert few.protection_level(faults=0) == INF
    # a fault that least squares cannot leave out; left out, it is one of those guarded against
    wrong = exact + np.eye(6)[2] * 300.0
    assert locate(RING, range=wrong, range_sigma=10.0, bias=None, **LEAST).protection_level() == INF
    robust = locate(RING, range=wrong, range_sigma=10.0)
    assert robust.outlier.count == 1
    assert robust.protection_level() == INF
    assert 20 < robust.protection_level(faults=2) < 100


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"risk": 0.0}, "risk is 0"),
        ({"fault_probability": 2.0}, "fault_probability is 2"),
        ({"faults": -1}, "faults is -1"),
        ({"false_alarm_probability": NAN}, "false_alarm_probability is nan"),
    ],
)
def test_errors(options, message):
    fix = locate(RING, range=ranges_of(RING, TARGET, 1.0), range_sigma=10.0)
    with pytest.raises(ValueError, match=message):
        fix.protection_level(**options)


def test_errors_of_regions():
    fix = locate(RING, range=ranges_of(RING, TARGET, 1.0), range_sigma=10.0)
    with pytest.raises(ValueError, match="probability is 1"):
        fix.region(1.0)
    with pytest.raises(ValueError, match="probability is 0"):
        fix.cep(0.0)
    unknown = locate(RING, azimuth=bearings_of(RING, TARGET, 0.001 * np.sin(np.arange(6))))
    with pytest.raises(ValueError, match="stated"):
        unknown.protection_level()


@pytest.mark.parametrize("kind", ["range", "azimuth"])
def test_the_worst_fault_stays_within_the_risk(kind):
    """Every measurement in turn has a fault of every size; each draw counts as often as faults do.

    That the error is larger than a finite level, with a fault that hides best, and without.
    """
    rng, count = np.random.default_rng(4), 300
    sigma, predict = {"range": (10.0, ranges_of), "azimuth": (0.004, bearings_of)}[kind]
    sizes, risk, p = np.arange(2.0, 14.0), 1e-5, 1e-4
    total = 0.0
    for faulty in range(len(RING)):
        errors = rng.standard_normal((len(sizes), count, len(RING)))
        errors[..., faulty] += sizes[:, np.newaxis]
        measured = predict(RING, TARGET, sigma * errors)
        options = {kind: measured, f"{kind}_sigma": sigma, "bias": Bias()}
        fixes = locate(RING, **options, **LEAST)
        beyond = np.linalg.norm(fixes.position - TARGET, axis=-1) > fixes.protection_level()
        total += p * np.max(np.mean(beyond, axis=-1))
    exact = locate(
        RING, **{kind: predict(RING, TARGET, 0.0), f"{kind}_sigma": sigma, "bias": Bias()}, **LEAST
    )
    total += outside(exact.protection_level(), exact.covariance)
    assert 1e-7 < total < risk


def test_two_faults():
    rng, p = np.random.default_rng(5), 1e-3
    places = 5000 * np.stack([np.sin(np.arange(8)), np.cos(np.arange(8))], axis=-1)
    total = 0.0
    for pair in itertools.combinations(range(8), 2):
        size = rng.uniform(2, 14, (4000, 2)) * rng.choice([-1, 1], (4000, 2))
        errors = rng.standard_normal((4000, 8))
        errors[:, pair] += size
        measured = ranges_of(places, TARGET, 10.0 * errors)
        fixes = locate(places, range=measured, range_sigma=10.0, bias=Bias(), **LEAST)
        far = np.linalg.norm(fixes.position - TARGET, axis=-1)
        # many pairs of sizes: the worst of sixteen kinds of them
        level = fixes.protection_level(fault_probability=p, faults=2)
        sort = np.digitize(size[:, 0], [-8, 0, 8]) * 4 + np.digitize(size[:, 1], [-8, 0, 8])
        total += p**2 * max(np.mean((far > level)[sort == k]) for k in range(16))
    assert total < 1e-5
