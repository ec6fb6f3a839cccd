"""The command `tertia`, which can also be run as `python -m tertia`."""

import sys


def main() -> None:
    """Run the command; if interrupted, even during imports, it ends with a one-line message."""
    try:
        from tertia import cli  # noqa: PLC0415  # what takes long must be inside

        cli.main()
    except KeyboardInterrupt:
        print("tertia: interrupted", file=sys.stderr)
        # as shells do: 128 and the number of the signal
        sys.exit(130)


if __name__ == "__main__":
    main()
