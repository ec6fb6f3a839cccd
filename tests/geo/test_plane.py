"""Geo: plots of radars on the earth, the system plane, states, heights; against the prototype."""

import pickle

import numpy as np
import pytest
from reference import geo as reference

from tertia import metrics
from tertia.geo import (
    Atmosphere,
    LocalFrame,
    SystemPlane,
    cartesian_to_polar,
    polar_to_cartesian,
    transform,
)
from tertia.sensors import Radar
from tertia.tracker import Plots, Tracker, track

NAN = float("nan")
PLANE = SystemPlane(50.0, 14.0)
PRAGUE = (50.1, 14.26, 380.0)
KIND = {"range_sigma": 50.0, "azimuth_sigma": 1e-5, "scan_period": 4.0}
SITES = [(50.0, 14.0, 300.0), (51.2, 15.0, 600.0), (48.0, 12.5, 450.0)]
# site, range, azimuth in degrees, height, and where that is: latitude, longitude, elevation
SEEN = [
    (PRAGUE, 100e3, 60.0, 10.5e3, (50.540507037672, 15.474418080426, 5.362206358293)),
    (PRAGUE, 400e3, 60.0, 10.5e3, (51.790538625165, 19.278666623262, -0.343314420310)),
    ((0.0, 0.0, 0.0), 200e3, 45.0, 11e3, (1.275870961276, 1.267657441017, 2.253233563251)),
    (
        (-33.9465, 151.181, 60.0),
        250e3,
        271.5,
        12e3,
        (-33.858101766755, 148.485482512766, 1.617500966603),
    ),
    ((78.2, 15.4, 450.0), 350e3, 340.0, 9.5e3, (81.079052470011, 8.481625514743, -0.084627285432)),
    (
        (43.571, 16.406, 100.0),
        15e3,
        200.0,
        9e3,
        (43.468938349870, 16.355001027317, 36.339613952849),
    ),
]
# degrees, and metres: 1e-12 degrees are 1e-7 m
PRINTED = 1e-11


def radars(**kind):
    return [PLANE.radar(*site, **(KIND | kind)) for site in SITES]


def seen(site, place):
    return LocalFrame(*site).geodetic_to_polar(*place)


@pytest.mark.parametrize(("site", "rho", "alpha", "height", "expected"), SEEN)
def test_plots_of_a_site(site, rho, alpha, height, expected):
    frame = LocalFrame(*site)
    latitude, longitude, up = frame.polar_to_geodetic(rho, np.radians(alpha), height)
    assert (latitude, longitude) == pytest.approx(expected[:2], abs=PRINTED)
    assert up == pytest.approx(height, abs=1e-8)
    again, azimuth, elevation = frame.geodetic_to_polar(latitude, longitude, up)
    assert again == pytest.approx(rho, abs=1e-6)
    assert azimuth == pytest.approx(np.radians(alpha), abs=1e-12)
    assert np.degrees(elevation) == pytest.approx(expected[2], abs=PRINTED)
    by_bisection = reference.to_geodetic(
        reference.polar_to_ecef(site, rho, np.radians(alpha), height)
    )
    assert (latitude, longitude) == pytest.approx(by_bisection[:2], abs=PRINTED)


