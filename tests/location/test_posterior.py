"""Few bearings: against the formulas, a published design of radio telemetry, and real fixes."""

import itertools

import numpy as np
import pytest
from places import DATA, needs_data
from reference import posterior as reference

from tertia.location import LocationStatus, Station, locate

NAN = float("nan")
PLACES = np.array([[0, 0], [400, 0], [200, -300.0]])
BEARINGS = np.radians([35, 325, 2.0])
OPTIONS = {"method": "posterior", "max_range": 1000.0}


def design(rng, count, n, kappa):
    """Return stations 200 to 500 m from a target at the origin, and bearings in whole degrees.

    The design of the simulations of Gerber et al. (2018).
    """
    distance, way = rng.uniform(200, 500, (count, n)), rng.uniform(0, 2 * np.pi, (count, n))
    places = distance[..., np.newaxis] * np.stack([np.sin(way), np.cos(way)], axis=-1)
    error = rng.vonmises(0.0, np.broadcast_to(np.reshape(kappa, (-1, 1)), (count, n)))
    return places, np.radians(np.round(np.degrees(way + np.pi + error)))


@pytest.mark.filterwarnings("ignore:.*max_range")
def share_inside(places, azimuth, *, probability=0.95, record=100, **options):
    """Return in how many instants the region contains the target at the origin."""
    inside = [
        locate(places[at : at + record], azimuth=azimuth[at : at + record], **OPTIONS, **options)
        .region(probability)
        .contains([0.0, 0.0])
        for at in range(0, len(places), record)
    ]
    return np.concatenate(inside)


def test_the_evidence_of_a_published_computation():
    sigma = np.full(3, reference.STATED)
    found = reference.evidence(np.array([0.001, 0.01, 0.1]) / reference.STATED**2, sigma)
    expected = [5.233149008189221, 2.588215109392012, -2.0034250358925902]
    np.testing.assert_allclose(found, expected, rtol=1e-13)


def test_summation_over_a_fine_grid():
    """Sums over squares of one metre; an adaptive tree gave (204.406, 307.511), 1239, 6572."""
    fix = locate(PLACES, azimuth=BEARINGS, **OPTIONS)
    np.testing.assert_allclose(fix.position, [204.40654, 307.55732], atol=0.15)
    np.testing.assert_allclose(np.diag(fix.covariance), [1245.618, 6602.353], rtol=0.015)
    assert fix.cep() == pytest.approx(33.18, rel=0.01)
    assert fix.status is LocationStatus.OK
    assert fix.degrees_of_freedom == 1


def test_parity_with_the_formulas():
    rng = np.random.default_rng(1)
    places, azimuth = design(rng, 6, 4, 60.0)
    azimuth[rng.uniform(size=azimuth.shape) < 0.2] = NAN
    sigma = np.array([0.05, 0.08, 0.08, 0.1])
    fixes = locate(places, azimuth=azimuth, azimuth_sigma=sigma, **OPTIONS)
    level = fixes.region(0.9)
    for i in range(len(places)):
        found = reference.Posterior(places[i], azimuth[i], sigma, 1000.0)
        np.testing.assert_allclose(fixes.position[i], found.mean, rtol=1e-9, atol=1e-8)
        np.testing.assert_allclose(fixes.covariance[i], found.covariance, rtol=1e-9, atol=1e-7)
        stated = np.mean(sigma[~np.isnan(azimuth[i])])
        np.testing.assert_allclose(fixes.measurement_sigma[i], found.factor * stated, rtol=1e-9)
        # the outline is a line of the level that the nodes give, between the nodes of its grid
        corners = np.concatenate(level.polygon[i])
        near = found.within(corners, -20.0)
        ln = found.ln_density(found.misfit(corners[near])) - found.ln_total
        np.testing.assert_allclose(np.median(ln), found.ln_level(0.9), atol=0.02)


