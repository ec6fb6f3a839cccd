"""Make estimates.csv: a radar and a pair of direction finders measure where a buoy is."""

from pathlib import Path

import numpy as np
import polars as pl

PLACE = np.array([1200.0, -350.0])
# metres
RADAR = np.array([[400.0, 150.0], [150.0, 900.0]])
FINDERS = np.array([[2500.0, -900.0], [-900.0, 600.0]])


def main() -> None:
    """Write the file beside this one."""
    rng = np.random.default_rng(9)
    frames = [
        pl.DataFrame(
            rng.multivariate_normal(PLACE, covariance, 24).round(1), ["east_m", "north_m"]
        ).select(pl.lit(name).alias("sensor"), "east_m", "north_m")
        for name, covariance in (("radar", RADAR), ("finders", FINDERS))
    ]
    pl.concat(frames).write_csv(Path(__file__).parent / "estimates.csv")


if __name__ == "__main__":
    main()
