"""Interoperability: components for other libraries.

`tertia.interop.sklearn` has estimators for scikit-learn, `tertia.interop.stonesoup` has components
for Stone Soup, and `tertia.interop.traffic` smooths flights of the library traffic. Each module
needs the extra of the same name. Tables are in `tertia.tables`.
"""

__all__: list[str] = []
