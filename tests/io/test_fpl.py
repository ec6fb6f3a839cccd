"""Flight plans from ICAO messages."""

import datetime
import json
import pickle

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tertia.geo import LocalFrame, SystemPlane
from tertia.io import FiledPlan, read_fpl
from tertia.tracker import Radar, Tracker

KNOT, FEET = 1852 / 3600, 0.3048
# places of our own: names stand for no published data
FIXES = {
    "LKPR": (50.10, 14.26),
    "EDDF": (50.03, 8.57),
    "LOWW": (48.11, 16.57),
    "LEBL": (41.297, 2.078),
    "DOBEN": (50.0, 13.6),
    "RAPET": (50.0, 13.0),
    "OKG": (50.06, 12.40),
    "BAMAS": (50.1, 11.6),
    "ALPHA": [(10.0, 10.0), (50.1, 10.8)],
    "SPESA": (50.1, 9.5),
    "DUB": (53.5, -6.3, -3.0),
}
AIRWAYS = {
    "L984": ["DOBEN", "RAPET", "OKG", "BAMAS"],
    "T180": ["SPESA", "ALPHA", "BAMAS"],
    "UZ5": ["OKG", "NOWHERE", "SPESA"],
    "Z1": ["LOWW", "LEBL"],
}
FRAME = LocalFrame(50.0, 12.0)


def message(
    route="N0450F350 OKG",
    *,
    callsign="CSA123",
    kind="A320/M",
    start="LKPR0930",
    end="EDDF0055 EDDM",
    others="DOF/261122",
):
    return f"(FPL-{callsign}-IS\n-{kind}-SDE2FGHIRWY/LB1\n-{start}\n-{route}\n-{end}\n-{others})"


def read(text, **options):
    options = {"fixes": FIXES, "airways": AIRWAYS, "frame": FRAME} | options
    return read_fpl(text, **options)


def plan_of(*arguments, **options):
    (plan,) = read(message(*arguments, **options))
    return plan


def inner(route, **options):
    """Names of the waypoints between the aerodromes."""
    return plan_of(route, **options).names[1:-1]


def test_airways_changes_of_speed_and_level_and_procedures():
    plan = plan_of(
        "N0450F350 DOBEN1A DOBEN L984 BAMAS/N0440F330 T180 SPESA SPESA2C", callsign="CSA123/A4521"
    )
    names = ("LKPR", "DOBEN", "RAPET", "OKG", "BAMAS", "ALPHA", "SPESA", "EDDF")
    assert plan.names == names
    assert plan.unknown_procedures == ("DOBEN1A", "SPESA2C")
    np.testing.assert_allclose(plan.airspeeds, [231.5] * 4 + [226.3555555556] * 3, rtol=1e-12)
    np.testing.assert_allclose(plan.levels, [10668.0] * 4 + [10058.4] * 4, rtol=1e-12)
    # of two places the nearer one
    place = FRAME.to_local(np.array([50.1]), np.array([10.8]))[0, :2]
    np.testing.assert_allclose(plan.waypoints[5], place)
    assert (plan.mode_3a, plan.name) == (2385, "CSA123")
    assert plan.start_time == 9.5 * 3600 + 900


# speeds and levels of field 15
@pytest.mark.parametrize(
    ("cruise", "speed", "level"),
    [
        ("N0450F350", 450 * KNOT, 350 * 100 * FEET),
        ("K0830S1130", 230.5555555556, 11_300.0),
        ("M084F370", 247.8583745476, 370 * 100 * FEET),
        ("M080M0840", 0.8 * np.sqrt(1.4 * 287.05287 * (288.15 - 0.0065 * 8400)), 8400.0),
        ("N0110A055", 110 * KNOT, 5500 * FEET),
        ("N0095VFR", 95 * KNOT, np.nan),
        ("K0160VFR", 160 / 3.6, np.nan),
    ],
)
def test_speeds_and_levels(cruise, speed, level):
    plan = plan_of(f"{cruise} OKG DCT")
    np.testing.assert_allclose(plan.airspeeds, speed, rtol=1e-11)
    np.testing.assert_allclose(plan.levels, level, rtol=1e-11)


