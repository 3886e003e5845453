"""Quantities that effects may speak about, and the one constant between degC and K."""

from __future__ import annotations

KELVIN = 273.15  # 0 degC in K
