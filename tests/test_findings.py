"""The report of a discovery: for every kind of verdict one whole file whose words and pictures are the verdict's own."""

import base64
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex

from flashtemp import findings
from flashtemp.camera.recording import Recording
from flashtemp.campaign import View
from flashtemp.compare import Seeing
from flashtemp.residual import Noise, lag_one, structured, whiten
from flashtemp.verdict import KINDS, Cause, Estimate, Fitness, Missing, Pull, Rival, Test, Verdict
from flashtemp.viz import causes, discovery, evidence, gain, missing, pairs, wrong

Test.__test__ = False  # a class of the verdict, not one of pytest
TITLE = 'run-in <script>alert(1)</script> & "more" $5'
TIME = np.array([5.0, 20.0, 35.0, 365.0, 380.0, 395.0])
REPETITION = np.array([1, 1, 1, 10, 10, 10])
NAMES = (
    "edge_pressure third_body track_memory pressure_tilt wear evaporation ambient_drift friction_softening "
    "friction_speed friction_load conductance_load conductance_speed conductivity_slope capacity_slope time_lag "
    "side_cooling heat_depth internal_heat pressure_crown conductivity_anisotropy"
).split()


# --- verdicts made by hand --------------------------------------------------------------------------
def seen(measured, predicted, view, file, given, held=False):
    level, shape = Noise(0.05, 0.02), measured.shape
    u = 1e-3 * np.arange(shape[2]) + (0.0515 if view == "wake" else 0.0005)
    v = 1e-3 * (np.arange(shape[1]) + 0.5 - (shape[1] / 2 if view == "wake" else 0)) if view != "profile" else [0.0]
    recording = Recording(view, measured, TIME, REPETITION, u, np.asarray(v))
    residual = measured - predicted
    residual[:, :, 0] = np.nan
    sigmas = whiten(residual, level)
    good = np.isfinite(residual)
    return Seeing(
        view=View(file, recording, given, 0.05, held),
        predicted=predicted,
        residual=residual,
        sigmas=sigmas,
        noise=level,
        shift=(0.0, 0.0),
        shift_refused=None,
        shift_error=(0.0, 0.0),
        rmse_K=float(np.sqrt(np.mean(residual[good] ** 2))),
        bias_K=float(np.mean(residual[good])),
        chi2_per_dof=float(np.mean(sigmas[good] ** 2)),
        pixels=int(good.sum()),
        largest=structured(residual, level, recording),
        correlation={n: lag_one(sigmas, a) for a, n in ((2, "u"), (1, "v"), (0, "time"))},
    )


def both(view="sidewall", given=None, spot=1.9, seed=1, held=False, file=None):
    """A recording against a base without, and a model with, a hot leading edge that fades with repetition."""
    nv, rng = {"sidewall": 14, "wake": 16, "profile": 1}[view], np.random.default_rng(seed)
    u, v = np.arange(50), np.arange(nv)
    rise = (TIME % 360)[:, None, None] ** 0.5
    if view == "wake":
        base = 21 + 0.8 * np.exp(-u / 20) * np.exp(-(((v - 7.5) / 6) ** 4))[:, None] * rise
        hot = 0.2 * spot * np.exp(-u / 8) * np.exp(-(((v - 7.5) / 6) ** 4))[:, None] * np.ones((6, 1, 1))
    else:
        base = 20 + 2.5 * rise * np.exp(-v / 6)[:, None] * (0.5 + 0.5 * np.sqrt((u + 1) / 50))
        hot = spot * np.exp(-u / 5) * np.exp(-v / 3)[:, None] * np.ones((6, 1, 1))
    hot = hot * np.where(REPETITION == 1, 1.0, 0.15)[:, None, None]
    measured = base + hot + 0.05 * rng.normal(size=hot.shape) + 0.02 * rng.normal(size=hot.shape[1:])
    if nv > 1:
        measured[:, 5, 30] = np.nan
    given = given or {}
    file = file or f"{view}_{seed}.nc"
    return seen(measured, base, view, file, given, held), seen(measured, base + hot, view, file, given, held)


def recordings(count=2, spot=1.9, views=("sidewall", "wake"), held=True):
    out = []
    for i in range(count):
        given = {"contact.pressure": (0.5 + 0.5 * (i % 2)) * 1e5, "schedule.speed": 0.1 * (1 + i)}
        given["ambient.temperature"] = 21.0
        out += [both(v, given, spot * (1 + 0.3 * i), 10 * i + k, held and i == count - 1) for k, v in enumerate(views)]
    return tuple(a for a, _ in out), tuple(b for _, b in out)


def lacks(condition, strength=1.0, repetitions=(1, 10)):
    x, rng = np.linspace(0.0, 0.05, 26), np.random.default_rng(3)
    sd = np.where(x < 0.004, 400.0, 150.0)
    flux = np.stack([strength * 4000 * np.exp(-x / 0.006) / n for n in range(1, len(repetitions) + 1)])
    flux = flux + sd * rng.normal(size=flux.shape)
    pressure = 1 + strength * 1.7 * np.exp(-x / 0.006) - 0.12
    resolution = np.clip(1.2 - (x / 0.05) ** 4 - 0.9 * np.exp(-x / 0.002), 0, 1)
    return Missing(condition, x, np.array(repetitions), flux, sd + 0 * flux, pressure, sd / 2500, resolution)