@pytest.mark.parametrize(
    ("route", "names"),
    [
        ("N0450F350 OKG", ("OKG",)),
        ("N0450F350 DCT OKG DCT SPESA DCT", ("OKG", "SPESA")),
        ("N0450F350 DOBEN L984 OKG", ("DOBEN", "RAPET", "OKG")),
        ("N0450F350 SPESA T180 BAMAS L984 OKG", ("SPESA", "ALPHA", "BAMAS", "OKG")),
        ("N0450F350 OKG OKG L984 BAMAS", ("OKG", "BAMAS")),
        ("N0450F350 4940N01330E SPESA", ("4940N01330E", "SPESA")),
        ("N0450F350 49N013E SPESA", ("49N013E", "SPESA")),
        ("N0450F350 OKG270040", ("OKG270040",)),
        ("N0450F350 VFR OKG IFR SPESA", ("OKG", "SPESA")),
        ("N0450F350 OKG GAT SPESA OAT T", ("OKG", "SPESA")),
        ("N0450F350 OKG STAY1/0130 SPESA", ("OKG", "SPESA")),
        ("N0450F350 OKG1A OKG SPESA SPESA1B", ("OKG", "SPESA")),
        ("N0450F350 OKG/M082F290 SPESA/N0400VFR BAMAS", ("OKG", "SPESA", "BAMAS")),
        ("N0450F350 C/OKG/M082F290F350 SPESA", ("OKG", "SPESA")),
        ("N0450F350 C/48N050W/M082F290PLUS SPESA", ("48N050W", "SPESA")),
        ("N0450F350 DCT", ()),
        ("N0450F350", ()),
    ],
)
def test_routes(route, names):
    assert inner(route) == names


def test_places():
    plan = plan_of("N0450F350 4940N01330E 46S078W DUB180040")
    frame = LocalFrame(53.5, -6.3)
    where = np.array([[49 + 40 / 60, 13.5], [-46.0, -78.0]])
    there = FRAME.to_local(*where.T)[:, :2]
    np.testing.assert_allclose(plan.waypoints[1:3], there, atol=1e-6)
    # a radial is magnetic: 180° is 177° true; a level is no place of the beacon, so a chord
    latitude, longitude, _ = frame.polar_to_geodetic(40 * 1852.0, np.radians(177.0), 0.0)
    there = FRAME.to_local(np.array([latitude]), np.array([longitude]))[0, :2]
    assert np.linalg.norm(plan.waypoints[3] - there) < 1.0


def test_a_climb_in_cruise_is_at_its_lower_level_and_a_stay_takes_its_time():
    plan = plan_of("N0450F350 C/OKG/M082F290F350 SPESA")
    assert plan.levels[1] == pytest.approx(290 * 100 * FEET)
    plan, stays = (plan_of(f"N0450F350 OKG{stay} SPESA") for stay in ("", " STAY1/0130"))
    assert stays.times[1] == pytest.approx(plan.times[1])
    assert stays.times[2] - plan.times[2] == pytest.approx(5400, rel=0.01)


def test_heights_are_unknown_while_the_aircraft_climbs_or_descends():
    route = "N0450F350 LOWW OKG SPESA"
    plan = plan_of(route, start="LEBL0600", end="LKPR0300")
    assert np.isnan(plan.heights[[0, -1]]).all()
    assert plan.heights[2] == pytest.approx(10668.0)
    assert np.isnan(plan.height(plan.start_time + 60))
    types = pl.DataFrame({"aircraft_type": ["A320"], "climb_m_s": [1.0]})
    (slow,) = read(message(route, start="LEBL0600", end="LKPR0300"), types=types)
    assert slow.heights is None
    # where they are unknown, they are no reason against a plan
    position, _ = plan.at(plan.start_time + np.array([60.0, 3000.0]))
    assert np.isfinite(position).all()


