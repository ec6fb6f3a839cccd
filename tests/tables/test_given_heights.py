"""Tables of measurements with heights of the target, and the command that reads them."""

import numpy as np
import polars as pl
import pytest
import terminal

from tertia import tables
from tertia.geo import LocalFrame
from tertia.sensors import Station
from tertia.tables import RecordError
from tertia.trajectory import reconstruct

N = 40
TIME = 2.0 * np.arange(N)
PLACES = {"A": (0.0, 40e3, 0.0), "B": (45e3, -20e3, 50.0), "C": (-40e3, -25e3, 100.0)}
PATH = np.column_stack([-9000 + 170 * TIME, 4000 + 60 * TIME, 5000 + 5 * TIME])
SIGMA, HEIGHT = 30.0, 20.0


def table(path=PATH, places=PLACES, height=PATH[:, 2]):
    """Return ranges with noise, and the heights of every fourth instant."""
    rng = np.random.default_rng(1)
    rows = [
        pl.DataFrame(
            {
                "time_s": TIME,
                "sensor": name,
                "range_m": np.linalg.norm(path - place, axis=1) + SIGMA * rng.standard_normal(N),
            }
        )
        for name, place in places.items()
    ]
    known = np.arange(N) % 4 == 0
    heights = pl.DataFrame({"time_s": TIME, "target_height_m": pl.Series(height + 10.0)})
    heights = heights.with_columns(pl.when(pl.Series(known)).then("target_height_m"))
    return pl.concat(rows).join(heights, on="time_s", maintain_order="left")


def stations():
    return [Station(place, name=name, range_sigma=SIGMA) for name, place in PLACES.items()]


def expected(**options):
    seen = table().pivot("sensor", index="time_s", values="range_m").select(*PLACES).to_numpy()
    height = table()["target_height_m"].to_numpy()[:N]
    return reconstruct(stations(), TIME, range=seen, height=height, **options)


def test_the_path_is_that_of_the_library():
    found = tables.reconstruct(table(), sensors=stations(), height_sigma=HEIGHT)
    path = expected(height_sigma=HEIGHT)
    np.testing.assert_array_equal(found["up_m"].to_numpy(), path.position[:, 2])
    np.testing.assert_array_equal(found["east_sigma_m"].to_numpy(), path.sigma[:, 0])
    terminal.assert_column(found["height_residual"], path.height_residual)
    assert found["height_outlier"].null_count() == N - N // 4
    # the sigmas of rows take precedence
    sigmas = table().with_columns(target_height_sigma_m=pl.lit(3.0))
    found = tables.reconstruct(sigmas, sensors=stations(), height_sigma=HEIGHT)
    path = expected(height_sigma=3.0)
    np.testing.assert_array_equal(found["up_sigma_m"].to_numpy(), path.sigma[:, 2])
    renamed = table().rename({"target_height_m": "alt"})
    found = tables.reconstruct(
        renamed, sensors=stations(), height_sigma=HEIGHT, columns={"target_height_m": "alt"}
    )
    assert found["height_residual"].count() == N // 4


def test_heights_on_the_earth_are_above_the_ellipsoid():
    frame = LocalFrame(50.0, 14.0, 200.0)
    sites = {"A": (50.3, 14.1, 300.0), "B": (49.8, 14.6, 250.0), "C": (49.85, 13.4, 500.0)}
    latitude, longitude = 50.05 + 0.0012 * np.arange(N), 13.8 + 0.01 * np.arange(N)
    height = 6000 + 5.0 * np.arange(N)
    places = {name: frame.to_local(*site) for name, site in sites.items()}
    rows = table(frame.to_local(latitude, longitude, height), places, height)
    names = ("latitude_deg", "longitude_deg", "height_m")
    sensors = pl.DataFrame(
        [
            {"name": name, **dict(zip(names, site, strict=True)), "range_sigma_m": SIGMA}
            for name, site in sites.items()
        ]
    )
    found = tables.reconstruct(rows, sensors=sensors, height_sigma=HEIGHT)
    # 100 m above the ellipsoid is 50 m below the plane of the origin at the end
    assert np.max(np.abs(found["height_m"].to_numpy() - height)) < 30
    assert np.max(np.abs(found["latitude_deg"].to_numpy() - latitude)) < 0.0005
    assert np.max(np.abs(found["height_m"].to_numpy() - found["up_m"].to_numpy())) > 50
    assert not found["height_outlier"].any()
    level = tables.reconstruct(
        rows.drop("target_height_m"), sensors=sensors, height=6100.0, height_sigma=200.0
    )
    assert np.max(np.abs(level["height_m"].to_numpy() - height)) < 150


def test_targets_without_heights_have_empty_cells():
    both = pl.concat(
        [
            table().with_columns(target=pl.lit(1)),
            table().with_columns(target=pl.lit(2), target_height_m=pl.lit(None, pl.Float64)),
        ]
    )
    with pytest.warns(UserWarning, match="mirror image"):
        found = tables.reconstruct(both, sensors=stations(), by="target", height_sigma=HEIGHT)
    counts = found.group_by("target", maintain_order=True).agg(pl.col("height_residual").count())
    assert counts.rows() == [(1, N // 4), (2, 0)]


@pytest.mark.parametrize(
    ("options", "drops", "error", "match"),
    [
        ({}, False, RecordError, "target_height_sigma_m is missing; give it, or height_sigma"),
        (
            {"height": 1.0, "height_sigma": 1.0},
            False,
            RecordError,
            "height is given, and target_height_m as well",
        ),
        ({"height_sigma": 1.0}, True, ValueError, "height is missing"),
        ({"height": 1.0}, True, RecordError, "height_sigma is missing"),
    ],
)
def test_wrong_heights_are_an_error(options, drops, error, match):
    rows = table().drop("target_height_m") if drops else table()
    with pytest.raises(error, match=match):
        tables.reconstruct(rows, sensors=stations(), **options)


def test_the_command_reads_heights(tmp_path):
    rows, sites = tmp_path / "rows.csv", tmp_path / "stations.csv"
    table().write_csv(rows)
    lines = [f"{name},{','.join(map(str, place))},{SIGMA}" for name, place in PLACES.items()]
    sites.write_text("\n".join(["name,east_m,north_m,up_m,range_sigma_m", *lines]), "utf-8")
    given = "reconstruct", rows, "--sensors", sites, "--height-sigma", HEIGHT
    found = terminal.result(*given, folder=tmp_path)
    path = expected(height_sigma=HEIGHT)
    terminal.assert_column(found["up_m"], path.position[:, 2])
    said = terminal.succeed(*given).out
    assert f"bias of the heights {path.height_bias:.3g} ± {path.height_bias_sigma:.3g} m" in said
    table().drop("target_height_m").write_csv(rows)
    level = terminal.result(*given, "--height", 5200.0, folder=tmp_path)
    assert level["height_residual"].count() == N