RIVALS = tuple(
    Rival(
        n, score, 0.9 - 0.04 * i, f"would need an amplitude that breaks its bound {score:g} < 8", f"{n}.r", 0.45 + i,
        0.05, "1" if i % 2 else "W/m2/K", 3.0 + i, 0.02, 0.05 * (i + 1), 180.0 - i, i < 4,
    )
    for i, (n, score) in enumerate(
        zip(NAMES[1:], (96.0, 31.5, 12.2, 6.1, 3.3, 1.4, 0.2, -0.4, -0.9, -1.1, -1.5, -1.8, -2.2, -2.4, -3.0, -3.1, -3.5,
                        -4.0, -6.2), strict=True)
    )
)  # fmt: skip
CAUSE = Cause(
    "edge_pressure", "the nominal contact pressure peaks at the leading edge",
    (Estimate("edge_pressure.a", 1.724, 0.051, (1.62, 1.82)),
     Estimate("edge_pressure.length", 2.1e-3, 1.5e-4, (1.8e-3, 2.4e-3), "m", True)),
    5230.0, 0.041, 0.83, 3140.0, 72.0, 0.014,
    (("pressure 0.05 MPa, speed 0.1 m/s", 1.70, 0.08), ("pressure 0.1 MPa, speed 0.2 m/s", 1.74, 0.06)), 0.41,
)  # fmt: skip
SIGNS = np.corrcoef(np.random.default_rng(5).normal(size=(len(NAMES), 12)))
NUISANCE = tuple(
    Pull(n, value, 0.01, pull, unit)
    for n, value, pull, unit in (
        ("friction.mu", 0.97, 0.8, "1"), ("conductance.h", 1498.0, -3.4, "W/m2/K"), ("block.k", 0.24, 1.2, "W/m/K"),
        ("road.e", 1450.0, -0.3, "J/m2/K/s^0.5"), ("image shift u, sidewall_0.nc", 0.12, 0.6, "px"),
        ("gain, wake_1.nc", 1.004, 0.3, "1"),
    )
)  # fmt: skip
TESTS = (
    Test("Moran's I", "sidewall_0.nc", 0.31, 0.001), Test("runs along x", "wake_1.nc", -6.2, 0.004),
    Test("Moran's I", "sidewall_0.nc", 0.004, 0.37, "after"), Test("runs along x", "wake_1.nc", -0.4, 0.61, "after"),
)  # fmt: skip
BASE = Fitness(0.1863, 13.2, 0.2431, 17.1, 0.1712, 0.4105)
EXTENDED = Fitness(0.0537, 1.004, 0.0541, 1.01, 0.0212, 0.0566)
CERTIFICATE = {
    "converged": True,
    "largest_step": 0.004,
    "relinearisations": 3,
    "starts": [1, 2, 3],
    "mesh": {"pull": 0.4},
}


def verdict(kind, count=2, **changes):
    before, after = recordings(count)
    whole = {
        "title": TITLE,
        "kind": kind,
        "says": (
            "The uniform-pressure simulation misses the leading 6 mm by +1.9 K in repetition 1 and by less than 0.3 K in "
            "repetition 10 (noise 0.05 K).",
            "Cause: the nominal contact pressure peaks at the leading edge, a = 1.72 ± 0.05.",
        ),
        "causes": (CAUSE,),
        "next_experiment": "Rest 10 min before repetition 11: it separates <track memory> from drift.",
        "base": BASE,
        "extended": EXTENDED,
        "rivals": RIVALS,
        "nuisance": NUISANCE,
        "tests": TESTS,
        "missing": (lacks("pressure 0.05 MPa, speed 0.1 m/s"), lacks("pressure 0.1 MPa, speed 0.2 m/s", 1.3)),
        "separability": (tuple(NAMES), SIGNS),
        "shifts": (
            ("friction.mu", 0.93, 0.97, 0.01),
            ("conductance.h", 1610.0, 1498.0, 12.0),
            ("x.zero", 0.0, 0.1, 0.1),
        ),
        "before": before,
        "after": after,
        "gates": {"generic structure left": (-310.0, -150.0), "pressure modes": (4.2, 20.0)},
        "certificate": CERTIFICATE,
        "assumed": {"block.k": 0.05, "side wall emission": 0.01},
        "warnings": ("wake_1.nc: the noise was <estimated> from the data.",),
        "seconds": 83.0,
    }
    none = {"causes": (), "extended": None, "after": (), "shifts": (), "tests": TESTS[:2]}
    parts = {
        "named": {},
        "weak": {"says": ("The best explanation is weakly supported: ln Bayes factor 9.1.",)},
        "group": none | {
            "group": ("edge_pressure", "pressure_tilt"), "says": ("Either of two effects explains the data equally well.",),
            "rivals": (Rival("edge_pressure", 98.0, 0.1, "cannot be told from pressure tilt", "edge_pressure.a", 1.7, 0.1,
                             refitted=True), *RIVALS[1:]),
        },
        "none_needed": none | {
            "says": ("No extension is needed: the largest of 20 effects has ln BF 1.3, below the alarm level 8.",),
            "rivals": tuple(replace(r, score=r.score / 80) for r in RIVALS), "next_experiment": "",
            "before": recordings(count, 0.0)[0], "missing": (lacks("as in the case", 0.0),), "base": EXTENDED,
        },
        "unexplained": none | {"says": ("Something outside the catalogue is present at x = 10 to 14 mm.",)},
        "no_verdict": none | {
            "says": ("The calibration did not converge: three starts ended in different places.",), "rivals": (),
            "certificate": {"converged": False, "largest_step": 0.7}, "before": (), "missing": (), "separability": None,
            "nuisance": (), "tests": (), "base": None, "next_experiment": "", "gates": {}, "assumed": {},
        },
    }  # fmt: skip
    return Verdict(**(whole | parts[kind] | changes))
