"""Files: flight plans, and recordings of radars.

Plans are read from CSV, JSON and GeoJSON (extra `io`: Polars for CSV, pyproj for geodetic
positions), recordings from ASTERIX (extra `asterix`). Angles in files are degrees, in fields whose
names end in `_deg`; everything else is in SI units, or in the unit that its name ends in.
"""

from tertia.io._asterix import AsterixRecording, read_asterix
from tertia.io._plans import read_plans

__all__ = ["AsterixRecording", "read_asterix", "read_plans"]