def test_pyproj_has_the_same_views():
    """Its topocentric conversion, which knows nothing of ours."""
    pyproj = pytest.importorskip("pyproj")
    rng = np.random.default_rng(5)
    for site in (PRAGUE, (-33.9465, 151.181, 60.0), (78.2, 15.4, 450.0)):
        north, east = rng.uniform(-2.5, 2.5, (2, 20))
        places = np.array([site[0] + north, site[1] + east, rng.uniform(1e3, 12e3, 20)])
        pipeline = pyproj.Transformer.from_pipeline(
            "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad "
            "+step +proj=cart +ellps=WGS84 +step +proj=topocentric +ellps=WGS84 "
            f"+lat_0={site[0]} +lon_0={site[1]} +h_0={site[2]}"
        )
        local = np.transpose(pipeline.transform(places[1], places[0], places[2]))
        rho, azimuth, elevation = LocalFrame(*site).geodetic_to_polar(*places)
        np.testing.assert_allclose(rho, np.linalg.norm(local, axis=1), atol=1e-7, rtol=0)
        turned = np.arctan2(local[:, 0], local[:, 1]) - azimuth
        np.testing.assert_allclose(np.sin(turned), 0.0, atol=1e-12)
        np.testing.assert_allclose(np.sin(elevation), local[:, 2] / rho, atol=1e-12)
        back = LocalFrame(*site).polar_to_geodetic(rho, azimuth, places[2])
        np.testing.assert_allclose(back, places, atol=1e-7, rtol=0)


@pytest.mark.parametrize(
    ("place", "expected"),
    [
        ((51, 16, 10_000), (140394.213510926, 113132.460435449)),
        ((53, 18, 11_000), (268640.156403309, 341193.341194583)),
        ((47, 10, 0), (-304347.913665790, -325713.026755534)),
    ],
)
def test_places_in_the_plane(place, expected):
    found = PLANE.to_local(*place)
    np.testing.assert_allclose(found, [*expected, place[2]], rtol=0, atol=5e-9)
    np.testing.assert_allclose(PLANE.to_geodetic(found), place, rtol=0, atol=2e-9)
    u, v, _ = reference.to_plane((50.0, 14.0, 0.0), reference.to_ecef(*place))
    np.testing.assert_allclose(found[:2], [u, v], rtol=0, atol=5e-9)


def test_the_plane_is_not_that_of_proj():
    """`sterea` is .4 to .9 m away at 180 to 450 km, `stere` 9 to 51 m."""
    pyproj = pytest.importorskip("pyproj")
    off = {}
    for name in ("sterea", "stere"):
        projection = pyproj.Proj(proj=name, lat_0=50, lon_0=14, ellps="WGS84")
        places = np.array([[51.2, 16.0], [52.5, 9.5], [46.5, 18.5], [53.0, 19.0]])
        own = PLANE.to_local(*places.T, 0.0)[:, :2]
        theirs = np.transpose(projection(places[:, 1], places[:, 0]))
        off[name] = np.linalg.norm(own - theirs, axis=1)
    assert 0.3 < np.max(off["sterea"]) < 1.0
    assert np.max(off["stere"]) > 9.0


def test_plots_in_the_plane_with_their_covariance():
    radar = PLANE.radar(*PRAGUE, range_sigma=75.0, azimuth_sigma=1.5e-3, scan_period=4.0)
    shrunk = np.exp(0.5 * radar.azimuth_sigma**2)
    for rho, alpha, height in ((15e3, 1.0, 9e3), (60e3, 4.0, 5e3), (400e3, 2.0, 10.5e3)):
        found, covariance = Plots([0.0], [rho], [alpha], height=height).to_cartesian([radar])
        place, by = reference.plot_in_plane(PRAGUE, (50.0, 14.0, 0.0), rho, alpha, height)
        offset = (place - radar.position[:2]) * shrunk
        np.testing.assert_allclose(found[0], radar.position[:2] + offset, rtol=0, atol=1e-6)
        scaled = by * [75.0, 1.5e-3, 15.0]
        np.testing.assert_allclose(covariance[0], scaled @ scaled.T, rtol=1e-6, atol=1e-2)