def test_types_have_banks_and_rates_of_turn():
    table = pl.DataFrame(
        {"aircraft_type": ["A320", "C172"], "bank_deg": [22.0, None], "turn_rate_deg_s": [2.0, 3.0]}
    )
    for types in (table, table.to_pandas()):
        (plan,) = read(message(), types=types)
        assert (plan.bank, plan.turn_rate) == pytest.approx(tuple(np.radians([22.0, 2.0])))
        (plan,) = read(message(kind="C172/L"), types=types)
        assert (plan.bank, plan.turn_rate) == pytest.approx(tuple(np.radians([25.0, 3.0])))
    (plan,) = read(message(), types={"A320": 0.4})
    assert plan.bank == pytest.approx(0.4)
    (plan,) = read(message(kind="ZZZZ/L", others="TYP/A320 DOF/261122"), types={"A320": 0.4})
    assert (plan.aircraft_type, plan.bank) == ("A320", pytest.approx(0.4))


def test_winds_change_ground_speeds():
    still = plan_of("N0450F350 OKG")
    (along,) = read(message("N0450F350 OKG"), winds=(30.0, 0.0))
    # to the west, against the wind
    assert np.all(along.speeds < still.speeds - 29.0)
    (above,) = read(message("N0450F350 OKG"), winds=[[0, 0, 0], [10_000, 30, 0], [11_000, 30, 0]])
    np.testing.assert_allclose(above.speeds, along.speeds)
    u = np.diff(still.waypoints, axis=0)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    # w·u + sqrt(V² − (w×u)²), w = (30, 0)
    expected = 30 * u[:, 0] + np.sqrt(still.airspeeds**2 - (30 * u[:, 1]) ** 2)
    np.testing.assert_allclose(along.speeds, expected, rtol=1e-12)
    with pytest.raises(ValueError, match="leg 0 cannot be flown against this wind"):
        read(message("N0050F100 OKG"), winds=(100.0, 0.0))


def test_identities_dates_and_other_information():
    others = "PBN/A1B1C1 DOF/261122 REG/OKABC EET/EDUU0010 CODE/4952A1 OPR/CSA-AIR RMK/AGCS A-B"
    text = message(callsign="CSA9XX/A2000", others=others)
    (plan,) = read(text)
    assert plan.date == datetime.date(2026, 11, 22)
    assert (plan.icao_address, plan.mode_3a, plan.callsign) == (0x4952A1, 0o2000, "CSA9XX")
    assert plan.identity is None
    assert plan.fields["OPR"] == "CSA-AIR"
    assert plan.fields["RMK"] == "AGCS A-B"
    assert (plan.off_block_time, plan.elapsed_time) == (34_200.0, 3300.0)
    (plan,) = read(text, taxi_time=600)
    assert plan.start_time == 34_800.0
    (plan,) = read(message(others="0"))
    assert (plan.date, plan.icao_address, plan.fields) == (None, None, {})
    supplement = message().removesuffix(")") + "\n-E/0345 P/120 R/UVE S/M J/L)"
    assert read(supplement)[0].fields == {"DOF": "261122"}


def test_places_that_have_no_indicator():
    plan = plan_of(start="ZZZZ0930", others="DEP/4940N01330E DOF/261122")
    assert plan.names[0] == "4940N01330E"
    plan = plan_of("N0100VFR", start="ZZZZ0930", end="ZZZZ0100", others="DEP/OKG DEST/SPESA")
    assert plan.names == ("OKG", "SPESA")


