"""The simulations behind the pages; `python docs/figures.py` runs them all."""
