"""Interoperability: components for other libraries.

`tertia.interop.sklearn` has estimators for scikit-learn, `tertia.interop.stonesoup` components for
Stone Soup, `tertia.interop.traffic` smooths flights from traffic. Each needs an extra of its name.
Tables are in `tertia.tables`.
"""

__all__: list[str] = []
