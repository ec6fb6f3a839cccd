"""Units of aviation that are not SI units."""

from __future__ import annotations

from typing import Final

FOOT: Final = 0.3048
"""In metres, exact by the definition of 1959."""

FLIGHT_LEVEL: Final = 100 * FOOT
"""In metres: one flight level is a hundred feet of pressure altitude."""

NAUTICAL_MILE: Final = 1852.0
"""In metres, exact by the definition of 1929."""

KNOT: Final = NAUTICAL_MILE / 3600.0
"""In metres per second."""
