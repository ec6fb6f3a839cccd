"""Command line: the functions of the library for recordings in files. Needs the extra `cli`.

A command parses its options, calls `tertia.tables` once, and prints and writes the results.
`commands` contains the commands, `files` the readers and writers, and `terminal` the output and the
exit codes.
"""

import sys
from collections.abc import Callable
from typing import Annotated, Any

import tertia

try:
    import typer

    from tertia.cli.commands import (
        audit,
        bearing,
        evaluate,
        fuse_series,
        fuse_tracks,
        locate,
        reconstruct,
        register,
        report,
        simulate,
        smooth,
        smooth_tracks,
        track,
        weights,
    )
    from tertia.cli.terminal.command import command, written_out
except ModuleNotFoundError:
    # checked here and not in `main`, because the commands are declared with these libraries
    sys.exit("the command tertia needs the extra cli: pip install 'tertia[cli]'")

__all__ = ["main"]

_COMMANDS: dict[Callable[..., Any], tuple[str, ...]] = {
    bearing.bearing: bearing.EXAMPLES,
    fuse_series.fuse_series: fuse_series.EXAMPLES,
    locate.locate: locate.EXAMPLES,
    reconstruct.reconstruct: reconstruct.EXAMPLES,
    smooth.smooth: smooth.EXAMPLES,
    weights.weights: weights.EXAMPLES,
    track.track: track.EXAMPLES,
    smooth_tracks.smooth_tracks: smooth_tracks.EXAMPLES,
    register.register: register.EXAMPLES,
    fuse_tracks.fuse_tracks: fuse_tracks.EXAMPLES,
    evaluate.evaluate: evaluate.EXAMPLES,
    audit.audit: audit.EXAMPLES,
    report.report: report.EXAMPLES,
    simulate.simulate: simulate.EXAMPLES,
}

app = typer.Typer(
    name="tertia",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)


def main() -> None:
    """Run the command `tertia`."""
    with written_out():
        app(prog_name="tertia")


def _epilog(*examples: str) -> str:
    # typer takes a blank line for a line break
    return "\n\n".join(["Examples:", *examples])


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"tertia {tertia.__version__}")
        raise typer.Exit


@app.callback(epilog=_epilog(*(examples[0] for examples in _COMMANDS.values())))
def _tertia(
    version: Annotated[
        bool,
        typer.Option("--version", help="Print the version.", callback=_show_version, is_eager=True),
    ] = False,
) -> None:
    """Estimates with error bars from redundant measurements, some of which are wrong."""


for _function, _examples in _COMMANDS.items():
    app.command(epilog=_epilog(*_examples))(command(_function))
