"""The terminal: what is printed, options that several commands have, how commands end."""
