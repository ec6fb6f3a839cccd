"""Flight plans in the forms that ICAO Doc 4444, appendix 3, and the IFPS users manual allow.

The messages are our own, and so are the places: only the forms are those of the documents.
"""

import datetime

import numpy as np
import pytest

from tertia.geo import LocalFrame
from tertia.io import read_fpl

KNOT, FEET, MILE = 1852 / 3600, 0.3048, 1852.0
FIXES = {
    "QAAA": (51.40, -0.50),
    "QBBB": (49.00, 2.50),
    "QCCC": (50.00, 8.60),
    "QDDD": (45.60, 8.70),
    "QEEE": (47.60, -52.70),
    "STAR": (51.50, -3.00, -4.0),
    "LINNA": (52.00, -15.00),
    "ALPEN": (46.50, 8.00),
    "BERGA": (47.50, 8.10),
    "CERVO": (48.50, 8.20),
    "DORNA": (49.50, 8.40),
    "EICHE": (48.50, 6.00),
    "FALKE": (48.60, 10.0),
}
AIRWAYS = {
    "Q9": ["QAAA", "STAR"],
    "UQ9": ["QAAA", "STAR", "LINNA"],
    "N850": ["ALPEN", "BERGA", "CERVO", "DORNA"],
    "Z77": ["EICHE", "CERVO", "FALKE"],
}
ROUTE = "N0430F350 ALPEN N850 DORNA"
NORTH = ("QDDD", "ALPEN", "BERGA", "CERVO", "DORNA", "QCCC")


def message(seven="TST101-IS", *, nine="A320/M-SDFGHIRWY/LB1", end="QCCC0115", **fields):
    fields = {"start": "QDDD0930", "route": ROUTE, "others": "0"} | fields
    return f"(FPL-{seven}-{nine}-{fields['start']}-{fields['route']}-{end}-{fields['others']})"


def read(text):
    return read_fpl(text, fixes=FIXES, airways=AIRWAYS, frame=LocalFrame(49.0, 4.0))


def north(route, **fields):
    return message(route=f"N0430F350 {route}", **fields)


def names(*inner):
    return ("QDDD", *inner, "QCCC")


