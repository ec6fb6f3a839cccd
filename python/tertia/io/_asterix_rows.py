"""Rows of tables from records of ASTERIX."""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, radians
from typing import Any

import numpy as np

from tertia._units import FOOT, NAUTICAL_MILE

# categories with rows: surface movement, multilateration, ADS-B, plots of radars, system tracks
SURFACE, MULTILATERATION, REPORTS, PLOTS, TRACKS = 10, 20, 21, 48, 62
# service messages: of multilateration and of radars
SERVICES = (19, 34)
# message types of I010/000: a report of a target
_TARGET_REPORT = 1
# of I048/020
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
# of I010/020: multilateration, ADS-B and others are no plots of a radar
_SURFACE_DETECTIONS = {3: "psr"}
# metres of a degree of latitude, of which an accuracy needs three digits
_DEGREE = 1852.0 * 60.0


class Items:
    """A record, and access to its items; missing items are None."""

    def __init__(self, record: Any) -> None:
        self.record = record

    def _content(self, names: tuple[str, ...]) -> Any:
        # an edition may lack an item, or have another content there
        item = self.record
        for at, name in enumerate(names):
            part = item if at == 0 else item.variation
            try:
                item = part.get_item(name)
            except (AttributeError, KeyError):
                return None
            if item is None:
                return None
        return getattr(item.variation, "content", None)

    def whole(self, *names: str) -> int | None:
        """Return an item as a number without a unit."""
        content = self._content(names)
        return None if content is None else int(content.as_uint())

    def number(self, item: str, unit: str, *parts: str) -> float | None:
        """Return an item in a unit."""
        content = self._content((item, *parts))
        return None if content is None else float(content.as_quantity(unit))

    def text(self, *names: str) -> str | None:
        """Return an item as text."""
        content = self._content(names)
        return None if content is None else str(content.as_string()).strip() or None

    def sound(self, item: str, part: str) -> Any:
        """Return a part of an item, None if it is garbled or not validated."""
        return (
            None if self.whole(item, "V") or self.whole(item, "G") else self._content((item, part))
        )

    def level(self, item: str) -> float | None:
        """Return a flight level, None if it is garbled or not validated."""
        content = self.sound(item, "FL")
        return None if content is None else float(content.as_quantity("FL"))

    def address(self, *names: str) -> str | None:
        """Return an address in hexadecimal digits."""
        number = self.whole(*names)
        return None if number is None else f"{number:06X}"

    def code(self, item: str) -> str | None:
        """Return a mode 3/A code."""
        content = self.sound(item, "MODE3A")
        return None if content is None else str(content.as_string())


# where the time of day is; that of the position comes first
TIMES = {
    SURFACE: ("140",),
    MULTILATERATION: ("140",),
    # 030 until edition 0.26
    REPORTS: ("071", "073", "077", "030"),
    PLOTS: ("140",),
    TRACKS: ("070",),
    19: ("140",),
    34: ("030",),
}


def is_of_target(category: int, items: Items) -> bool:
    """Return whether a record is of a target, and no service message."""
    return category != SURFACE or items.whole("000") in {None, _TARGET_REPORT}


def surface_plot(items: Items) -> dict[str, Any] | None:
    """Return what a surface radar measured, if that is transmitted."""
    distance = items.number("040", "m", "RHO")
    if distance is None:
        return None
    kind = items.whole("020", "TYP")
    return {
        "range_nm": distance / NAUTICAL_MILE,
        "azimuth_deg": items.number("040", "°", "TH"),
        "flight_level": items.level("090"),
        "icao_address": items.address("220"),
        "mode_3a": items.code("060"),
        "callsign": items.text("245", "CHR"),
        "detection": None if kind is None else _SURFACE_DETECTIONS.get(kind, "none"),
        "simulated": bool(items.whole("020", "SIM") or items.whole("020", "TST")),
        "field_monitor": bool(items.whole("020", "RAB")),
        "track_number": items.whole("161", "TRK"),
        "speed_m_s": _times(items.number("200", "NM/s", "GSP"), NAUTICAL_MILE),
        "course_deg": items.number("200", "°", "TRA"),
    }


def _position(
    items: Items,
    *,
    number: str,
    code: str,
    heights: tuple[str, ...],
    accuracy: Mapping[str, float | None],
) -> dict[str, Any]:
    """Return a position of a surface movement or multilateration system."""
    track = items.whole("161", number)
    speed, course = _polar(items.number("202", "m/s", "VX"), items.number("202", "m/s", "VY"))
    ground = items.number("200", "NM/s", "GSP")
    if ground is not None:
        speed, course = ground * NAUTICAL_MILE, items.number("200", "°", "TRA")
    height = (items.number(item, "ft") for item in heights)
    return {
        "target": None if track is None else str(track),
        "latitude_deg": items.number("041", "°", "LAT"),
        "longitude_deg": items.number("041", "°", "LON"),
        "height_m": _times(next((one for one in height if one is not None), None), FOOT),
        "flight_level": items.level("090"),
        "east_m": items.number("042", "m", "X"),
        "north_m": items.number("042", "m", "Y"),
        **accuracy,
        "speed_m_s": speed,
        "course_deg": course,
        "icao_address": items.address("220"),
        "mode_3a": items.code(code),
        "callsign": items.text("245", "CHR"),
    }


