"""Rows of tables from columns of ASTERIX."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import polars as pl

from tertia._units import FOOT, NAUTICAL_MILE
from tertia.io._categories import (
    MODES,
    MULTILATERATION,
    OLD_PLOTS,
    PLOTS,
    REPORTS,
    SENSOR_STATUS,
    SURFACE,
    TRACKER_STATUS,
    TRACKS,
    VELOCITIES,
)

# message type of target reports (I010/000)
_TARGET_REPORT = 1
# values of I048/020
_DETECTIONS = (
    "none",
    "psr",
    "ssr",
    "ssr+psr",
    "mode-s-all-call",
    "mode-s-roll-call",
    "mode-s-all-call+psr",
    "mode-s-roll-call+psr",
)
# values of I063/060, I065/040 and I019/550; whether a radar is released for operational use
# (I034/050)
_SENSOR_STATES = ("operational", "degraded", "initialising", "not connected")
_TRACKER_STATES = ("operational", "degraded", "not connected", "unknown")
_SYSTEM_STATES = ("operational", "degraded", "inhibited", "unknown")
_RADAR_STATES = ("operational", "inhibited")
# parts of a sensor in I063/060
_PARTS = {"PSR": "psr", "SSR": "ssr", "MDS": "mode-s", "ADS": "ads-b", "MLT": "multilateration"}
# type of radar plots in I010/020; other types are multilateration, ADS-B and so on
_SURFACE_PSR = 3
# metres per degree of latitude; for an accuracy, three digits are sufficient
_DEGREE = 1852.0 * 60.0
# six-bit characters; other codes are left out
_LETTERS = {
    **{code: chr(64 + code) for code in range(1, 27)},
    32: " ",
    **{code: chr(code) for code in range(48, 58)},
}
Rows = dict[str, pl.Expr]


class Items:
    """Items of the records of a category, as Polars expressions; missing items are null."""

    def __init__(self, fields: Sequence[tuple[str, float, str]]) -> None:
        self.scales = {name: (scale, unit) for name, scale, unit in fields}

    def whole(self, *names: str) -> pl.Expr:
        """Return an item as a whole number without a unit."""
        name = "/".join(names)
        return pl.col(name) if name in self.scales else pl.lit(None, pl.Int64)

    def number(self, item: str, unit: str, *parts: str) -> pl.Expr:
        """Return an item as a number in a unit."""
        names = item, *parts
        scale, stated = self.scales.get("/".join(names), (1.0, unit))
        assert stated == unit
        return self.whole(*names) * pl.lit(scale)

    def text(self, *names: str) -> pl.Expr:
        """Return an item as text."""
        return _text(self.whole(*names), _callsign)

    def sound(self, item: str, part: str) -> pl.Expr:
        """Return a part of an item; null if it is garbled or not validated."""
        wrong = [self.whole(item, flag).fill_null(0) > 0 for flag in "VG"]
        return pl.when(~pl.any_horizontal(wrong)).then(self.whole(item, part))

    def level(self, item: str, part: str = "FL") -> pl.Expr:
        """Return a flight level; null if it is garbled or not validated."""
        return self.sound(item, part) * pl.lit(self.scales[f"{item}/{part}"][0])

    def address(self, *names: str) -> pl.Expr:
        """Return an address in hexadecimal digits."""
        return _text(self.whole(*names), "{:06X}".format)

    def code(self, item: str) -> pl.Expr:
        """Return a mode 3/A code."""
        return _text(self.sound(item, "MODE3A"), "{:04o}".format)

    def sensor(self, item: str = "010") -> pl.Expr:
        """Return the source of the record, or another sensor, by its codes."""
        both = self.whole(item, "SAC") * 256 + self.whole(item, "SIC")
        return _text(both, lambda codes: f"{codes >> 8}/{codes & 255}")

    def flag(self, item: str, *parts: str) -> pl.Expr:
        """Return whether one of several bits is set."""
        return pl.any_horizontal([self.whole(item, part).fill_null(0) > 0 for part in parts])

    def name(self, item: str, part: str, names: Sequence[str]) -> pl.Expr:
        """Return the name of a code."""
        code = self.whole(item, part)
        return code.replace_strict(dict(enumerate(names)), default=None, return_dtype=pl.String)


# items that contain the time of day; if there are several, the time of the position comes first. In
# old plots it is truncated
TIMES = {
    OLD_PLOTS: ("141",),
    2: ("030",),
    SURFACE: ("140",),
    MULTILATERATION: ("140",),
    # 030: up to edition 0.26
    REPORTS: ("071", "073", "077", "030"),
    PLOTS: ("140",),
    TRACKS: ("070",),
    19: ("140",),
    34: ("030",),
    SENSOR_STATUS: ("030",),
    TRACKER_STATUS: ("030",),
}


def is_of_target(category: int, items: Items) -> pl.Expr:
    """Return which records are of a target; the others are service messages."""
    if category != SURFACE:
        return pl.lit(True)
    return items.whole("000").fill_null(_TARGET_REPORT) == _TARGET_REPORT


def surface_plots(items: Items) -> Rows:
    """Return the measurements of a surface radar, for records with a range."""
    kind = items.whole("020", "TYP")
    name = pl.when(kind == _SURFACE_PSR).then(pl.lit("psr")).otherwise(pl.lit("none"))
    return {
        "range_nm": items.number("040", "m", "RHO") / NAUTICAL_MILE,
        "azimuth_deg": items.number("040", "°", "TH"),
        "flight_level": items.level("090"),
        "icao_address": items.address("220"),
        "mode_3a": items.code("060"),
        "callsign": items.text("245", "CHR"),
        "detection": pl.when(kind.is_not_null()).then(name),
        "simulated": items.flag("020", "SIM", "TST"),
        "field_monitor": items.flag("020", "RAB"),
        "track_number": items.whole("161", "TRK"),
        "speed_m_s": items.number("200", "NM/s", "GSP") * NAUTICAL_MILE,
        "course_deg": items.number("200", "°", "TRA"),
    }


def _position(
    items: Items, *, number: str, code: str, heights: tuple[str, ...], accuracy: Rows
) -> Rows:
    """Return positions of a surface movement or multilateration system."""
    speed, course = _polar(items.number("202", "m/s", "VX"), items.number("202", "m/s", "VY"))
    ground = items.number("200", "NM/s", "GSP") * NAUTICAL_MILE
    there = ground.is_not_null()
    height = pl.coalesce([items.number(item, "ft") for item in heights])
    return {
        "target": items.whole("161", number).cast(pl.String),
        "latitude_deg": items.number("041", "°", "LAT"),
        "longitude_deg": items.number("041", "°", "LON"),
        "height_m": height * FOOT,
        "flight_level": items.level("090"),
        "east_m": items.number("042", "m", "X"),
        "north_m": items.number("042", "m", "Y"),
        **accuracy,
        "speed_m_s": pl.when(there).then(ground).otherwise(speed),
        "course_deg": pl.when(there).then(items.number("200", "°", "TRA")).otherwise(course),
        "icao_address": items.address("220"),
        "mode_3a": items.code(code),
        "callsign": items.text("245", "CHR"),
    }


def _surface(items: Items) -> Rows:
    accuracy = {
        "east_sigma_m": items.number("500", "m", "DEVX"),
        "north_sigma_m": items.number("500", "m", "DEVY"),
        "covariance_east_north_m2": _signed_square(items.number("500", "m", "COVXY")),
    }
    return _position(items, number="TRK", code="060", heights=("091",), accuracy=accuracy)


def _multilateration(items: Items) -> Rows:
    east, north = (items.number("500", "m", "SDP", axis) for axis in "XY")
    # the correlation is in two's complement, but is defined as an unsigned number
    raw = items.whole("500", "SDP", "XY")
    share = pl.when(raw < 0x8000).then(raw).otherwise(raw - 0x10000) / 4
    accuracy = {
        "east_sigma_m": east,
        "north_sigma_m": north,
        "covariance_east_north_m2": share * east * north,
    }
    return _position(items, number="TRN", code="070", heights=("105", "110"), accuracy=accuracy)


def _plots(items: Items) -> Rows:
    names = dict(enumerate(_DETECTIONS))
    return {
        "range_nm": items.number("040", "NM", "RHO"),
        "azimuth_deg": items.number("040", "°", "THETA"),
        "flight_level": items.level("090"),
        "icao_address": items.address("220"),
        "mode_3a": items.code("070"),
        "callsign": items.text("240"),
        "detection": items.whole("020", "TYP").replace_strict(names, return_dtype=pl.String),
        "simulated": items.flag("020", "SIM", "TST"),
        "field_monitor": items.flag("020", "RAB"),
        "track_number": items.whole("161", "TRN"),
        "speed_m_s": items.number("200", "NM/s", "GSP") * NAUTICAL_MILE,
        "course_deg": items.number("200", "°", "HDG"),
    }


def _old_plots(items: Items) -> Rows:
    names = dict(enumerate(_DETECTIONS[:4]))
    return {
        "range_nm": items.number("040", "NM", "RHO"),
        "azimuth_deg": items.number("040", "°", "THETA"),
        "flight_level": items.level("090", "HGT"),
        "icao_address": pl.lit(None, pl.String),
        "mode_3a": items.code("070"),
        "callsign": pl.lit(None, pl.String),
        "detection": items.whole("020", "SSRPSR").replace_strict(names, return_dtype=pl.String),
        "simulated": items.flag("020", "SIM", "TST"),
        "field_monitor": items.flag("020", "RAB"),
        "track_number": items.whole("161"),
        "speed_m_s": items.number("200", "NM/s", "GSP") * NAUTICAL_MILE,
        "course_deg": items.number("200", "°", "HDG"),
    }


def _tracks(items: Items) -> Rows:
    velocity = [items.number("185", "m/s", axis) for axis in ("VX", "VY")]
    sigmas = [items.number("500", "m/s", "ATV", axis) for axis in "XY"]
    speed, course = _polar(*velocity)
    return {
        "target": items.whole("040").cast(pl.String),
        "latitude_deg": items.number("105", "°", "LAT"),
        "longitude_deg": items.number("105", "°", "LON"),
        "height_m": items.number("130", "ft") * FOOT,
        "flight_level": items.number("136", "FL"),
        "east_m": items.number("100", "m", "X"),
        "north_m": items.number("100", "m", "Y"),
        **_accuracy(items),
        "speed_m_s": speed,
        "course_deg": course,
        "icao_address": items.address("380", "ADR"),
        "mode_3a": items.code("060"),
        "callsign": pl.coalesce(items.text("380", "ID"), items.text("245", "CHR")),
        **dict(zip(VELOCITIES, [*velocity, *sigmas], strict=True)),
        "vertical_rate_m_s": items.number("220", "ft/min") * FOOT / 60,
        "confirmed": items.whole("080", "CNF") == 0,
        # flags in an omitted octet are 0
        "coasted": pl.when(items.whole("080", "CNF").is_not_null()).then(items.flag("080", "CST")),
        **{name: items.whole("200", part) for name, part in MODES.items()},
    }


def _accuracy(items: Items) -> Rows:
    """Return the estimated accuracy of positions: Cartesian or, if that is missing, in WGS 84."""
    east, north = (items.number("500", "m", "APC", axis) for axis in "XY")
    latitude = items.number("105", "°", "LAT")
    parallel = _DEGREE * latitude.radians().cos()
    return {
        "east_sigma_m": east.fill_null(items.number("500", "°", "APW", "LON") * parallel),
        "north_sigma_m": north.fill_null(
            pl.when(latitude.is_not_null()).then(items.number("500", "°", "APW", "LAT") * _DEGREE)
        ),
        # transmitted as the square root of its absolute value, with its sign
        "covariance_east_north_m2": _signed_square(items.number("500", "m", "COV")),
    }


def _reports(items: Items) -> Rows:
    address = items.address("080")
    # the item with the higher resolution comes first
    place = {
        axis: pl.coalesce([items.number(item, "°", axis) for item in ("131", "130")])
        for axis in ("LAT", "LON")
    }
    return {
        "target": address,
        "latitude_deg": place["LAT"],
        "longitude_deg": place["LON"],
        "height_m": items.number("140", "ft") * FOOT,
        "flight_level": items.number("145", "FL"),
        "speed_m_s": items.number("160", "NM/s", "GS") * NAUTICAL_MILE,
        "course_deg": items.number("160", "°", "TA"),
        "icao_address": address,
        "callsign": items.text("170"),
    }


ROWS: Mapping[int, Callable[[Items], Rows]] = {
    OLD_PLOTS: _old_plots,
    PLOTS: _plots,
    TRACKS: _tracks,
    REPORTS: _reports,
    SURFACE: _surface,
    MULTILATERATION: _multilateration,
}


def services(items: Items) -> Rows:
    """Return what service messages state about a sensor: position, scan period and message type."""
    latitude = pl.coalesce(items.number("120", "°", "LAT"), items.number("600", "°", "LAT"))
    height = pl.when(latitude.is_not_null()).then(items.number("120", "m", "HGT"))
    return {
        "latitude_deg": latitude,
        "longitude_deg": pl.coalesce(
            items.number("120", "°", "LON"), items.number("600", "°", "LON")
        ),
        "height_m": pl.coalesce(height, items.number("610", "m")),
        "scan_period_s": items.number("041", "s"),
        "kind": items.whole("000"),
    }


def status(items: Items) -> Rows:
    """Return what messages state about the state and the errors of a sensor or system."""
    own = items.whole("060", "CON")
    held = (own == 0) & (items.whole("060", "OPS") == 1)
    failed = [
        pl.when(items.whole("060", part) == 1).then(pl.lit(name)) for part, name in _PARTS.items()
    ]
    # each of these items belongs to one category
    overloads = [("050", "COM", "OVLRDP"), ("050", "COM", "OVLXMT"), ("550", "OVL"), ("040", "OVL")]
    overloads += [("060", "ODP"), ("060", "OXT")]
    clocks = [("050", "COM", "TSV"), ("550", "TSV"), ("040", "TSV"), ("060", "TSV")]
    offset = pl.coalesce(items.number("090", "NM", "RNG"), items.number("090", "NM", "RE"))
    return {
        "sensor": pl.coalesce(items.sensor("050"), items.sensor()),
        "source": items.sensor(),
        "service": items.whole("015"),
        "state": pl.coalesce(
            pl.when(held).then(pl.lit("inhibited")),
            items.name("060", "CON", _SENSOR_STATES),
            items.name("040", "NOGO", _TRACKER_STATES),
            items.name("550", "NOGO", _SYSTEM_STATES),
            items.name("050/COM", "NOGO", _RADAR_STATES),
        ),
        "failed": pl.when(own.is_not_null()).then(
            pl.concat_str(failed, separator="+", ignore_nulls=True)
        ),
        "overload": _any_of(items, overloads),
        "time_valid": ~_any_of(items, clocks),
        "plots_missing": items.whole("060", "NPW") == 1,
        "service_report": items.whole("050"),
        "time_bias_s": items.number("070", "ms") / 1000,
        "range_gain": items.number("080", "", "SRG"),
        "range_bias_m": items.number("080", "NM", "SRB") * NAUTICAL_MILE,
        "azimuth_bias_deg": items.number("081", "°"),
        "psr_range_gain": items.number("090", "", "PRG"),
        "psr_range_bias_m": items.number("090", "NM", "PRB") * NAUTICAL_MILE,
        "psr_azimuth_bias_deg": items.number("091", "°"),
        "psr_elevation_bias_deg": items.number("092", "°"),
        "collimation_range_m": offset * NAUTICAL_MILE,
        "collimation_azimuth_deg": pl.coalesce(
            items.number("090", "°", "AZM"), items.number("090", "°", "AE")
        ),
    }


def _any_of(items: Items, parts: Sequence[tuple[str, ...]]) -> pl.Expr:
    """Return whether one of several bits is set; null if a record has none of them."""
    return pl.max_horizontal([items.whole(*part) for part in parts]) > 0


def _signed_square(root: pl.Expr) -> pl.Expr:
    return root * root.abs()


def _polar(east: pl.Expr, north: pl.Expr) -> tuple[pl.Expr, pl.Expr]:
    return (east**2 + north**2).sqrt(), pl.arctan2(east, north).degrees() % 360.0


def _callsign(code: int) -> str | None:
    letters = (_LETTERS.get(code >> at & 63, "") for at in range(42, -1, -6))
    return "".join(letters).strip() or None


def _text(codes: pl.Expr, name: Callable[[int], str | None]) -> pl.Expr:
    """Return texts of whole numbers; the text of each distinct number is made once."""

    def texts(column: pl.Series) -> pl.Series:
        named: pl.Series = column.cast(pl.String)
        if column.null_count() < len(column):
            known = column.unique()
            names = [None if code is None else name(code) for code in known.to_list()]
            named = column.replace_strict(known, names, default=None, return_dtype=pl.String)
        return named

    return codes.map_batches(texts, return_dtype=pl.String)
