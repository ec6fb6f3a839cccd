"""Recordings of KrakenSDR: what its signal processor writes, in either convention."""

import numpy as np
import polars as pl
import pytest
import terminal
from pyproj import Geod

EMITTER = (14.05, 50.05)
PLACES = {"north": (14.0, 50.1, 30.0), "east": (14.1, 50.0, 200.0), "south": (14.0, 50.0, 350.0)}
SENSORS = "".join(f'[[station]]\nname = "{name}"\nazimuth_sigma_deg = 3.0\n' for name in PLACES)


def lines(name: str, *, compass: bool, spectra: bool = True, seed: int = 1, count: int = 40) -> str:
    """Return a recording as the signal processor writes it: the spectra along the unit circle."""
    longitude, latitude, heading = PLACES[name]
    true, _, _ = Geod(ellps="WGS84").inv(longitude, latitude, *EMITTER)
    rng = np.random.default_rng([seed, *name.encode()])
    written = []
    for at in range(count):
        wrong = rng.random() < 0.2
        azimuth = rng.uniform(0, 360) if wrong else true + rng.normal(0, 3)
        clockwise = round(azimuth - heading) % 360
        circle = -clockwise % 360
        angle = clockwise if compass else circle
        parts = [
            1_700_000_000_000 + 1000 * at + int(rng.integers(500)), angle, 12.5, -30.0, 446_000_000,
            "UCA", 437, name, latitude, longitude, heading, heading, "GPS", "R", "R", "R", "R",
        ]  # fmt: skip
        if spectra:
            lobe = np.cos(np.radians(np.arange(360) - circle)) * 10 + 10
            parts += [f"{one:.2f}" for one in lobe]
        written.append(", ".join(map(str, parts)) + " \n")
    return "".join(written)


@pytest.mark.parametrize("compass", [False, True])
def test_angles_are_read_in_either_convention(tmp_path, compass: bool) -> None:
    files = []
    for name in PLACES:
        files.append(tmp_path / f"{name}.csv")
        files[-1].write_text(lines(name, compass=compass))
    (tmp_path / "finders.toml").write_text(SENSORS)
    result = terminal.run(
        *("locate", *files, "--format", "krakensdr", "--tolerance", "inf"),
        *("--sensors", tmp_path / "finders.toml", "--output", tmp_path / "found.csv"),
    )
    assert result.code == 0, result.err
    said = "clockwise from the heading" if compass else "anticlockwise (unit circle)"
    assert result.err.count(f"according to the spectra, its angles are {said}") == 3
    row = pl.read_csv(tmp_path / "found.csv").row(0, named=True)
    _, _, distance = Geod(ellps="WGS84").inv(row["longitude_deg"], row["latitude_deg"], *EMITTER)
    assert distance < 3 * np.hypot(row["east_sigma_m"], row["north_sigma_m"]) < 1000


def run(tmp_path, text: str) -> terminal.Run:
    (tmp_path / "a.csv").write_text(text)
    (tmp_path / "finders.toml").write_text(SENSORS)
    return terminal.run(
        *("locate", tmp_path / "a.csv", "--format", "krakensdr"),
        *("--sensors", tmp_path / "finders.toml"),
    )


def test_without_spectra_the_convention_is_assumed(tmp_path) -> None:
    result = run(tmp_path, lines("east", compass=True, spectra=False))
    assert "has no spectra; its angles are assumed to be clockwise from the heading" in result.err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time_s,azimuth_deg\n1,2\n", "is not a recording of KrakenSDR: it has 2 columns"),
        (lines("east", compass=True).replace(", 12.5", "0, 12.5"), "it is unclear whether"),
        (lines("east", compass=True).replace("200.0", "abc"), "a cell is not a number"),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path, text: str, message: str) -> None:
    result = run(tmp_path, text)
    assert result.code == 1
    *notes, error = result.err.splitlines()
    assert message in error
    assert all("by the spectra" in note for note in notes)
