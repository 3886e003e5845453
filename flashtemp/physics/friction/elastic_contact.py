"""Contact of an elastic half-space with a rough road, solved by ContactMechanics (extra `topography`)."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from flashtemp.errors import BadInput
from flashtemp.physics.arrays import Value


@contextmanager
def suppress_library_warnings() -> Iterator[None]:
    """Suppress the libraries' warnings about deprecated functions that they still use, and optional dependencies."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def load_topography_library() -> Value:
    """Import SurfaceTopography with its generators.  Raises BadInput where it is not installed."""
    try:
        with suppress_library_warnings():
            import SurfaceTopography.Generation
    except ImportError as fault:
        raise BadInput("SurfaceTopography is not installed; pip install 'flashtemp[topography]'") from fault
    return SurfaceTopography


def solve_contact_area(heights: np.ndarray, size: tuple[float, float], modulus: float, pressure: float) -> np.ndarray:
    """Points in contact (nx, ny) between periodic heights (m) over `size` (m) and an elastic half-space.

    `modulus` E/(1 - nu^2) and nominal `pressure` in Pa; hard wall, no adhesion.  Raises BadInput where the solver finds
    no contact.
    """
    surface = load_topography_library()
    try:
        with suppress_library_warnings():
            import ContactMechanics.Systems as systems
    except ImportError as fault:
        raise BadInput("ContactMechanics is not installed; pip install 'flashtemp[topography]'") from fault
    import ContactMechanics

    with suppress_library_warnings():
        road = surface.Topography(heights, size, periodic=True)
        rubber = ContactMechanics.PeriodicFFTElasticHalfSpace(heights.shape, modulus, size)
        system = systems.NonSmoothContactSystem(rubber, road)
        if not system.minimize_proxy(external_force=pressure * size[0] * size[1]).success:
            raise BadInput(f"no contact was found under {pressure:g} Pa; give another pressure or modulus")
    return np.asarray(system.force) > 0