def test_parity_of_a_pooled_record():
    places, azimuth = design(np.random.default_rng(2), 5, 3, 50.0)
    azimuth[1, 2] = NAN
    fixes = locate(places, azimuth=azimuth, azimuth_sigma=0.1, pooled=True, **OPTIONS)
    expected = reference.pooled(places, azimuth, 0.1, 1000.0)
    for i, one in enumerate(expected):
        np.testing.assert_allclose(fixes.position[i], one.mean, rtol=1e-9, atol=1e-8)
        np.testing.assert_allclose(fixes.covariance[i], one.covariance, rtol=1e-9, atol=1e-7)
        np.testing.assert_allclose(fixes.measurement_sigma[i], 0.1 * one.factor, rtol=1e-9)


@pytest.mark.parametrize("max_range", [1e4, 1e6])
def test_a_record_that_random_bearings_explain(max_range):
    """Positions were kilometres off: a wide prior makes diffuse bearings the likeliest."""
    places, azimuth = design(np.random.default_rng(1), 100, 3, 50.0)
    with pytest.raises(ValueError, match=r"max_range is too large .* random bearings"):
        locate(places, azimuth=azimuth, method="posterior", max_range=max_range, pooled=True)


@pytest.mark.filterwarnings("ignore:.*max_range")
@pytest.mark.parametrize("sigma", [15.0, 25.0, 40.0])
def test_bearings_that_are_diffuse_are_not_refused(sigma):
    places, azimuth = design(np.random.default_rng(2), 100, 3, np.radians(sigma) ** -2)
    found = np.degrees(locate(places, azimuth=azimuth, pooled=True, **OPTIONS).measurement_sigma)
    assert 0.75 * sigma < np.median(found) < 1.3 * sigma


@pytest.mark.parametrize("n", [3, 4])
def test_coverage_of_pooled_records(n):
    places, azimuth = design(np.random.default_rng([3, n]), 300, n, 50.0)
    inside = share_inside(places, azimuth, pooled=True)
    assert 0.91 < inside.mean() < 0.98


@pytest.mark.filterwarnings("ignore:.*max_range")
def test_coverage_of_two_bearings_in_a_record_with_three():
    rng = np.random.default_rng(4)
    places, azimuth = design(rng, 300, 3, 50.0)
    pairs = rng.uniform(size=len(places)) < 2 / 3
    azimuth[pairs, 2] = NAN
    assert 0.92 < share_inside(places, azimuth, pooled=True)[pairs].mean() < 0.995


@pytest.mark.filterwarnings("ignore:.*max_range")
@pytest.mark.parametrize("n", [2, 3, 4])
def test_coverage_of_single_fixes_whose_sigma_is_drawn_from_its_prior(n):
    rng = np.random.default_rng([5, n])
    sigma = np.radians(5.0) * np.exp(0.7 * rng.standard_normal(300))
    places, azimuth = design(rng, 300, n, sigma**-2)
    assert 0.91 < share_inside(places, azimuth).mean() < 0.985


@needs_data
def test_fixes_of_one_animal():
    """276 fixes from three towers, and the positions that were made of them then.

    Some of these leave a bearing out by hand, so the least-squares region misses every fifth.
    """
    folder = DATA / "lenth"
    towers = np.loadtxt(folder / "towers.dat", delimiter=",")[5:]
    lines = (folder / "fixes.dat").read_text().splitlines()
    found = [
        (bearings.split()[5::2], position.split()[:2])
        for bearings, position in itertools.pairwise(lines)
        if "/" in bearings and position.strip()[0].isdigit() and "/" not in position
    ]
    azimuth = np.radians(np.array([row for row, _ in found], dtype=float))
    azimuth[azimuth == 0] = NAN
    positions = np.array([row for _, row in found], dtype=float)
    fixes = locate(towers, azimuth=azimuth, method="posterior", max_range=5000.0)
    assert len(positions) > 200
    assert 0.88 < fixes.region(0.95).contains(positions).mean() < 0.98


