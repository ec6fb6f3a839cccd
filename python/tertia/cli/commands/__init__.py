"""The commands: each parses its options, calls `tertia.tables` once, prints and writes."""