def test_messages_in_a_file_and_tables(tmp_path):
    text = f"ZCZC ABC123\nFF LKPRZPZX\n{message()}\nNNNN\n{message(callsign='DLH4XY')}"
    file = tmp_path / "plans.txt"
    file.write_text(text, encoding="utf-8")
    fixes = [
        (name, *place)
        for name, value in FIXES.items()
        for place in (value if isinstance(value, list) else [value[:2]])
    ]
    fixes = pl.DataFrame(fixes, ["name", "latitude_deg", "longitude_deg"], orient="row")
    rows = [(name, k, fix) for name, along in AIRWAYS.items() for k, fix in enumerate(along)]
    airways = pl.DataFrame(rows[::-1], ["airway", "sequence", "fix"], orient="row")
    fixes.write_csv(tmp_path / "fixes.csv")
    airways.write_csv(tmp_path / "airways.csv")
    features = [
        {
            "type": "Feature",
            "geometry": {"type": "Point", "coordinates": [longitude, latitude]},
            "properties": {"name": name},
        }
        for name, latitude, longitude in fixes.rows()
    ]
    collection = {"type": "FeatureCollection", "features": features}
    (tmp_path / "fixes.geojson").write_text(json.dumps(collection), encoding="utf-8")
    (tmp_path / "bad.geojson").write_text('{"features": [{}]}', encoding="utf-8")
    with pytest.raises(ValueError, match="cannot read"):
        read(text, fixes=tmp_path / "bad.geojson")
    for source, options in (
        (text, {}),
        (file, {"fixes": fixes, "airways": airways}),
        (text, {"fixes": fixes.to_pandas(), "airways": airways.to_pandas()}),
        (text, {"fixes": tmp_path / "fixes.geojson"}),
        (text, {"fixes": tmp_path / "fixes.csv", "airways": str(tmp_path / "airways.csv")}),
    ):
        plans = read(source, **options)
        assert [plan.name for plan in plans] == ["CSA123", "DLH4XY"]
        assert plans[0].names == ("LKPR", "OKG", "EDDF")


def test_a_tracker_takes_them_and_they_are_saved():
    plan = plan_of("N0450F350 DOBEN1A DOBEN L984 BAMAS")
    assert isinstance(plan, FiledPlan)
    same = pickle.loads(pickle.dumps(plan))
    assert (same.names, same.date, same.unknown_procedures) == (
        plan.names,
        plan.date,
        plan.unknown_procedures,
    )
    np.testing.assert_array_equal(same.waypoints, plan.waypoints)
    radar = Radar(range_sigma=50, azimuth_sigma=0.08, scan_period=4, degrees=True)
    assert pickle.loads(pickle.dumps(Tracker([radar], plans=[plan]))).plans[0].names == plan.names
    (plan,) = read(message(), frame=SystemPlane(50.0, 12.0))
    assert np.isfinite(plan.waypoints).all()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (message("N0450F350 DOBEN T180 SPESA"), "'T180' does not connect 'DOBEN' and 'SPESA'"),
        (message("N0450F350 OKG L984 SPESA"), "'L984' does not connect 'OKG' and 'SPESA'"),
        (message("N0450F350 OKG L984"), "'L984' is at the end of the route"),
        (message("N0450F350 OKG L984 Z1 LEBL"), "'L984' does not connect 'OKG' and 'Z1'"),
        (message("N0450F350 OKG L984 BAMAS1A"), "'L984' does not connect"),
        (message("N0450F350 OKG UZ5 SPESA"), "'NOWHERE', which is not a fix"),
        (message("N0450F350 OKG NOFIX SPESA"), "'NOFIX' is neither a fix nor an airway"),
        (message("N0450F350 NOFIX/N0440F330 SPESA"), "'NOFIX/N0440F330' is neither"),
        (message("N450F350 OKG"), "'N450F350' is not a speed and level"),
        (message("N0450F35 OKG"), "'N0450F35' is not a speed and level"),
        (message("N0000F350 OKG"), "'N0000F350' has no speed"),
        (message("M082VFR OKG"), "has a Mach number, but no level"),
        (message("N0450F350 OKG/N0440"), "'N0440' is not a speed and level"),
        (message("N0450F350 T OKG"), "'T' is not at the end"),
        (message("N0450F350 9940N01330E OKG"), "is not a place on the earth"),
        (message("N0450F350 4960N01330E OKG"), "is not a place on the earth"),
        (message("N0450F350 4940N013E OKG"), "minutes in only one of its coordinates"),
        (message("N0450F350 OKG361040"), "has the radial 361"),
        (message(""), "there is no route"),
        (message(start="LKXX0930"), "aerodrome 'LKXX' is not among the fixes"),
        (message(start="LKPR2430"), "'2430' is not a time"),
        (message(start="LKPR0961"), "'0961' is not a time"),
        (message(start="LKPR"), "field 13 is 'LKPR'"),
        (message(end="EDDF"), "field 16 is 'EDDF'"),
        (message(callsign="TOOLONG12"), "field 7 is 'TOOLONG12'"),
        (message(callsign="CSA123/A4589"), "field 7"),
        (message(kind="A320"), "field 9 is 'A320'"),
        (message(others="DOF/261322"), "DOF is '261322'; there is no such day"),
        (message(others="DOF/2611"), "it must be YYMMDD"),
        (message(others="CODE/XYZ"), "CODE is 'XYZ'"),
        (message(others="HELLO"), "field 18 is 'HELLO'"),
        (message("N0450F350", end="LKPR0100"), "waypoints"),
        ("(DEP-CSA123-LKPR0930-EDDF)", "it must be FPL"),
        ("(FPL-CSA123-IS)", "field 9 is missing"),
        ("FPL-CSA123", "text has no message"),
        (message().removesuffix(")"), "text has no message"),
    ],
)
def test_bad_messages_are_refused_in_one_line(text, reason):
    with pytest.raises(ValueError, match=r"\w") as error:
        read(text)
    said = str(error.value)
    assert reason in said
    assert "\n" not in said


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"fixes": {"OKG": (500.0, 12.0)}}, "is that in degrees"),
        ({"fixes": {"OKG": ("a", "b")}}, "it must be in degrees"),
        ({"fixes": pl.DataFrame({"name": ["OKG"]})}, "fixes has no column latitude_deg"),
        ({"fixes": 7}, "fixes is 7"),
        ({"airways": pl.DataFrame({"airway": ["A"]})}, "airways has no column sequence"),
        ({"frame": None}, "frame is None"),
        ({"winds": [1, 2, 3]}, "winds has shape"),
        ({"taxi_time": float("nan")}, "taxi_time is nan"),
        ({"types": 3}, "types is 3"),
    ],
)
def test_wrong_options(options, reason):
    with pytest.raises((ValueError, TypeError), match=reason):
        read(message(), **options)


