"""What radars see of traffic."""

from dataclasses import replace

import numpy as np
import pytest
from checks import assert_refused
from scipy import stats
from simulate.aircraft import radar, zigzag

from tertia.geo import SystemPlane
from tertia.sensors import Bias, Channel, Radar
from tertia.simulate import (
    dense_traffic,
    encounter,
    flights,
    radar_plots,
)
from tertia.tracker import NO_IDENTITY


def test_a_plot_is_where_the_beam_and_the_aircraft_are():
    """All around, near and far, from radars that turn at other times."""
    traffic = dense_traffic(300, area=(60e3, 60e3), turning_share=0.5, rng=32)
    towers = [radar(), radar((5e3, -7e3), scan_period=4.0)]
    record = radar_plots(traffic, towers, phase=[3.0, 1.5], rng=1)
    plots = record.plots
    np.testing.assert_array_equal(record.phase, [3.0, 1.5])
    assert (np.diff(plots.time) >= 0).all()
    position, _ = traffic.at(record.target, plots.time)
    for k, tower in enumerate(towers):
        own = plots.sensor == k
        offset = position[own] - tower.position
        # of a tangential speed of 250 m/s the azimuth has a microsecond's share
        distance = np.hypot(*offset.T)
        azimuth = np.arctan2(*offset.T)
        beam = 2 * np.pi * (plots.time[own] - record.phase[k]) / tower.scan_period
        lag = (azimuth - beam + np.pi) % (2 * np.pi) - np.pi
        assert np.max(np.abs(lag[distance > 1500])) < 2e-6
        wrong = (plots.azimuth[own] - azimuth + np.pi) % (2 * np.pi) - np.pi
        assert np.max(np.abs(wrong)) < 1e-9
        height = traffic.height[record.target[own], 0]
        np.testing.assert_allclose(plots.range[own], np.hypot(distance, height), rtol=1e-9)


def test_radars_on_the_earth_see_what_pyproj_says():
    """The beam points to true north at its phase; range and azimuth are those on the ellipsoid."""
    pyproj = pytest.importorskip("pyproj")
    plane = SystemPlane(50.0, 14.0)
    traffic = dense_traffic(100, area=(400e3, 400e3), rng=32)
    numbers = {"range_sigma": 1e-6, "azimuth_sigma": 1e-12, "scan_period": 4.0}
    places = [(50.0, 14.0, 300.0), (51.5, 17.0, 500.0)]
    record = radar_plots(
        traffic, [plane.radar(*place, **numbers) for place in places], phase=[1.0, 2.0], rng=1
    )
    plots = record.plots
    position, _ = traffic.at(record.target, plots.time)
    there = plane.to_geodetic(np.c_[position, traffic.height[record.target, 0]])
    for k, place in enumerate(places):
        own = plots.sensor == k
        local = pyproj.Transformer.from_pipeline(
            "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad "
            "+step +proj=cart +ellps=WGS84 +step +proj=topocentric +ellps=WGS84 "
            f"+lat_0={place[0]} +lon_0={place[1]} +h_0={place[2]}"
        ).transform(there[1][own], there[0][own], there[2][own])
        np.testing.assert_allclose(plots.range[own], np.linalg.norm(local, axis=0), atol=1e-4)
        azimuth = np.arctan2(local[0], local[1])
        np.testing.assert_allclose(np.sin(plots.azimuth[own] - azimuth), 0.0, atol=1e-9)
        # straight lines in the plane are not those of sight: a millisecond of the beam
        beam = 2 * np.pi * (plots.time[own] - record.phase[k]) / 4.0
        lag = (azimuth - beam + np.pi) % (2 * np.pi) - np.pi
        assert np.max(np.abs(lag)[np.hypot(*local[:2]) > 5e3]) < 2e-3


