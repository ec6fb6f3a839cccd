"""What commands have in common: --json, interrupts, full disks."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from places import EXAMPLES
from rich.file_proxy import FileProxy
from terminal import run, succeed
from typer.testing import CliRunner

from tertia import cli
from tertia.cli.files import write as writing

PLOTS = (EXAMPLES / "air_plots.csv", "--sensors", EXAMPLES / "air_radars.toml")


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        (("track", *PLOTS), "sensors"),
        (("bearing", EXAMPLES / "bearings.csv", "--by", "target"), "groups"),
        (("fuse-series", EXAMPLES / "radars.csv"), "sensors"),
        (
            ("locate", EXAMPLES / "measurements.csv", "--sensors", EXAMPLES / "stations.toml"),
            "sensors",
        ),
        (
            ("reconstruct", EXAMPLES / "measurements.csv", "--sensors", EXAMPLES / "stations.toml"),
            "sensors",
        ),
    ],
)
def test_json_is_all_that_is_on_stdout(arguments: tuple[object, ...], key: str) -> None:
    """The rest, as it is without, goes to stderr."""
    plain, done = run(*arguments), run(*arguments, "--json")
    assert done.code == 0
    assert json.loads(done.out)[key]
    numbers = re.compile(r"[\d,]+ plots tracked per second")
    assert numbers.sub("", done.err) == numbers.sub("", plain.out + plain.err)


MEASUREMENTS = (EXAMPLES / "measurements.csv", "--sensors", EXAMPLES / "stations.toml")


@pytest.mark.parametrize(
    ("arguments", "function"),
    [
        (("locate", *MEASUREMENTS), "tertia.tables._locate.locate_instants"),
        (
            ("smooth", EXAMPLES / "air_truth.csv", "--sigma", 20, "--jerk", 1, "--by", "target"),
            "tertia.smoothing.smooth",
        ),
    ],
)
def test_threads_are_those_of_the_option(
    arguments: tuple[object, ...], function: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    module, name = function.rsplit(".", 1)
    original = getattr(sys.modules[module], name)
    used: set[int | None] = set()

    def watched(*given: Any, n_threads: int | None = None, **options: Any) -> Any:
        used.add(n_threads)
        return original(*given, n_threads=n_threads, **options)

    monkeypatch.setattr(function, watched)
    succeed(*arguments, "--n-threads", 1)
    assert used == {1}


@pytest.mark.parametrize(
    ("arguments", "step"),
    [
        (("fuse-series", EXAMPLES / "radars.csv"), "tertia.tables._noise.fit_noise"),
        (("fuse-series", EXAMPLES / "radars.csv"), "tertia.tables._fuse_series.fuse_arrays"),
        (
            ("locate", *MEASUREMENTS, "--tolerance", "inf"),
            "tertia.tables._measurements.combined",
        ),
        (("locate", *MEASUREMENTS), "tertia.tables._locate.locate_instants"),
        (("reconstruct", *MEASUREMENTS), "tertia.tables._reconstruct.reconstruct_path"),
    ],
)
def test_progress_is_shown(
    arguments: tuple[object, ...], step: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While a bar is shown, what is written goes through it."""
    module, name = step.rsplit(".", 1)
    original = getattr(sys.modules[module], name)
    shown: set[bool] = set()

    def watched(*given: Any, **options: Any) -> Any:
        shown.add(isinstance(sys.stderr, FileProxy))
        return original(*given, **options)

    monkeypatch.setattr(step, watched)
    succeed(*arguments)
    assert shown == {False}
    shown.clear()
    # as on a terminal
    monkeypatch.setenv("FORCE_COLOR", "1")
    succeed(*arguments)
    assert shown == {True}


def _interrupt(*_: object, **__: object) -> None:
    raise KeyboardInterrupt


@pytest.mark.parametrize("moment", ["write_csv", "tracking"])
def test_an_interrupt_leaves_nothing(
    moment: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if moment == "tracking":
        monkeypatch.setattr("tertia.tables._track.tracked", _interrupt)
    else:
        monkeypatch.setitem(writing.WRITERS, ".csv", _interrupt)
    done = run("track", *PLOTS, "--output", tmp_path / "tracks.csv")
    assert done.code == 130
    assert done.err == "tertia: interrupted\n"
    assert list(tmp_path.iterdir()) == []


def tertia(*arguments: object, **options: Any) -> "subprocess.CompletedProcess[str]":
    code = "from tertia.cli import main; main()"
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(
        command, check=False, stderr=subprocess.PIPE, text=True, timeout=100, **options
    )


def _limited() -> None:
    import resource  # noqa: PLC0415  # Windows has none

    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, 50_000))


@pytest.mark.skipif(os.name == "nt", reason="Windows has no limit of this kind")
@pytest.mark.parametrize("name", ["tracks.csv", "tracks.parquet"])
def test_a_full_disk_leaves_nothing(name: str, tmp_path: Path) -> None:
    """A file cannot become larger than 50 kB; what was there before remains."""
    output = tmp_path / name
    output.write_text("before", encoding="utf-8")
    done = tertia(
        *("track", *PLOTS, "--output", output), stdout=subprocess.DEVNULL, preexec_fn=_limited
    )
    assert done.returncode == 1
    assert re.fullmatch(r"tertia: cannot write .*\n", done.stderr)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert output.read_text(encoding="utf-8") == "before"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_an_output_that_cannot_be_written() -> None:
    with Path("/dev/full").open("w") as full:
        done = tertia("--version", stdout=full)
    assert done.returncode == 1
    assert done.stderr == "tertia: cannot write the output: No space left on device\n"


def test_completion(monkeypatch: pytest.MonkeyPatch) -> None:
    """A shell completes commands and options."""
    for words, expected in (("tertia rep", ["report"]), ("tertia track --sens", ["--sensors"])):
        monkeypatch.setenv("_TERTIA_COMPLETE", "complete_bash")
        monkeypatch.setenv("COMP_WORDS", words)
        monkeypatch.setenv("COMP_CWORD", str(words.count(" ")))
        result = CliRunner().invoke(cli.app, prog_name="tertia")
        assert result.stdout.split() == expected


def test_an_interrupt_while_modules_are_imported() -> None:
    code = """
import os, signal, sys
from importlib.abc import MetaPathFinder

class Interrupting(MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == "tertia.cli":
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Interrupting())
from tertia.__main__ import main
main()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 130
    assert done.stderr == "tertia: interrupted\n"
