"""Units of aviation that are not SI units."""

from __future__ import annotations

from typing import Final

FOOT: Final = 0.3048
"""m, exactly (1959)."""

FLIGHT_LEVEL: Final = 100 * FOOT
"""m: one flight level is a hundred feet of pressure altitude."""

NAUTICAL_MILE: Final = 1852.0
"""m, exactly (1929)."""

KNOT: Final = NAUTICAL_MILE / 3600.0
"""m/s."""