# the message, its waypoints, and other attributes of the plan
FORMS = {
    "a line a field": (
        "(FPL-TST101-IS\n-A320/M-S/C\n-QDDD0930\n-N0430F350 ALPEN N850\nDORNA\n-QCCC0115\n-0)",
        NORTH,
        {},
    ),
    "header and end of a telegram": (
        f"ZCZC TTA001\r\nFF EUCHZMFP\r\n220900 QDDDZPZX\r\n{message()}\r\n\r\nNNNN",
        NORTH,
        {},
    ),
    "numbers of messages": (
        message().replace("(FPL-", "(FPLA/B001A/B000-"),
        NORTH,
        {"name": "TST101"},
    ),
    "a registration as callsign": (message("OKABC-VG"), NORTH, {"name": "OKABC"}),
    "a code of the transponder": (message("TST101/A5100-IS"), NORTH, {"mode_3a": 0o5100}),
    "several aircraft": (
        message("ROCK1-IM", nine="3F15/M-SDU/C"),
        NORTH,
        {"aircraft_type": "F15"},
    ),
    "aircraft without a designator": (
        message(nine="ZZZZ/L-S/C", others="TYP/ULAC"),
        NORTH,
        {"aircraft_type": "ULAC"},
    ),
    "two alternates": (message(end="QCCC0115 QAAA QBBB"), NORTH, {"elapsed_time": 4500.0}),
    "longer than half a day": (message(end="QCCC1342"), NORTH, {"elapsed_time": 49_320.0}),
    "at midnight": (message(start="QDDD0000"), NORTH, {"off_block_time": 0.0}),
    "field 18 in full": (
        message(
            others="STS/HOSP PBN/A1B1C1D1 NAV/RNP2 COM/CPDLC DAT/V SUR/260B DOF/261123 REG/OKABC "
            "EET/EDGG0020 EDFF0040 4730N0043 SEL/BPAM CODE/3C65AC OPR/TEST AIR RMK/TCAS, AGCS-2"
        ),
        NORTH,
        {"icao_address": 0x3C65AC, "date": datetime.date(2026, 11, 23)},
    ),
    "what IFPS adds to field 18": (
        message(others="DOF/261123 RVR/075 RFP/Q2 ORGN/EBBDYYYX PER/C TALT/QAAA RALT/QBBB"),
        NORTH,
        {"date": datetime.date(2026, 11, 23)},
    ),
    "a route in flight": (
        message(others="RIF/CERVO Z77 FALKE QBBB RMK/A)".removesuffix(")")),
        NORTH,
        {},
    ),
    "supplementary information": (
        message().removesuffix(")") + "-E/0445 P/TBN R/VE S/M J/L D/2 8 C YELLOW A/RED C/SMITH)",
        NORTH,
        {"fields": {}},
    ),
    "procedures": (
        north("ALPEN1A ALPEN N850 DORNA DORNA2B"),
        NORTH,
        {"unknown_procedures": ("ALPEN1A", "DORNA2B")},
    ),
    "direct, word by word": (
        north("DCT ALPEN DCT BERGA DCT"),
        names("ALPEN", "BERGA"),
        {},
    ),
    "without points": (north("DCT"), names(), {}),
    "an airway backwards": (
        north("DORNA N850 ALPEN"),
        names("DORNA", "CERVO", "BERGA", "ALPEN"),
        {},
    ),
    "airways that meet at a point": (
        north("ALPEN N850 CERVO Z77 FALKE"),
        names("ALPEN", "BERGA", "CERVO", "FALKE"),
        {},
    ),
    "airways that cross without a point": (
        north("ALPEN N850 Z77 FALKE"),
        names("ALPEN", "BERGA", "CERVO", "FALKE"),
        {},
    ),
    "a lower and an upper airway": (
        message(start="QAAA0930", route="N0450F310 QAAA Q9 UQ9 LINNA", end="QEEE0455"),
        ("QAAA", "STAR", "LINNA", "QEEE"),
        {},
    ),
    # 68 NM on 283° (279° true; the airway's course is 278.55°) is on UQ9 between STAR and LINNA
    "over the ocean, with a change on an airway": (
        message(
            start="QAAA1400",
            route="N0450F310 QAAA UQ9 STAR283068/M082F310 UQ9 LINNA 52N020W 52N030W 50N040W "
            "49N050W DCT",
            end="QEEE0455",
        ),
        (
            "QAAA",
            "STAR",
            "STAR283068",
            "LINNA",
            "52N020W",
            "52N030W",
            "50N040W",
            "49N050W",
            "QEEE",
        ),
        {},
    ),
    "speeds and levels that change": (
        north("ALPEN/N0410F330 N850 CERVO/K0780S1010 DORNA"),
        NORTH,
        {"levels": [10668.0, 10058.4, 10058.4, 10100.0, 10100.0, 10100.0]},
    ),
    "metric": (
        message(route="K0800S1070 ALPEN N850 DORNA"),
        NORTH,
        {"airspeeds": [800 / 3.6] * 5},
    ),
    "altitudes": (
        message(route="N0120A045 ALPEN BERGA/N0110M0150"),
        names("ALPEN", "BERGA"),
        {"levels": [4500 * FEET, 4500 * FEET, 1500.0, 1500.0]},
    ),
    "by sight": (
        message("OKABC-VG", route="N0095VFR ALPEN BERGA"),
        names("ALPEN", "BERGA"),
        {"airspeeds": [95 * KNOT] * 3, "heights": None},
    ),
    "from instruments to sight": (
        message("OKABC-YG", route="N0150F080 ALPEN N850 CERVO VFR DORNA/N0130VFR"),
        NORTH,
        {"airspeeds": [150 * KNOT] * 4 + [130 * KNOT]},
    ),
    "from sight to instruments": (
        message("OKABC-ZG", route="N0130VFR ALPEN/N0150F080 IFR N850 DORNA"),
        NORTH,
        {"airspeeds": [130 * KNOT] + [150 * KNOT] * 4},
    ),
    "operational air traffic": (
        north("ALPEN OAT BERGA GAT CERVO"),
        names("ALPEN", "BERGA", "CERVO"),
        {},
    ),
    "a stay": (
        north("ALPEN STAY1/0030 BERGA", others="STAYINFO1/CALIBRATION OF QDDD RMK/NIL"),
        names("ALPEN", "BERGA"),
        {"fields": {"STAYINFO1": "CALIBRATION OF QDDD", "RMK": "NIL"}},
    ),
    "a cruise climb": (
        message(route="M082F330 C/ALPEN/M082F290F350 C/BERGA/M080F350PLUS DORNA"),
        names("ALPEN", "BERGA", "DORNA"),
        {"levels": [10058.4, 8839.2, 10668.0, 10668.0, 10668.0]},
    ),
    "degrees and minutes": (
        north("4730N00810E 48N008E"),
        names("4730N00810E", "48N008E"),
        {},
    ),
    "cut short": (north("ALPEN N850 CERVO T"), names("ALPEN", "BERGA", "CERVO"), {}),
    "no indicator of an aerodrome": (
        message(start="ZZZZ0930", others="DEP/4540N00850E DOF/261123"),
        ("4540N00850E", *NORTH[1:]),
        {"departure": "ZZZZ"},
    ),
}


