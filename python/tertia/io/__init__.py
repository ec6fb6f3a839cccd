"""Files: flight plans, and recordings of radars.

Plans are read from CSV, JSON and GeoJSON (extra `io`: Polars for CSV, pyproj for geodetic
positions) and from ICAO messages. Recordings are read from ASTERIX (extra `asterix`), in which
tracks can also be written. In files, angles are in degrees, in fields whose names end in `_deg`;
all other quantities are in SI units, or in the unit at the end of the name.
"""

from tertia.io._asterix import AsterixRecording, read_asterix, write_asterix
from tertia.io._fpl import FiledPlan, read_fpl
from tertia.io._plans import read_plans

__all__ = [
    "AsterixRecording",
    "FiledPlan",
    "read_asterix",
    "read_fpl",
    "read_plans",
    "write_asterix",
]