def test_a_plot_without_a_height_is_as_uncertain_as_its_height():
    """Its error along the range is that of the height times the tangent of the elevation."""
    radar = PLANE.radar(*PRAGUE, range_sigma=1.0, azimuth_sigma=1e-5, scan_period=4.0)
    rng = np.random.default_rng(3)
    n = 4000
    heights = rng.normal(8e3, 2e3, n)
    rho, alpha = rng.uniform(60e3, 200e3, n), rng.uniform(0, 2 * np.pi, n)
    half = np.arange(n) % 2 == 0
    stated = Plots(np.zeros(n), rho, alpha, height=np.where(half, heights, NAN))
    true, _ = Plots(np.zeros(n), rho, alpha, height=heights).to_cartesian([radar])
    found, covariance = stated.to_cartesian([radar])
    error = (found - true)[~half]
    nees = metrics.nees(error, covariance[~half])
    # one of two components has an error
    assert np.mean(nees) == pytest.approx(1.0, abs=0.15)
    np.testing.assert_array_equal(found[half], true[half])


def test_three_radars_see_one_aircraft_at_one_place():
    own = radars(azimuth_sigma=1e-9)
    for place in ((50.5, 15.0, 10e3), (52.0, 12.0, 5e3), (48.5, 16.0, 11e3)):
        views = np.array([seen(site, place) for site in SITES])
        plots = Plots(np.zeros(3), *views.T[:2], sensor=[0, 1, 2], height=place[2])
        found, _ = plots.to_cartesian(own)
        assert np.ptp(found, axis=0).max() < 1e-6
        np.testing.assert_allclose(found[0], PLANE.to_local(*place)[:2], rtol=0, atol=1e-6)


def flight(heights=10e3, steps=60):
    """Plots of three radars without noise, and where the aircraft is in the plane."""
    time = np.arange(0.0, 4.0 * steps, 4.0)
    north = 50.2 + 0.0018 * time / 4.0
    columns, truth = [], []
    for k, site in enumerate(SITES):
        places = (north + 0.0006 * k, np.full(len(time), 15.0), np.full(len(time), 10e3))
        rho, azimuth, _ = LocalFrame(*site).geodetic_to_polar(*places)
        stated = np.broadcast_to(heights, time.shape)
        columns.append((time + 1.333 * k, rho, azimuth, np.full(len(time), k), stated))
        truth.append(np.column_stack([time + 1.333 * k, PLANE.to_local(*places)[:, :2]]))
    time, rho, azimuth, sensor, height = np.concatenate(columns, axis=1)
    order = np.argsort(time)
    plots = Plots(time, rho, azimuth, sensor=sensor.astype(int), height=height)[order]
    return plots, np.concatenate(truth)[order]


def test_tracks_of_three_radars_are_one():
    plots, truth = flight()
    table = track(plots, radars(azimuth_sigma=1e-3), registration=False)
    assert len(np.unique(table.track)) == 1
    assert len(np.unique(table.track_of_plot[1:-1])) == 1
    there = np.column_stack([np.interp(table.time, truth[:, 0], truth[:, k]) for k in (1, 2)])
    assert np.max(np.linalg.norm((table.position - there)[30:], axis=1)) < 0.5


def test_a_copied_tracker_goes_on():
    """It has also kept the mean level, by which plots without a height are in the plane."""
    plots, _ = flight(np.where(np.arange(60) % 3 == 0, NAN, 10e3))
    found = []
    for copied in (False, True):
        live = Tracker(radars(azimuth_sigma=1e-3))
        live.update(plots[:90])
        live = pickle.loads(pickle.dumps(live)) if copied else live
        found.append(live.update(plots[90:]).position)
    np.testing.assert_array_equal(*found)
    assert len(found[0]) > 80


def test_the_flat_earth_is_hundreds_of_metres_off():
    """What the same plots were taken for in the plane without the earth."""
    plots, truth = flight()
    flat = [Radar(radar.position, **(KIND | {"azimuth_sigma": 1e-3})) for radar in radars()]
    position, _ = plots.to_cartesian(flat)
    off = np.linalg.norm(position - truth[:, 1:], axis=1)
    assert np.median(off) > 100