def _surface(items: Items) -> dict[str, Any]:
    root = items.number("500", "m", "COVXY")
    accuracy = {
        "east_sigma_m": items.number("500", "m", "DEVX"),
        "north_sigma_m": items.number("500", "m", "DEVY"),
        "covariance_east_north_m2": None if root is None else root * abs(root),
    }
    return _position(items, number="TRK", code="060", heights=("091",), accuracy=accuracy)


def _multilateration(items: Items) -> dict[str, Any]:
    east, north = (items.number("500", "m", "SDP", axis) for axis in "XY")
    raw = items.whole("500", "SDP", "XY")
    # quarters, in two's complement, which the library takes for positive
    share = None if raw is None else (raw - (raw >> 15 << 16)) / 4
    both = None not in (east, north, share)
    accuracy = {
        "east_sigma_m": east,
        "north_sigma_m": north,
        "covariance_east_north_m2": share * east * north if both else None,  # type: ignore[operator]
    }
    return _position(items, number="TRN", code="070", heights=("105", "110"), accuracy=accuracy)


def _plot(items: Items) -> dict[str, Any]:
    kind = items.whole("020", "TYP")
    speed = items.number("200", "NM/s", "GSP")
    return {
        "range_nm": items.number("040", "NM", "RHO"),
        "azimuth_deg": items.number("040", "°", "THETA"),
        "flight_level": items.level("090"),
        "icao_address": items.address("220"),
        "mode_3a": items.code("070"),
        "callsign": items.text("240"),
        "detection": None if kind is None else _DETECTIONS[kind],
        "simulated": bool(items.whole("020", "SIM") or items.whole("020", "TST")),
        "field_monitor": bool(items.whole("020", "RAB")),
        "track_number": items.whole("161", "TRN"),
        "speed_m_s": _times(speed, NAUTICAL_MILE),
        "course_deg": items.number("200", "°", "HDG"),
    }


def _track(items: Items) -> dict[str, Any]:
    number = items.whole("040")
    velocity = items.number("185", "m/s", "VX"), items.number("185", "m/s", "VY")
    speed, course = _polar(*velocity)
    return {
        "target": None if number is None else str(number),
        "latitude_deg": items.number("105", "°", "LAT"),
        "longitude_deg": items.number("105", "°", "LON"),
        "height_m": _times(items.number("130", "ft"), FOOT),
        "flight_level": items.number("136", "FL"),
        "east_m": items.number("100", "m", "X"),
        "north_m": items.number("100", "m", "Y"),
        **_accuracy(items),
        "speed_m_s": speed,
        "course_deg": course,
        "icao_address": items.address("380", "ADR"),
        "mode_3a": items.code("060"),
        "callsign": items.text("380", "ID") or items.text("245", "CHR"),
    }


def _accuracy(items: Items) -> dict[str, float | None]:
    """Return the estimated accuracy of a position: Cartesian or, without that, of WGS 84."""
    east, north = items.number("500", "m", "APC", "X"), items.number("500", "m", "APC", "Y")
    root = items.number("500", "m", "COV")
    latitude = items.number("105", "°", "LAT")
    if east is None and latitude is not None:
        east = _times(items.number("500", "°", "APW", "LON"), _DEGREE * cos(radians(latitude)))
        north = _times(items.number("500", "°", "APW", "LAT"), _DEGREE)
    return {
        "east_sigma_m": east,
        "north_sigma_m": north,
        # transmitted as the root of its size, with its sign
        "covariance_east_north_m2": None if root is None else root * abs(root),
    }


def _report(items: Items) -> dict[str, Any]:
    address = items.address("080")
    # the finer one first
    place = next((item for item in ("131", "130") if items.whole(item, "LAT") is not None), "130")
    return {
        "target": address,
        "latitude_deg": items.number(place, "°", "LAT"),
        "longitude_deg": items.number(place, "°", "LON"),
        "height_m": _times(items.number("140", "ft"), FOOT),
        "flight_level": items.number("145", "FL"),
        "speed_m_s": _times(items.number("160", "NM/s", "GS"), NAUTICAL_MILE),
        "course_deg": items.number("160", "°", "TA"),
        "icao_address": address,
        "callsign": items.text("170"),
    }


ROWS = {
    PLOTS: _plot,
    TRACKS: _track,
    REPORTS: _report,
    SURFACE: _surface,
    MULTILATERATION: _multilateration,
}


def _times(value: float | None, unit: float) -> float | None:
    return None if value is None else value * unit


def _polar(east: float | None, north: float | None) -> tuple[float | None, float | None]:
    if east is None or north is None:
        return None, None
    return float(np.hypot(east, north)), float(np.degrees(np.arctan2(east, north)) % 360.0)
