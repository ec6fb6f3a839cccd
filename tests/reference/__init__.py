"""The formulas of the papers in plain NumPy, as they are printed (misprints mended)."""