def test_heights_that_cannot_be():
    """Too near for its height: above the radar, or used without the height."""
    radar = PLANE.radar(
        *PRAGUE, range_sigma=50.0, azimuth_sigma=1e-3, scan_period=4.0, max_range=2e5
    )
    time = np.arange(0.0, 40.0, 4.0)
    near = Plots(time, 20e3 + 200 * time, 1.0, height=np.where(time == 20.0, 40e3, 9e3))
    assert np.all(track(near, [radar]).track_of_plot == 1)
    above = track(Plots([0.0, 4.0], [9000.0, 8600.0], 1.0, height=9380.0), [radar])
    np.testing.assert_array_equal(above.track_of_plot == -3, [True, False])
    far = track(Plots([0.0, 4.0], [199.9e3, 200.1e3], 1.0, height=9e3), [radar])
    np.testing.assert_array_equal(far.track_of_plot == -4, [False, True])


def test_scale_and_convergence():
    """Speeds are .3 m/s too small at 250 m/s; true courses are those there less the north."""
    positions = [[100e3, 0.0, 10e3], [0.0, 200e3, 10e3], [400e3, 0.0, 10e3]]
    scale, convergence = PLANE.scale_and_convergence(positions)
    np.testing.assert_allclose(scale - 1, [-0.0015, -0.0013, -0.0006], atol=7e-5)
    state = transform(
        [0.0, 0.0, 0.0, 0.0, 250.0, 0.0],
        source=LocalFrame(*PLANE.to_geodetic(positions[2])),
        target=PLANE,
    )
    np.testing.assert_allclose(state[:3], positions[2], rtol=0, atol=1e-6)
    assert np.hypot(*state[3:5]) == pytest.approx(250.0 * scale[2], abs=1e-3)
    assert np.arctan2(*state[3:5]) == pytest.approx(convergence[2], abs=1e-5)


