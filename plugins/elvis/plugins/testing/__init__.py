"""For authors of converters: is what arrives what the converter says?

from elvis.plugins.testing import check
conversion = check(MySolver, ["case.dat"])          raises AssertionError with one line where it isn't
"""

from elvis.plugins.testing.analytic import Analytic, AnalyticField
from elvis.plugins.testing.kit import check
from elvis.plugins.testing.probing import Probe, native_places, positions_at, values_at, values_found
from elvis.plugins.testing.runtime import check_volume

__all__ = [
    "Analytic",
    "AnalyticField",
    "Probe",
    "check",
    "check_volume",
    "native_places",
    "positions_at",
    "values_at",
    "values_found",
]
