"""Identities by their kinds: which of them decides, what tracks know of them, what is refused."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from places import DATA
from tracker.flights import RADAR, noisy

from tertia.flightplan import CorrelationStatus, FlightPlan
from tertia.tracker import COLUMNS, Plots, Tracker, smooth_tracks, track

LEBL = DATA / "lebl_radar" / "plots_0800_0830.csv.gz"
SCANS = 60
TIME = 4.0 * np.arange(SCANS)


def crossing(seed, **kinds):
    """Plots of two aircraft that meet in the middle at a small angle, and their targets.

    Each kind of identities has an array (2, SCANS).
    """
    rng = np.random.default_rng(seed)
    middle = TIME - TIME[SCANS // 2]
    start = np.array([5e3, 40e3])
    flown = [start + np.outer(middle, velocity) for velocity in ([150.0, 4.0], [150.0, -4.0])]
    distance, azimuth = (
        np.concatenate(parts)
        for parts in zip(*(noisy(one, RADAR, rng) for one in flown), strict=True)
    )
    columns = {name: np.asarray(values).reshape(-1) for name, values in kinds.items()}
    plots = Plots(np.tile(TIME, 2), distance, azimuth, **columns)
    return plots, np.repeat([0, 1], SCANS)


def each(first, second):
    """Identities of two aircraft that do not change."""
    return np.repeat([[first], [second]], SCANS, axis=1)


def is_pure(plots, target, **options):
    """Whether there is one track per target, with all of its plots."""
    own = track(plots, [RADAR], **options).track_of_plot
    return [len(np.unique(own[target == one])) for one in (0, 1)] == [1, 1] and own[0] != own[-1]


ADDRESSES = each(0x3C4DC1, 0x4CA123)
CODES = each(0o4204, 0o1000)
CALLSIGNS = each("CSA123", "KLM1023")


def straight(n=SCANS, start=0.0, seed=7, place=(10e3, 30e3), **kinds):
    """Plots of one aircraft that flies straight."""
    time = start + 4.0 * np.arange(n)
    position = np.array(place) + np.outer(time, [120.0, -80.0])
    return Plots(time, *noisy(position, RADAR, np.random.default_rng(seed)), **kinds)


@pytest.mark.parametrize("motion", ["imm", "cv"])
def test_an_address_is_an_identity_that_is_hardly_ever_wrong(motion):
    plots, _ = crossing(1, icao_address=ADDRESSES)
    same = Plots(plots.time, plots.range, plots.azimuth, identity=plots.icao_address)
    found = track(plots, [RADAR], motion=motion)
    other = track(same, [RADAR], motion=motion, identity_error_probability=1e-9)
    for column in COLUMNS:
        if column.name not in {"icao_address", "identity"}:
            np.testing.assert_array_equal(
                getattr(found, column.name), getattr(other, column.name), column.name
            )
    np.testing.assert_array_equal(found.icao_address, other.identity)
    assert np.all(found.identity == -1)
    # a code is one that is wrong as often as others
    plots, _ = crossing(1, mode_3a=CODES)
    same = Plots(plots.time, plots.range, plots.azimuth, identity=plots.mode_3a)
    np.testing.assert_array_equal(
        track(plots, [RADAR]).track_of_plot, track(same, [RADAR]).track_of_plot
    )


@pytest.mark.parametrize("seed", range(5))
def test_an_address_decides_where_codes_are_wrong(seed):
    # replies of both overlap where they are close: each has the code of the other
    wrong = CODES.copy()
    wrong[:, 20:40] = wrong[::-1, 20:40]
    assert is_pure(*crossing(seed, icao_address=ADDRESSES, mode_3a=wrong))
    assert is_pure(*crossing(seed, icao_address=ADDRESSES, mode_3a=wrong, callsign=CALLSIGNS))
    assert not is_pure(*crossing(seed, mode_3a=wrong))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("kind", ["callsign", "mode_3a"])
def test_without_an_address_callsign_and_code_tell(seed, kind):
    kinds = {"callsign": CALLSIGNS, "mode_3a": CODES}
    assert is_pure(*crossing(seed, **{kind: kinds[kind]}))
    # as some replies have an address and others do not
    some = np.where(np.arange(SCANS) % 3 > 0, ADDRESSES, -1)
    assert is_pure(*crossing(seed, **{kind: kinds[kind]}, icao_address=some))


def test_without_any_identity_they_are_confused():
    assert not all(is_pure(*crossing(seed)) for seed in range(5))


@pytest.mark.parametrize("others", [{}, {"icao_address": 0x3C4DC1}, {"callsign": "CSA123"}])
def test_a_new_code_in_flight_is_of_the_same_track(others):
    codes = np.where(np.arange(SCANS) < 30, 0o4204, 0o2345)
    plots = straight(mode_3a=codes, **others)
    found = track(plots, [RADAR])
    assert np.all(found.track == 1)
    assert len(found) == SCANS
    assert np.all(found.plot == np.arange(SCANS))
    np.testing.assert_array_equal(found.mode_3a[:32], 0o4204)
    np.testing.assert_array_equal(found.mode_3a[32:], 0o2345)


def test_aircraft_with_one_code_far_apart_are_two():
    one, two = straight(seed=1), straight(seed=2, place=(-60e3, 70e3))
    distance, azimuth = (
        np.concatenate([getattr(plots, name) for plots in (one, two)])
        for name in ("range", "azimuth")
    )
    plots = Plots(np.tile(TIME, 2), distance, azimuth, mode_3a=0o7000)
    found = track(plots, [RADAR])
    assert len(np.unique(found.track)) == 2
    assert np.all(found.mode_3a == 0o7000)
    assert is_pure(plots, np.repeat([0, 1], SCANS))
    assert len(np.unique(smooth_tracks(plots, [RADAR], found).track)) == 2


@pytest.mark.parametrize(
    ("kind", "value", "count"),
    [("icao_address", 0x3C4DC1, 1), ("callsign", "CSA123", 1), ("mode_3a", 0o4204, 2)],
)
def test_what_is_not_shared_resumes_a_track_after_a_long_gap(kind, value, count):
    early, late = straight(15), straight(15, start=240.0, seed=8)
    time, distance, azimuth = (
        np.concatenate([getattr(plots, name) for plots in (early, late)])
        for name in ("time", "range", "azimuth")
    )
    plots = Plots(time, distance, azimuth, **{kind: value})
    found = track(plots, [RADAR])
    assert len(np.unique(found.track)) == count
    assert len(np.unique(smooth_tracks(plots, [RADAR], found).track)) == 1
    smoothed = smooth_tracks(plots, [RADAR], found)
    assert np.all(getattr(smoothed, kind) == value)


PLAN = np.array([[10e3, 30e3], [10e3 + 120.0 * 400, 30e3 - 80.0 * 400]])
ROUTE = {"waypoints": PLAN, "speeds": np.hypot(120.0, 80.0)}


@pytest.mark.parametrize(
    ("plan", "heard", "is_linked"),
    [
        ({"callsign": "csa123"}, {"callsign": "CSA123"}, True),
        # the callsign tells, whatever code is assigned
        ({"callsign": "CSA123", "mode_3a": 0o1}, {"callsign": "CSA123", "mode_3a": 0o4204}, True),
        ({"mode_3a": 0o4204}, {"mode_3a": 0o4204, "icao_address": 5}, True),
        ({"icao_address": 5, "mode_3a": 0o1}, {"mode_3a": 0o4204, "icao_address": 5}, True),
        ({"icao_address": 5}, {"icao_address": 6}, False),
        ({"callsign": "CSA124"}, {"callsign": "CSA123"}, False),
    ],
)
def test_plans_are_found_by_what_they_have(plan, heard, is_linked):
    filed = FlightPlan(**ROUTE, **plan)
    assert pickle.loads(pickle.dumps(filed)).callsign == filed.callsign
    found = track(straight(**heard), [RADAR], plans=[filed])
    linked = found.plan_status == CorrelationStatus.LINKED
    assert linked[10:].all() if is_linked else not np.any(found.plan >= 0)


def test_a_new_code_keeps_the_plan_if_the_address_is_the_same():
    codes = np.where(np.arange(SCANS) < 30, 0o4204, 0o2345)
    filed = FlightPlan(**ROUTE, mode_3a=0o4204)
    found = track(straight(mode_3a=codes, icao_address=5), [RADAR], plans=[filed])
    assert np.all(found.plan[5:] == 0)
    assert np.all(found.plan_status[5:] == CorrelationStatus.LINKED)
    # without one it may be another aircraft
    alone = track(straight(mode_3a=codes), [RADAR], plans=[filed])
    assert np.any(alone.plan[32:] == -1)


def test_emergency_codes_are_shown_and_are_no_identities():
    codes = np.full(SCANS, 0o4204)
    codes[12] = codes[30:40] = 0o7700
    tracker = Tracker([RADAR], plans=[FlightPlan(**ROUTE, mode_3a=0o4204)])
    found = tracker.update(straight(mode_3a=codes))
    of = dict(zip(found.plot.tolist(), found.mode_3a.tolist(), strict=True))
    assert np.all(found.track == 1)
    assert [of[12], of[30], of[31], of[39], of[40]] == [
        0o4204,
        0o4204,
        0o7700,
        0o7700,
        0o4204,
    ]
    np.testing.assert_array_equal(tracker.suspended_plans, [1])
    assert np.all(found.plan[5:] == 0)


def test_callsigns_are_read_as_they_are_written():
    texts = ["csa123 ", None, "", float("nan"), "N-12", "KLM1023 "]
    plots = Plots(np.arange(6.0), 1e4, 1.0, callsign=texts)
    assert plots.callsign.tolist() == ["CSA123", "", "", "", "N-12", "KLM1023"]
    assert plots[[4, 0]].callsign.tolist() == ["N-12", "CSA123"]
    table = plots.to_polars()
    assert table["callsign"].to_list() == plots.callsign.tolist()
    assert "mode_3a" not in table.columns
    found = track(straight(callsign="csa123"), [RADAR])
    assert set(found.callsign) == {"CSA123"}
    again = pickle.loads(pickle.dumps(found))
    np.testing.assert_array_equal(again.callsign, found.callsign)


@pytest.mark.parametrize(
    ("kinds", "error", "match"),
    [
        ({"mode_3a": [1, 7700]}, ValueError, r"mode_3a\[1\] is 7700; .* 12 bits, as 0o7700"),
        ({"mode_3a": -2}, ValueError, "mode_3a is -2"),
        ({"mode_3a": "7700"}, TypeError, "mode_3a has dtype"),
        ({"icao_address": 1 << 24}, ValueError, "icao_address is 16777216; .* 24 bits"),
        ({"icao_address": [1.5, 2.0]}, TypeError, "icao_address has dtype"),
        ({"callsign": ["A", "TOOLONGER"]}, ValueError, r"callsign\[1\] is 'TOOLONGER'; .* 8"),
        ({"callsign": "CSÁ1"}, ValueError, "callsign is 'CSÁ1'"),
        ({"callsign": ["A", 3.5]}, (TypeError, ValueError), "callsign"),
        ({"callsign": np.array(["A", 3], dtype=object)}, TypeError, r"callsign\[1\] is 3"),
        ({"callsign": ["A", "B", "C"]}, ValueError, r"callsign has shape \(3,\)"),
    ],
)
def test_what_no_transponder_sends_is_refused(kinds, error, match):
    with pytest.raises(error, match=match):
        Plots([0.0, 1.0], 1e4, 1.0, **kinds)
    if not isinstance(next(iter(kinds.values())), (list, np.ndarray)):
        with pytest.raises(error, match=match):
            FlightPlan(**ROUTE, **kinds)


@pytest.mark.skipif(not LEBL.is_file(), reason="the recording is not here")
@pytest.mark.parametrize("kinds", [["icao_address"], ["icao_address", "mode_3a", "callsign"]])
def test_a_real_recording_has_a_track_per_aircraft(kinds):
    pl = pytest.importorskip("polars")
    rows = pl.read_csv(LEBL, infer_schema_length=None).filter(pl.col("rho_nm") > 2.5)
    address = rows["icao24"].str.to_integer(base=16, strict=False).fill_null(-1).to_numpy()
    columns = {
        "icao_address": address,
        "mode_3a": rows["mode3a"]
        .cast(pl.String)
        .str.to_integer(base=8, strict=False)
        .fill_null(-1),
        "callsign": rows["ident"],
    }
    plots = Plots(
        rows["tod_s"],
        rows["rho_nm"] * 1852.0,
        rows["theta_deg"],
        height=rows["fl"].cast(pl.Float64, strict=False) * 30.48,
        degrees=True,
        **{name: columns[name] for name in kinds},
    )
    found = track(plots, [RADAR])
    heard = address[found.plot]
    pairs = np.column_stack([found.track, heard])[(found.plot >= 0) & (heard >= 0)]
    pairs = np.unique(pairs, axis=0)
    aircraft = np.unique(address[address >= 0])
    assert len(pairs) == len(np.unique(pairs[:, 0])) == len(aircraft) == 94
    assert set(pairs[:, 1]) == set(aircraft)


def test_false_plots_without_an_address_are_seldom_those_of_a_target_that_has_one():
    """As where it has left the coverage: its track coasts, and its gate becomes large."""
    radar = replace(RADAR, scan_period=12.0, max_range=100e3)
    taken = 0
    for seed in range(12):
        rng = np.random.default_rng([61, seed])
        parts = []
        for k in range(20):
            time = np.arange(rng.uniform(0.0, 12.0), 900.0, 12.0)
            course, start = rng.uniform(0.0, 2 * np.pi), rng.uniform(-60e3, 60e3, 2)
            position = start + np.outer(time, 220.0 * np.array([np.sin(course), np.cos(course)]))
            seen = (np.hypot(*position.T) < radar.max_range) & (rng.random(len(time)) < 0.9)
            distance, azimuth = noisy(position[seen], radar, rng)
            parts.append((time[seen], distance, azimuth, np.full(seen.sum(), 1 + k)))
        count = 60 * 75
        far = radar.max_range * np.sqrt(rng.random(count))
        parts.append(
            (900.0 * rng.random(count), far, 2 * np.pi * rng.random(count), np.full(count, -1))
        )
        time, distance, azimuth, address = (np.concatenate(one) for one in zip(*parts, strict=True))
        table = track(Plots(time, distance, azimuth, icao_address=address), [radar])
        own = table[table.confirmed & (table.plot >= 0) & (table.icao_address >= 0)]
        taken += np.sum(address[own.plot] < 0)
    # 25 if plots without an address are as likely as those with one
    assert taken < 13
