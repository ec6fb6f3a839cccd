"""Categories of ASTERIX: their titles, and the columns of those that are read."""

# categories that give rows of tables: plots of radars (old format), surface movement,
# multilateration, ADS-B, plots of radars, system tracks
OLD_PLOTS = 1
SURFACE, MULTILATERATION, REPORTS, PLOTS, TRACKS = 10, 20, 21, 48, 62
# service messages: of radars (old format), of multilateration, and of radars
SERVICES = (2, 19, 34)
# messages about the state of sensors and systems: service messages, and the messages of a tracker
# about its sensors and about itself
SENSOR_STATUS, TRACKER_STATUS = 63, 65
MESSAGES = (*SERVICES, SENSOR_STATUS, TRACKER_STATUS)
# titles of categories that are not read
TITLES = {
    4: "safety nets",
    7: "directed interrogations",
    8: "weather of a radar",
    9: "weather, composed",
    11: "surface movement, fused",
    15: "non-cooperative targets",
    16: "non-cooperative surveillance, configuration",
    17: "Mode S coordination",
    18: "Mode S data link",
    23: "ADS-B service",
    25: "ground system status",
    32: "flight plans",
    150: "flight plans of Maastricht",
    205: "radio direction finders",
    240: "radar video",
    247: "versions",
}
VELOCITIES = (
    "velocity_east_m_s",
    "velocity_north_m_s",
    "velocity_east_sigma_m_s",
    "velocity_north_sigma_m_s",
)
# modes of movement, and their names in I062/200
MODES = {"transversal": "TRANS", "longitudinal": "LONG", "vertical": "VERT"}
_TEXT, _NUMBER, _FLAG = "String", "Float64", "Boolean"
_COMMON = {"time_s": _NUMBER, "sensor": _TEXT}
_IDENTITY = {"icao_address": _TEXT, "mode_3a": _TEXT, "callsign": _TEXT}
_PLACE = {"latitude_deg": _NUMBER, "longitude_deg": _NUMBER, "height_m": _NUMBER}
_MOTION = {"speed_m_s": _NUMBER, "course_deg": _NUMBER}
# columns of the tables, and their types
COLUMNS = {
    PLOTS: {
        **_COMMON,
        "range_nm": _NUMBER,
        "azimuth_deg": _NUMBER,
        "flight_level": _NUMBER,
        **_IDENTITY,
        "detection": _TEXT,
        "simulated": _FLAG,
        "field_monitor": _FLAG,
        "track_number": "Int64",
        **_MOTION,
    },
    TRACKS: {
        **_COMMON,
        "target": _TEXT,
        **_PLACE,
        "flight_level": _NUMBER,
        "east_m": _NUMBER,
        "north_m": _NUMBER,
        "east_sigma_m": _NUMBER,
        "north_sigma_m": _NUMBER,
        "covariance_east_north_m2": _NUMBER,
        **_MOTION,
        **_IDENTITY,
    },
    REPORTS: {
        **_COMMON,
        "target": _TEXT,
        **_PLACE,
        "flight_level": _NUMBER,
        **_MOTION,
        "icao_address": _TEXT,
        "callsign": _TEXT,
    },
}
COLUMNS |= dict.fromkeys((SURFACE, MULTILATERATION), COLUMNS[TRACKS])
COLUMNS[OLD_PLOTS] = COLUMNS[PLOTS]
COLUMNS[TRACKS] = COLUMNS[TRACKS] | {
    **dict.fromkeys(VELOCITIES, _NUMBER),
    "vertical_rate_m_s": _NUMBER,
    "confirmed": _FLAG,
    "coasted": _FLAG,
    **dict.fromkeys(MODES, "Int64"),
}
# columns of messages; each row has values in some of them
STATUS = {
    "state": _TEXT,
    "failed": _TEXT,
    "overload": _FLAG,
    "time_valid": _FLAG,
    "plots_missing": _FLAG,
    "service_report": "Int64",
    "time_bias_s": _NUMBER,
    "range_gain": _NUMBER,
    "range_bias_m": _NUMBER,
    "azimuth_bias_deg": _NUMBER,
    "psr_range_gain": _NUMBER,
    "psr_range_bias_m": _NUMBER,
    "psr_azimuth_bias_deg": _NUMBER,
    "psr_elevation_bias_deg": _NUMBER,
    "collimation_range_m": _NUMBER,
    "collimation_azimuth_deg": _NUMBER,
}
COLUMNS[SENSOR_STATUS] = {**_COMMON, "source": _TEXT, "service": "Int64", **STATUS}
SENSORS = {"sensor": _TEXT, **_PLACE, "scan_period_s": _NUMBER, "plot_count": "Int64"}
KNOWN = frozenset({*TITLES, *COLUMNS, *MESSAGES})