def test_every_scan_sees_every_aircraft_once():
    """As often as the beam overtakes its azimuth, which crosses the north meanwhile."""
    traffic = dense_traffic(200, area=(80e3, 80e3), duration=400.0, rng=33)
    record = radar_plots(traffic, [radar()], phase=0.0, rng=1)
    turned = np.unwrap(np.arctan2(traffic.position[..., 0], traffic.position[..., 1]), axis=1)
    lag = 2 * np.pi * traffic.time / 10.0 - turned
    expected = np.floor(lag[:, -1] / (2 * np.pi)) - np.ceil(lag[:, 0] / (2 * np.pi)) + 1
    # nearer, the azimuth may be as quick as the beam
    far = np.min(np.hypot(traffic.position[..., 0], traffic.position[..., 1]), axis=1) > 1500
    assert np.sum(far) > 150
    counts = np.bincount(record.target, minlength=200)
    np.testing.assert_array_equal(counts[far], expected[far])
    assert np.any(np.abs(np.diff(turned[:, [0, -1]], axis=1)) > 1)


def test_an_aircraft_above_the_radar_does_not_stop_the_simulation():
    traffic = encounter("in-trail", middle=(0.0, 0.0), height=0.0, rng=1)
    record = radar_plots(traffic, [radar()], rng=1)
    assert 2 * 57 <= len(record) <= 2 * 61
    assert np.isfinite(record.plots.range).all()


@pytest.fixture(scope="module")
def crowd():
    return dense_traffic(1000, duration=200.0, rng=34)


def errors(traffic, record, tower):
    """Errors of range and azimuth in units of their standard deviations."""
    known = record[record.target >= 0]
    position, _ = traffic.at(known.target, known.plots.time)
    height = traffic.height[known.target, 0] - (
        tower.position[2] if len(tower.position) == 3 else 0
    )
    offset = position - tower.position[:2]
    azimuth = known.plots.azimuth - np.arctan2(*offset.T)
    return (
        (known.plots.range - np.hypot(np.hypot(*offset.T), height)) / tower.range_sigma,
        ((azimuth + np.pi) % (2 * np.pi) - np.pi) / tower.azimuth_sigma,
    )


def test_noise_is_normal_and_detection_as_probable_as_stated(crowd):
    tower = Radar(
        (0, 0, 500), range_sigma=100, azimuth_sigma=0.002, scan_period=5, detection_probability=0.8
    )
    record = radar_plots(crowd, [tower], rng=2)
    for error in errors(crowd, record, tower):
        assert stats.kstest(error, "norm").pvalue > 0.01
    scans = 1000 * 200 / 5
    assert len(record) == pytest.approx(0.8 * scans, abs=4 * np.sqrt(0.16 * scans))


def test_beyond_its_range_a_radar_sees_nothing(crowd):
    record = radar_plots(crowd, [radar(max_range=50e3)], rng=3)
    assert 0 < len(record) < 2000
    assert np.max(record.plots.range) < 50e3 + 1e-3
    whole = radar_plots(crowd, [radar()], phase=record.phase, rng=3)
    assert np.sum(whole.plots.range < 50e3) == len(record)


def test_bias_and_outliers(crowd):
    tower = radar(range_sigma=50, azimuth_sigma=0.001)
    bias = Bias(range=200, azimuth=0.01)
    record = radar_plots(
        crowd, [tower], bias=bias, outlier_probability=0.1, outlier_size=30.0, rng=4
    )
    n = len(record)
    assert record.outlier.mean() == pytest.approx(0.1, abs=4 * 0.3 / np.sqrt(n))
    for error, shift in zip(errors(crowd, record, tower), (4.0, 10.0), strict=True):
        good, bad = error[~record.outlier], error[record.outlier]
        assert stats.kstest(good - shift, "norm").pvalue > 0.01
        assert stats.kstest((bad - shift) / 30, "norm").pvalue > 0.01


