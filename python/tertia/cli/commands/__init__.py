"""The commands; each parses options, calls `tertia.tables` once, and outputs the results."""