def test_two_bearings_know_nothing_of_sigma():
    fix = locate(PLACES[:2], azimuth=BEARINGS[:2], **OPTIONS)
    again = locate(PLACES[:2], azimuth=BEARINGS[:2], pooled=True, **OPTIONS)
    assert fix.measurement_sigma == again.measurement_sigma
    assert fix.systematic == "not included"
    assert "systematic" in repr(fix)
    assert locate(PLACES, azimuth=BEARINGS, **OPTIONS).systematic == "estimated"


def test_gaps_threads_and_company_do_not_matter():
    rng = np.random.default_rng(6)
    places, azimuth = design(rng, 40, 3, 50.0)
    azimuth[3] = NAN
    azimuth[4, 1:] = NAN
    azimuth[5, 1] = NAN
    one = locate(places, azimuth=azimuth, n_threads=1, **OPTIONS)
    two = locate(places, azimuth=azimuth, n_threads=3, **OPTIONS)
    for name in ("position", "covariance", "measurement_sigma", "status"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    assert set(np.flatnonzero(one.status)) == {3, 4}
    assert np.isnan(one.position[3:5]).all()
    assert one.region().polygon[3] == ()
    assert np.isnan(one.region().area[3])
    alone = locate(places[5, [0, 2]], azimuth=azimuth[5, [0, 2]], **OPTIONS)
    np.testing.assert_array_equal(alone.position, one.position[5])
    with pytest.raises(ValueError, match="fewer measurements"):
        locate(places[4], azimuth=azimuth[4], **OPTIONS)


def test_stations_far_from_the_origin_and_turned_axes():
    offset = np.array([5e5, 4.4e6])
    near, far = (locate(PLACES + by, azimuth=BEARINGS, **OPTIONS) for by in (0.0, offset))
    np.testing.assert_allclose(far.position - offset, near.position, atol=1e-6)
    assert far.region().contains(far.position)
    assert far.region().area == near.region().area
    turned = np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]])
    stations = [Station(place, axes=turned) for place in PLACES]
    # an azimuth from a north that is turned clockwise or anticlockwise is as much less
    found = [locate(stations, azimuth=BEARINGS + by, **OPTIONS).position for by in (0.3, -0.3)]
    assert min(np.linalg.norm(p - near.position) for p in found) < 1e-6


def test_parts_of_a_region():
    """Two bearings nearly along the line of the stations: between them, and beyond."""
    places = [[0, 0], [0, 400]]
    fix = locate(places, azimuth=np.radians([2, 178]), azimuth_sigma=0.02, **OPTIONS)
    region = fix.region(0.95)
    assert region.area > 0
    assert region.contains([0.0, 200.0])
    assert not region.contains([200.0, 200.0])
    assert 0 <= region.orientation < np.pi
    assert region.semi_major >= region.semi_minor


def test_a_limit_that_determines_the_positions():
    with pytest.warns(UserWarning, match=r"1 of 1 positions .* max_range"):
        locate(PLACES[:2], azimuth=[0.01, -0.01], method="posterior", max_range=1000.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "max_range is missing"),
        ({"max_range": -1.0}, "max_range is -1"),
        ({"max_range": 1e3, "initial": [0, 0]}, "does not use initial"),
        ({"max_range": 1e3, "range": [1.0, 2.0, 3.0]}, "azimuths alone"),
        ({"method": "robust", "max_range": 1e3}, "max_range is for 'posterior'"),
    ],
)
def test_errors(options, message):
    with pytest.raises(ValueError, match=message):
        locate(PLACES, azimuth=BEARINGS, **{"method": "posterior", **options})


@pytest.mark.parametrize("far", [1e6, 1e8])
def test_stations_that_are_much_farther_apart_than_the_range(far):
    def region(far):
        places = np.array([[0, 0], [200, 100], [far, 0.2 * far]])
        d = np.array([100.0, 200.0]) - places
        azimuth = np.arctan2(d[:, 0], d[:, 1])
        options = {"method": "posterior", "max_range": 300.0}
        return locate(places, azimuth=azimuth, azimuth_sigma=0.05, **options).region()

    assert region(far).area == pytest.approx(region(1e4).area, rel=0.03)
    assert region(far).contains([100, 200])