def test_gain_and_clock_from_a_time_on(crowd):
    tower = radar(range_sigma=50, azimuth_sigma=0.001)
    bias = Bias(range_gain=0.01, time=0.25)
    clean, wrong = (
        radar_plots(crowd, [tower], bias=one, bias_start=start, phase=0.0, rng=4)
        for one, start in ((None, 0.0), (bias, 60.0))
    )
    assert_refused(lambda: radar_plots(crowd, [tower], bias=[1.0]), TypeError, "bias is")
    several = Bias(range=[1.0, 2.0])
    assert_refused(lambda: radar_plots(crowd, [tower], bias=several), ValueError, "there are 1")
    order = np.lexsort((wrong.plots.time, wrong.target))
    before = np.lexsort((clean.plots.time, clean.target))
    late = clean.plots.time[before] >= 60.0
    off = wrong.plots.time[order] - clean.plots.time[before]
    np.testing.assert_allclose(off, 0.25 * late, atol=1e-9)
    # the noise is the same, the range in it is longer
    ratio = wrong.plots.range[order] / clean.plots.range[before]
    np.testing.assert_allclose(ratio, 1 + 0.01 * late, atol=2e-4)


def test_each_radar_has_its_own_bias_and_clutter(crowd):
    towers = [radar(max_range=400e3), radar(max_range=400e3)]
    record = radar_plots(crowd, towers, bias=Bias(range=[0, 500]), clutter=[0, 40], rng=5)
    for k, shift in enumerate((0.0, 500.0)):
        own = record[record.plots.sensor == k]
        np.testing.assert_allclose(
            errors(crowd, own, towers[k])[0] * towers[k].range_sigma, shift, atol=1e-4
        )
        false = np.sum(own.target == -1)
        assert false == (pytest.approx(800, abs=4 * np.sqrt(800)) if k else 0)


def test_duplicates_repeat_a_plot_of_the_scan(crowd):
    record = radar_plots(crowd, [radar(range_sigma=50)], duplicate_probability=0.2, rng=6)
    singles = np.sum(~record.duplicate)
    assert np.sum(record.duplicate) / singles == pytest.approx(0.2, abs=4 * 0.4 / np.sqrt(singles))
    keys = {
        (t, w)
        for t, w in zip(
            record.target[~record.duplicate], record.plots.time[~record.duplicate], strict=True
        )
    }
    repeated = record[record.duplicate]
    assert all(key in keys for key in zip(repeated.target, repeated.plots.time, strict=True))
    # with another noise
    assert len(np.unique(record.plots.range)) == len(record)


def test_replies_are_rounded_missing_and_garbled(crowd):
    record = radar_plots(
        crowd,
        [radar()],
        height_missing_probability=0.1,
        identity_missing_probability=0.2,
        identity_garbled_probability=0.05,
        rng=7,
    )
    n, plots = len(record), record.plots
    known = ~np.isnan(plots.height)
    assert known.mean() == pytest.approx(0.9, abs=4 * 0.3 / np.sqrt(n))
    np.testing.assert_allclose(plots.height[known] / 30.48, np.round(plots.height[known] / 30.48))
    wrong = np.abs(plots.height[known] - crowd.height[record.target[known], 0])
    assert 15 < np.max(wrong) <= 15.24 + 1e-9
    answered = plots.identity >= 0
    assert answered.mean() == pytest.approx(0.8, abs=4 * 0.4 / np.sqrt(n))
    garbled = plots.identity[answered] != crowd.identity[record.target[answered]]
    assert garbled.mean() == pytest.approx(0.05, abs=4 * 0.22 / np.sqrt(n))
    assert np.max(plots.identity) < 4096


def test_without_heights_the_range_is_horizontal_and_without_identity_there_is_none():
    traffic = flights([zigzag()], rng=35)
    record = radar_plots(traffic, [radar((0, 0, 1000))], rng=8)
    assert np.isnan(record.plots.height).all()
    assert (record.plots.identity == -1).all()
    position, _ = traffic.at(record.target, record.plots.time)
    np.testing.assert_allclose(record.plots.range, np.hypot(*position.T), atol=1e-4)


def test_clutter_is_uniform_over_the_area_and_comes_with_the_beam(crowd):
    tower = radar(max_range=300e3, detection_probability=1e-12)
    record = radar_plots(crowd, [tower], clutter=250, rng=9)
    assert (record.target == -1).all()
    assert len(record) == pytest.approx(5000, abs=4 * np.sqrt(5000))
    plots = record.plots
    assert stats.kstest((plots.range / 300e3) ** 2, "uniform").pvalue > 0.01
    assert stats.kstest(plots.azimuth / (2 * np.pi), "uniform").pvalue > 0.01
    beam = 2 * np.pi * (plots.time - record.phase[0]) / 10
    lag = (plots.azimuth - beam + np.pi) % (2 * np.pi) - np.pi
    assert np.max(np.abs(lag)) < 1e-9
    assert np.isnan(plots.height).all()
    assert (plots.identity == -1).all()


