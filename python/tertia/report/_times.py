"""Times on a page, in seconds or as times of day."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta, timezone

_DAY = 86_400.0


@dataclass(frozen=True, slots=True)
class Times:
    """Conversion of times to text; the time 0 is the date and time `since`, if that is known."""

    since: datetime | None

    @property
    def title(self) -> str:
        """Title of a time axis."""
        if self.since is None:
            return "time (s)"
        return "time (as recorded)" if self.since.tzinfo is None else "time (UTC)"

    @property
    def zero(self) -> float | None:
        """Milliseconds from 1970 to the time 0; browsers take it as a date without a time zone."""
        if self.since is None:
            return None
        zoned = self.since if self.since.tzinfo else self.since.replace(tzinfo=timezone.utc)
        return 1e3 * zoned.timestamp()

    def column(self, name: str) -> str:
        """Return the title of a column of times."""
        return f"{name} (s)" if self.since is None else name

    def text(self, seconds: float | None) -> str | None:
        """Return a time of day (with its date after the first day) or seconds, as text."""
        if seconds is None or self.since is None:
            return None if seconds is None else f"{seconds:,.0f}"
        when = self.since + timedelta(seconds=seconds)
        if when.tzinfo:
            when = when.astimezone(timezone.utc)
        return f"{when:%H:%M:%S}" if 0 <= seconds < _DAY else f"{when:%Y-%m-%d %H:%M:%S}"

    def at(self, seconds: float) -> str:
        """Return a time as text that can be part of a sentence."""
        return f"{self.text(seconds)} s" if self.since is None else str(self.text(seconds))