@pytest.mark.parametrize(("text", "waypoints", "others"), FORMS.values(), ids=FORMS)
def test_forms(text, waypoints, others):
    (plan,) = read(text)
    assert plan.names == waypoints
    for name, value in others.items():
        found = getattr(plan, name)
        if isinstance(value, list):
            np.testing.assert_allclose(found, value, rtol=1e-12)
        else:
            assert found == value


@pytest.mark.parametrize(
    ("radial", "longest"),
    # half a degree is .5 NM aside at 68 NM; 279° is 4 NM aside, which still is the airway
    [("STAR283068", 0.01), ("STAR279068", 0.15)],
)
def test_a_place_on_an_airway_is_between_its_fixes(radial, longest):
    text, waypoints, _ = FORMS["over the ocean, with a change on an airway"]
    (plan,) = read(text.replace("STAR283068", radial))
    at = waypoints.index("STAR283068")
    a, b, c = plan.waypoints[at - 1 : at + 2]
    assert np.linalg.norm(b - a) == pytest.approx(68 * MILE, rel=5e-3)
    bend = np.linalg.norm(b - a) + np.linalg.norm(c - b) - np.linalg.norm(c - a)
    assert bend < longest * MILE


@pytest.mark.parametrize(
    ("route", "reason"),
    [
        # 30 NM beside it
        (
            "N0450F310 QAAA UQ9 STAR180030 UQ9 LINNA",
            "'UQ9' does not connect 'QAAA' and 'STAR180030'",
        ),
        ("N0450F310 QAAA UQ9 N850 DORNA", "'UQ9' does not connect 'QAAA' and 'N850'"),
        ("N0450F310 ALPEN Q9 UQ9 LINNA", "'Q9' does not connect 'ALPEN' and 'UQ9'"),
        ("N0450F310 ALPEN N850 EICHE", "'N850' does not connect 'ALPEN' and 'EICHE'"),
        ("N0450F310 N850 DORNA", "'N850' does not connect 'QDDD' and 'DORNA'"),
        ("N0450F310 ALPEN NATA 50N040W", "'NATA' is neither a fix nor an airway nor a place"),
        ("N0450/F310 ALPEN", "'N0450/F310' is not a speed and level"),
        ("N0450F310 ALPEN/F330", "'F330' is not a speed and level"),
        ("N0450F310 ALPEN/N0450F330 /N0450F330 DORNA", "'/N0450F330' is neither"),
        ("N0450F310 ALPEN STAY1 DORNA", "'STAY1' is neither"),
        ("N0450F310 48N181E ALPEN", "'48N181E' is not a place on the earth"),
    ],
)
def test_routes_that_cannot_be_flown_are_refused_in_one_line(route, reason):
    with pytest.raises(ValueError, match=r"message 0 \('TST101'\)") as error:
        read(message(route=route))
    assert reason in str(error.value)
    assert "\n" not in str(error.value)