class TestStates:
    """Part F of the prototype."""

    STATE = np.array([80e3, -150.0, 1.2, *np.radians([40.0, 0.12, 0.003])])
    CARTESIAN = (51423.00877492, 61283.55544952, 31.93383693773)
    REST = (-222.6067641964, 3.273258115217, -1.638193499912)
    SIGMA = np.array([60.0, 3.0, 0.5, *np.radians([0.08, 0.01, 0.002])])

    def test_there(self):
        found, covariance = polar_to_cartesian(self.STATE, np.diag(self.SIGMA**2))
        np.testing.assert_allclose(found, [*self.CARTESIAN, *self.REST], rtol=1e-12)
        np.testing.assert_allclose(found, reference.polar_state(self.STATE), rtol=1e-12)
        expected = [
            8809.313438782,
            7267.816075682,
            118.2288350618,
            85.84070069162,
            4.685609959291,
            3.368952192359,
        ]
        np.testing.assert_allclose(np.diag(covariance), expected, rtol=1e-12)
        off = {(0, 1): -4371.132985169, (2, 3): -91.55895303505, (4, 5): -3.715971969312}
        for at, value in (off | {(0, 4): -0.1094325684773}).items():
            assert covariance[at] == pytest.approx(value, rel=1e-12)

    def test_from_elsewhere(self):
        """An azimuth can be moved to another site only with its range."""
        state, covariance = polar_to_cartesian(self.STATE, np.diag(self.SIGMA**2))
        found, spread = cartesian_to_polar(state, covariance, origin=(60e3, 20e3))
        expected = [42165.11270029, -224.4484676136, -2.265112682319]
        angles = [348.2633045685, -0.01904450681636, 0.003699291162471]
        np.testing.assert_allclose(found[:3], expected, rtol=1e-12)
        np.testing.assert_allclose(np.degrees(found[3:]), angles, rtol=1e-12)
        sigmas = [0.1137247655962, 0.01218658053326, 0.002410189524991]
        np.testing.assert_allclose(np.degrees(np.sqrt(np.diag(spread)[3:])), sigmas, rtol=1e-12)

    @pytest.mark.parametrize("n", [4, 6])
    def test_round_trip(self, n):
        rng = np.random.default_rng(7)
        state = rng.normal(size=(3, 5, n)) * ([2e4] * 2 + [200.0] * 2 + [2.0] * (n - 4))
        root = rng.normal(size=(3, 5, n, n))
        covariance = root @ np.swapaxes(root, -1, -2)
        polar, spread = cartesian_to_polar(state, covariance, origin=(1e3, -2e3))
        back, again = polar_to_cartesian(polar, spread, origin=(1e3, -2e3))
        np.testing.assert_allclose(back, state, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(again, covariance, rtol=1e-6, atol=1e-6)

    def test_at_the_radar(self):
        with pytest.warns(RuntimeWarning, match="a target is at the sensor"):
            found = cartesian_to_polar([[0.0] * 4, [3.0, 4.0, 0.0, 0.0]])
        np.testing.assert_array_equal(np.isnan(found).all(axis=1), [True, False])

    def test_between_planes(self):
        here, there = LocalFrame(*PRAGUE), LocalFrame(50.45, 15.3, 250.0)
        state = [30e3, 40e3, 9000.0, 120.0, -180.0, 5.0, -1.5, 2.0, 0.0]
        covariance = np.diag(np.arange(1.0, 10.0))
        found, turned = transform(state, covariance, source=here, target=there)
        expected = [
            [-43961.89599364, 1107.879350477, 9174.572409433],
            [117.4156315813, -181.6886653907, 5.272412059725],
            [-1.471904150197, 2.020760647112, -0.004957793401428],
        ]
        np.testing.assert_allclose(found.reshape(3, 3), expected, rtol=1e-11, atol=1e-9)
        axes = reference.axes(50.45, 15.3) @ reference.axes(*PRAGUE[:2]).T
        whole = np.kron(np.eye(3), axes)
        np.testing.assert_allclose(turned, whole @ covariance @ whole.T, rtol=0, atol=1e-12)


def test_lines_of_sight_of_a_station_are_straight_in_the_plane():
    """As far as is stated: .01 degrees at 100 km, 250 km from the centre."""
    geodesic = pytest.importorskip("pyproj").Geod(ellps="WGS84")
    azimuth = np.arange(0.0, 360.0, 5.0)
    place = np.full(len(azimuth), 48.0), np.full(len(azimuth), 12.5)
    station = PLANE.station(48.0, 12.5, 300.0, azimuth_sigma=1e-3)
    assert np.linalg.norm(station.position[:2]) == pytest.approx(250e3, rel=0.02)
    east, north, _ = geodesic.fwd(place[1], place[0], azimuth, np.full(len(azimuth), 1e5))
    ahead = (PLANE.to_local(north, east, 0.0) - station.position) @ station.axes.T
    error = (np.degrees(np.arctan2(ahead[:, 0], ahead[:, 1])) - azimuth + 180.0) % 360.0 - 180.0
    assert 0.005 < np.abs(error).max() < 0.01


def test_heights_of_pressure_altitudes():
    rows = [
        (10668, 101_325, 0, 10685.933259776),
        (10668, 101_325, 15, 11323.411353900),
        (10668, 99_325, -10, 10098.504188091),
        (3048, 103_000, 0, 3188.104717803),
        (12000, 101_325, 10, 12509.492702720),
    ]
    for altitude, qnh, warmer, expected in rows:
        found = Atmosphere(qnh, warmer).to_height(altitude)
        assert found == pytest.approx(expected, abs=1e-8)
        assert Atmosphere(qnh, warmer, 45.0).to_height(altitude) == pytest.approx(expected + 45)
    assert reference.pressure(10668.0) == pytest.approx(23842.27292089148, rel=1e-12)
    np.testing.assert_array_equal(np.isnan(Atmosphere().to_height([NAN, 0.0])), [True, False])


def test_traps():
    """What a wrong height or north does: the undulation and 1 degree of declination."""
    frame = LocalFrame(*PRAGUE)
    right = PLANE.to_local(*frame.polar_to_geodetic(60e3, 1.0, 10e3))
    sea = PLANE.to_local(*frame.polar_to_geodetic(60e3, 1.0, 10e3 - 45.0))
    assert 6.0 < np.linalg.norm(right[:2] - sea[:2]) < 9.0
    magnetic = PLANE.to_local(*frame.polar_to_geodetic(60e3, 1.0 + np.radians(5), 10e3))
    assert np.linalg.norm(right[:2] - magnetic[:2]) > 5000.0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: SystemPlane(95.0, 0.0), "latitude is 95.0"),
        (lambda: PLANE.to_geodetic([1.0, 2.0]), r"position has shape \(2,\)"),
        (lambda: PLANE.site([1.0]), r"position has shape \(1,\)"),
        (lambda: LocalFrame(0, 0).polar_to_geodetic(1e5, 60.0, 0.0), "pass degrees=True"),
        (lambda: LocalFrame(0, 0).polar_to_geodetic([1.0, 2.0], [0.1] * 3, 0.0), "do not fit"),
        (lambda: PLANE.station([50.0, 51.0], [14.0, 15.0]), r"latitude, longitude .* shape \(2,\)"),
        (lambda: Atmosphere(qnh=0.0), "qnh is 0.0"),
        (lambda: Atmosphere(undulation=NAN), "undulation is nan"),
        (lambda: polar_to_cartesian([1.0, 2.0, 3.0]), r"state has shape \(3,\)"),
        (lambda: cartesian_to_polar([1.0] * 4, origin=[0.0]), r"origin has shape \(1,\)"),
        (lambda: cartesian_to_polar([1.0] * 4, np.eye(3)), r"covariance has shape \(3, 3\)"),
        (lambda: transform([1.0] * 4, source=PLANE, target=PLANE), r"state has shape \(4,\)"),
        (lambda: track(Plots([0.0], [1e4], 0.1), [*radars(), Radar(**KIND)]), r"sensors\[3\]"),
    ],
)
def test_errors(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_what_is_no_frame():
    with pytest.raises(TypeError, match="frame is 'earth'; it must be a SystemPlane"):
        Radar(frame="earth", **KIND)
    with pytest.raises(TypeError, match="target is None"):
        transform([1.0] * 3, source=PLANE, target=None)


def test_places_where_the_flat_earth_makes_gains():
    """A site, and a plot of its radar, in the tangent and in the stereographic plane."""
    flat, plane, site = LocalFrame(50, 10), SystemPlane(50, 10), LocalFrame(51, 11.5, 100)
    target = site.polar_to_geodetic(200e3, np.radians(60.0), 10e3)
    for place, tangent, stereographic in (
        ((51, 11.5, 100), (105286.1361, 112290.5953), (105299.7906, 112305.1840)),
        (target, (276410.9195, 215788.1891), (276186.8156, 215612.6528)),
    ):
        np.testing.assert_allclose(flat.to_local(*place)[:2], tangent, rtol=0, atol=1e-4)
        # these are of EPSG 9809, which differs by a metre
        np.testing.assert_allclose(plane.to_local(*place)[:2], stereographic, rtol=0, atol=1.3)


def test_a_radar_of_a_local_frame_is_in_the_system_plane_there():
    properties = {"range_sigma": 50.0, "azimuth_sigma": 1e-3, "scan_period": 4.0, "name": "west"}
    place = 50.4, 15.1, 380.0
    radar = LocalFrame(50.0, 14.0, 200.0).radar(*place, **properties)
    expected = SystemPlane(50.0, 14.0).radar(*place, **properties)
    assert np.array_equal(radar.position, expected.position)
    assert radar.frame == expected.frame
    assert radar.name == "west"
