"""The terminal: output, common options, and exit codes of commands."""