TOKENS = st.sampled_from(
    [
        *FIXES,
        *AIRWAYS,
        "(FPL",
        "-",
        ")",
        "CSA123",
        "/A4521",
        "IS",
        "A320/M",
        "LKPR0930",
        "EDDF0055",
        "N0450F350",
        "/N0440F330",
        "M084F370",
        "C/48N050W/M082F290F350",
        "4940N01330E",
        "00N000E",
        "OKG270040",
        "OKG000000",
        "STAY1/0130",
        "DCT",
        "VFR",
        "T",
        "DOF/261122",
        "DOF/",
        "CODE/4952A1",
        "ZZZZ0930",
        "DEP/",
        "\n",
        "\r",
        "٣",
        "\u2028",
    ]
)
WORDS = st.lists(st.one_of(TOKENS, st.text(max_size=6)), max_size=12).map(" ".join)


@settings(max_examples=300, deadline=None)
@given(
    st.one_of(
        st.text(),
        WORDS,
        st.builds(
            lambda *parts: "(FPL-" + "-".join(parts) + ")", WORDS, WORDS, WORDS, WORDS, WORDS, WORDS
        ),
        st.builds(lambda route: message("N0450F350 " + route), WORDS),
        st.builds(lambda others: message(others=others), WORDS),
        st.builds(lambda start, end: message(start=start, end=end), WORDS, WORDS),
    )
)
def test_any_text_gives_plans_or_one_line(text):
    try:
        plans = read(text)
    except ValueError as error:
        assert len(str(error).splitlines()) == 1  # noqa: PT017  # or there are plans
        return
    assert all(np.isfinite(plan.times).all() for plan in plans)
