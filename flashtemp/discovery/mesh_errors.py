"""Meshes that are too coarse for what they are asked, told with the key that would mend it."""

from __future__ import annotations

import numpy as np

from flashtemp.discovery import adequacy
from flashtemp.discovery.fit import Fit
from flashtemp.discovery.floor import LARGEST
from flashtemp.discovery.nuisances import GROUPS
from flashtemp.discovery.parameters import Kind
from flashtemp.discovery.searched import COARSE, Search
from flashtemp.discovery.whitening import Data


def across(data: Data, fit: Fit) -> list[str]:
    """That walls which 3D resolves differ from those of half the cells across by more than a model may err."""
    case, worst = data.problem.case, (0.0, 0.0, "")
    for prediction in fit.predictions:
        for file, seen in prediction.observables.items():
            columns = {p.index: k for k, p in enumerate(data.fixed[file].names) if p.kind is Kind.MESH}
            if seen.values.ndim != 3 or (len(COARSE),) not in columns:
                continue
            change = data.kelvin(file, data.fixed[file].F[:, columns[len(COARSE),]].astype(float))
            rise = seen.values[:, seen.inside] - float(np.nanmin(seen.values))
            rms, whole = (float(np.sqrt(np.mean(a**2))) for a in (change, rise))
            worst = max(worst, (rms / max(whole, 1e-9), rms, file))
    share, rms, file = worst
    if GROUPS[Kind.MESH] * share < LARGEST:
        return []
    first = f" with a first of {1e3 * case['numerics.first_y']:g} mm" if case["numerics.first_y"] else ""
    return [
        f"numerics.across = {case['numerics.across']}{first} may be too coarse: half as many cells change {file} by "
        f"{rms:.2g} K rms, {100 * share:.2g} % of its rise; try 60 with numerics.first_y = 3e-5, or 1"
    ]


def ends(search: Search) -> list[str]:
    """That no full fit came to an end since the mesh errs by more than columns of coarser ones can tell."""
    errs: list[tuple[float, str]] = []
    for names in search.open_ends.keys() & search.fits.keys():
        if not (fit := search.fits[names]).hopeless:
            far = (abs(v) for p, v in adequacy.pulls(fit).items() if p.kind is Kind.MESH)
            errs.append((float(max(far, default=0.0)), " with ".join(sorted(names))))
    worst, cause = max(errs, default=(0.0, ""))
    if worst < adequacy.PULL:
        return []
    mesh = search.problem.case["numerics.mesh"]
    return [
        f"numerics.mesh = {mesh:g} may be too coarse: a fit of {cause} that came to no end has it err by {worst:.2g} "
        f"standard deviations; try {2 * mesh:g}"
    ]
