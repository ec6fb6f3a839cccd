"""Command line: recordings in files. Needs the extra `cli`.

The numbers come from the library; here they are read, laid out and written.
"""

import sys
from typing import Annotated

import tertia

try:
    import typer

    from tertia.cli import (
        _bearing,
        _evaluate,
        _fuse,
        _locate,
        _report,
        _simulate,
        _track,
        _trajectory,
        _weights,
    )
    from tertia.cli._command import command, written_out
except ModuleNotFoundError:
    # here and not in `main`, because the commands are declared with these libraries
    sys.exit("the command tertia needs the extra cli: pip install 'tertia[cli]'")

__all__ = ["main"]

_COMMANDS = (_bearing, _fuse, _locate, _trajectory, _weights, _track, _evaluate, _report, _simulate)

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


@app.callback(epilog=_epilog(*(command.EXAMPLES[0] for command in _COMMANDS)))
def _tertia(
    version: Annotated[
        bool,
        typer.Option("--version", help="Print the version.", callback=_show_version, is_eager=True),
    ] = False,
) -> None:
    """One estimate with an error bar from measurements that are sometimes wrong."""


app.command(epilog=_epilog(*_bearing.EXAMPLES))(command(_bearing.bearing))
app.command(epilog=_epilog(*_fuse.EXAMPLES))(command(_fuse.fuse))
app.command(epilog=_epilog(*_locate.EXAMPLES))(command(_locate.locate))
app.command(epilog=_epilog(*_trajectory.EXAMPLES))(command(_trajectory.trajectory))
app.command("weights", epilog=_epilog(*_weights.EXAMPLES))(command(_weights.weigh))
app.command(epilog=_epilog(*_track.EXAMPLES))(command(_track.track))
app.command(epilog=_epilog(*_evaluate.EXAMPLES))(command(_evaluate.evaluate))
app.command(epilog=_epilog(*_report.EXAMPLES))(command(_report.report))
app.command(epilog=_epilog(*_simulate.EXAMPLES))(command(_simulate.simulate))