def test_phases_are_uniform():
    traffic = encounter("formation", duration=10.0, rng=1)
    record = radar_plots(traffic, [radar(scan_period=8.0)] * 400, rng=10)
    assert stats.kstest(record.phase / 8, "uniform").pvalue > 0.01


def test_a_flight_alone_with_the_clutter(crowd):
    record = radar_plots(crowd, [radar(max_range=400e3)], clutter=50, rng=11)
    alone = record.alone(5)
    assert set(alone.target) == {-1, 5}
    assert np.sum(alone.target == 5) == np.sum(record.target == 5)
    assert alone.target[0] == alone.target[-1] == 5
    span = alone.plots.time[[0, -1]]
    inside = (record.plots.time > span[0]) & (record.plots.time < span[1])
    assert np.sum(alone.target == -1) == np.sum(inside & (record.target == -1))
    assert len(record.alone(12345)) == 0


def test_a_radar_with_channels_says_what_it_detected_by():
    """In as many plots as the products of probabilities say, each with the noise of its channel."""
    channels = {
        "psr": Channel(0.8, range_sigma=80.0, azimuth_sigma=0.004, clutter_per_scan=30.0),
        "ssr": Channel(0.7, range_sigma=20.0, azimuth_sigma=0.001, clutter_per_scan=3.0),
    }
    tower = replace(radar(), max_range=90e3, detection_probability=None, channels=channels)
    traffic = dense_traffic(300, area=(60e3, 60e3), rng=32)
    record = radar_plots(traffic, [tower], phase=0.0, clutter=99.0, rng=2)
    met = radar_plots(traffic, [radar()], phase=0.0, rng=1)
    real = record.target >= 0
    detection = record.plots.detection
    share = [np.mean(detection[real] == k) for k in range(5)]
    expected = np.array([0.8 * 0.3, 0.2 * 0.7, 0.8 * 0.7, 0.0, 0.0]) / (1 - 0.2 * 0.3)
    n = np.sum(real)
    assert np.max(np.abs(share - expected)) < 4 * np.sqrt(0.25 / n)
    assert abs(n / len(met) - 0.94) < 4 * np.sqrt(0.94 * 0.06 / len(met))
    # an echo alone has neither identity nor height
    silent = real & (detection == 0)
    assert np.all(record.plots.identity[silent] == NO_IDENTITY)
    assert np.all(np.isnan(record.plots.height[silent]))
    answered = real & (detection != 0)
    assert np.all(np.isfinite(record.plots.height[answered]))
    for code, sigma in ((0, 80.0), (1, 20.0), (2, 20.0)):
        own = real & (detection == code)
        position, _ = traffic.at(record.target[own], record.plots.time[own])
        height = traffic.height[record.target[own], 0]
        off = record.plots.range[own] - np.hypot(np.hypot(*(position - tower.position).T), height)
        assert np.std(off) == pytest.approx(sigma, rel=4 / np.sqrt(2 * np.sum(own)))
    # what channels state, and not what is given for radars that state nothing
    scans = (np.max(traffic.end) - np.min(traffic.start)) / tower.scan_period
    for code, mean in ((0, 30.0), (1, 3.0)):
        count = np.sum(~real & (detection == code))
        assert abs(count - mean * scans) < 4 * np.sqrt(mean * scans)
    assert set(detection[~real]) == {0, 1}


def test_clutter_is_of_the_first_channel_that_states_none():
    for name, code in (("psr", 0), ("ssr", 1), ("mode-s", 3)):
        channels = {"mode-s": Channel(0.9), name: Channel(0.8)}
        tower = replace(radar(), max_range=90e3, detection_probability=None, channels=channels)
        record = radar_plots(dense_traffic(2, rng=1), [tower], clutter=20.0, rng=2)
        assert set(record.plots.detection[record.target < 0]) == {code}
