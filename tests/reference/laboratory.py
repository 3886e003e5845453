"""A campaign as a laboratory hands it over, from `sliding` and `camera`: hidden effects, errors, files.

Everything is drawn from a seed.  What was hidden and which errors were made is returned, never written beside the data.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.interpolate import RectBivariateSpline

from reference import thermocouples
from reference.asperities import retained_fraction
from reference.camera import Geometry, Optics, simulate_image
from reference.setup_errors import SetupErrors
from reference.sliding import SlidingBlock, SlidingPair, impulse_rise, road_conductance
from reference.uncooled_camera import CameraErrors, draw_errors, record_frames
from reference.wall import WallDeficit

AIR_DEGC, LOAD_CELL_NOISE = 20.0, 0.005
CONDITIONS = ((1.5e5, 0.1), (0.75e5, 0.3))  # Pa, m/s
FRAME_FRACTIONS = (
    0.2,
    0.55,
    0.94,
)  # shares of a repetition at which frames are taken, the last before the block meets its start


@dataclass(frozen=True)
class HiddenEffects:
    """What the believed case does not know: sizes of effects by name (catalogue's own where it has them)."""

    sizes: dict[str, float] = field(default_factory=dict)

    def __call__(self, name):
        return self.sizes.get(name, 0.0)


@dataclass(frozen=True)
class MeasurementErrors:
    """Errors of a laboratory in their usual size, all drawn: standard deviations, `size` scales them."""

    size: float = 1.0
    larger: float = 0.003  # pixel
    turned: float = 0.3  # degrees
    length: float = 1e-4  # m, of the block
    map: float = 0.003  # emissivity over the image
    level: float = 0.01  # friction of a condition
    jitter: float = 0.01  # friction of a repetition
    shift: float = 0.2  # px
    emissivity: float = 0.01
    spread: float = 0.05  # of the optics
    clock: float = 0.01  # s
    drift: float = 1e-4  # s of the clock per s
    cell: float = 0.005  # gain of the load cell
    mu: float = 0.05  # what is calibrated
    fraction: float = 0.05
    convection: float = 0.2
    pattern: tuple[float, float] = (0.02, 0.05)  # K, from to
    place: float = 3e-4  # m, of a thermocouple
    sensor: float = 0.005  # gain of one
    lag: float = 0.1  # s, of the time constant of one


@dataclass(frozen=True)
class MeasurementProgramme:
    """How the tester runs: repetitions of a distance (m) with waits (s) between, block lifted."""

    distance: float = 0.6
    repetitions: int = 2
    wait: float = 8.0
    columns: int = 100
    mesh: float = 0.6
    convection: float = 10.0
    conditions: tuple[tuple[float, float], ...] = CONDITIONS
    pair: SlidingPair = field(default_factory=SlidingPair)
    mu: float = 1.0
    fraction: float = 0.2
    netd: float = 0.05  # K
    pitch: dict[str, float] = field(default_factory=lambda: {"sidewall": 2.5e-4, "wake": 5e-4})  # m
    wake_length: float = 0.03  # m of road that is seen
    frame_fractions: tuple[float, ...] = FRAME_FRACTIONS
    wait_fractions: tuple[float, ...] = (0.6,)  # shares of a wait at which frames are taken
    sensors: tuple[tuple[float, float], ...] = ()  # thermocouples: shares of length and height
    lag: float = 0.3  # s, their time constant


def continuous_frames(frames=30, wait_frames=6):
    """Options of a programme whose cameras run all the time: `frames` per repetition and `wait_frames` per wait."""
    return {
        "frame_fractions": tuple(np.linspace(0.1, 0.94, frames)),
        "wait_fractions": tuple(np.linspace(0.1, 0.9, wait_frames)),
    }


def stated_case(test, more=""):
    """The case that a laboratory believes."""
    pair = test.pair
    return f"""title = "independent laboratory"
[materials.rubber]
conductivity = {pair.k}
density = {pair.rc / 1700.0}
heat_capacity = 1700.0
[materials.ground]
conductivity = {pair.road_k}
density = {pair.road_rc / 950.0}
heat_capacity = 950.0
[block]
material = "rubber"
length = {pair.length}
width = {pair.width}
height = {pair.height}
[contact]
pressure = {test.conditions[0][0]}
spot_fraction = {test.fraction}
spot_diameter = {pair.diameter}
[friction]
mu = {test.mu}
[schedule]
speed = {test.conditions[0][1]}
distance = {test.distance}
repetitions = {test.repetitions}
wait = {test.wait}
[road]
material = "ground"
track_length = {test.distance}
[ambient]
convection = {test.convection}
[numerics]
mesh = {test.mesh}
{more}"""


@dataclass(frozen=True)
class TrueCondition:
    """One condition as it really is."""

    pair: SlidingPair
    test: MeasurementProgramme
    hidden: HiddenEffects
    pressure: float
    speed: float
    mu: float
    fraction: float
    convection: float
    scatter: tuple[float, ...]

    @property
    def shape(self):
        """Local over mean pressure (columns,)."""
        x, L, h = self.pair.x, self.pair.length, self.hidden
        out = 1.0 + h("pressure_tilt") * (1.0 - 2.0 * x / L)
        mean = 0.0025 / L * -np.expm1(-L / 0.0025)
        out += h("edge_pressure") * (np.exp(-x / 0.0025) - mean)
        out += h("waves") * np.cos(4.0 * np.pi * x / L)  # pressed in three places: no effect of the catalogue
        return out / out.mean()

    def friction(self, T, slid):
        """mu (columns,) at temperatures degC of the spots, `slid` (m) in the test."""
        out = self.mu * np.exp(-self.hidden("friction_softening") * (T - 20.0))
        return out * (1.0 + self.hidden("polishing") * np.exp(-slid / 0.15))  # polishing: no effect of the catalogue

    def resistance(self, slid):
        """m2 K/W of what lies in the contact."""
        h = self.hidden
        out = h("interface_resistance") + h("conductance_speed") * (self.speed / 0.1) ** -0.5
        return out + h("third_body") * slid / self.test.distance

    @property
    def sides(self):
        """Film (W/m2K) of the side walls while the block slides; sqrt(v) is the law of no effect of the catalogue."""
        return self.hidden("side_cooling") * self.speed**0.8 + self.hidden("laminar_cooling") * self.speed**0.5

    def air(self, t):
        return self.hidden("ambient_drift") * t


@dataclass(frozen=True)
class Snapshot:
    """What the cameras may see at a time `t` (s): the section's modes and what the wall lacks against it, the wake's
    places and rise, and what it lacks (y, x) off the middle."""

    t: float
    repetition: int
    sliding: bool
    state: np.ndarray
    wake: tuple[np.ndarray, np.ndarray]
    wall_deficit: np.ndarray | None = None
    wake_deficit: np.ndarray | None = None
    has_frame: bool = True  # by cameras; thermocouples are asked more often


def simulate_condition(condition, requests):
    """Run one condition; `requests` (repetition, sliding) -> shares of the stretch at which moments are kept.

    Moments, and the load cell's times (s) and friction.
    """
    p, test, h = condition.pair, condition.test, condition.hidden
    flash = 1.0
    s = SlidingBlock(
        p,
        condition.fraction,
        True,
        flash,
        h("conductivity_slope"),
        wake_columns=round((test.wake_length + 3e-3) / p.dx),
    )
    history = []
    dt, steps = p.dx / condition.speed, round(test.distance / p.dx)
    t, moments, times, cell, passes = 0.0, [], [], [], []
    films, shape = (condition.convection + condition.sides, condition.sides), None
    load, columns = condition.shape * condition.pressure, np.arange(p.columns)
    for r in range(1, test.repetitions + 1):
        s.lift_block()
        begin, spot, left = t, s.face + AIR_DEGC, np.zeros((2, steps + 1 - p.columns))
        at = {round(share * steps) for share in requests[r, True]}
        sensors = {round(share * steps) for share in thermocouples.SLIDING if test.sensors}
        for k in range(1, steps + 1):
            slid = (r - 1) * test.distance + k * p.dx
            mu = condition.friction(spot, slid) * (1.0 + condition.scatter[r - 1])
            t = begin + k * dt
            warm = condition.air(t) + _track_rise(condition, passes, k - columns, t, spots=True)
            heat = mu * load * condition.speed / condition.fraction
            _, _, rise = s.advance_sliding(dt, heat, condition.resistance(slid), warm, films, condition.air(t))
            spot = rise + AIR_DEGC
            if k > p.columns:
                left[:, k - p.columns] = s.departed_heat(), t
            if k % max(steps // 100, 1) == 0:
                times.append(t)
                cell.append(float(mu @ load / load.sum()))
            if k in at or k == steps or k % max(steps // 60, 1) == 0:
                history.append((t, *films, True, s.amplitude.copy(), condition.air(t)))
            if k in at:
                places, wake = s.wake_profile(condition.convection)
                before = _track_rise(condition, passes, k - p.columns - np.arange(s.wake_columns), t)
                moments.append(Snapshot(t, r, True, s.amplitude.copy(), (places, wake + before + condition.air(t))))
            elif k in sensors:
                moments.append(Snapshot(t, r, True, s.amplitude.copy(), (np.zeros(1), np.zeros(1)), has_frame=False))
        passes.append(left)
        shape = s.face - condition.air(t) if r == 1 else shape
        if r < test.repetitions:
            moments += _simulate_wait(condition, s, history, t, r, requests.get((r, False), ()))
            t += test.wait
    held = road_conductance(p, condition.fraction, condition.speed, shape, WallDeficit.contact_places(p))
    wall = WallDeficit(p, held, condition.convection, t, h("conductivity_slope"))
    wakes, wall_deficit, wake_deficit = (
        {m.t: m.wake[0] + p.length for m in moments if m.sliding and m.has_frame},
        {},
        {},
    )
    for t, *now in history:
        wall_deficit[t] = wall.advance(t, *now)
        if t in wakes:
            wake_deficit[t] = wall.road_deficit(condition.speed, wakes[t], _lateral_places(p))
    moments = [replace(m, wall_deficit=wall_deficit.get(m.t), wake_deficit=wake_deficit.get(m.t)) for m in moments]
    return s, moments, np.array(times), np.array(cell)


def _lateral_places(pair):
    """Places y (m) across the road at which one may look."""
    return 0.5 * pair.width * np.linspace(-1.0, 1.0, 201)


def _simulate_wait(condition, s, history, begin, r, shares):
    """Moments of a wait."""
    count, out = 200, []
    dt = condition.test.wait / count
    for k in range(1, count + 1):
        t = begin + k * dt
        s.advance_rest(dt, (condition.convection, 0.0), condition.convection, condition.air(t))
        is_frame = k in [round(a * count) for a in shares]
        if is_frame or k in (1, 2, 4) or k % 8 == 0:
            history.append((t, condition.convection, 0.0, False, s.amplitude.copy(), condition.air(t)))
        if is_frame or (condition.test.sensors and k % thermocouples.RESTING == 0):
            out.append(Snapshot(t, r, False, s.amplitude.copy(), (np.zeros(1), np.zeros(1)), has_frame=is_frame))
    return out


def _track_rise(condition, passes, place, t, spots=False):
    """Rise (places,) K of road `place` columns along the track that earlier repetitions have warmed: `passes` of each,
    by place the heat that it left (J/m2 of lane) and when.  Across the road, or of the `spots` that have left it."""
    share, out = condition.hidden("track_memory"), np.zeros(len(place))
    if not share:
        return out
    for heat, then in passes:  # road that was under the block when it was lifted is what passed it last
        at = np.where((place >= 1) & (place < len(heat)), place, len(heat) - 1)
        pair, age = condition.pair, t - then[at]
        part = (
            retained_fraction(condition.fraction, pair.diameter, pair.road_k / pair.road_rc, age)
            if spots
            else condition.fraction
        )
        out += share * part * impulse_rise(heat[at], age, pair, condition.convection)
    return out


# --- what is handed over -------------------------------------------------------------------------------
def write_campaign(
    folder, hidden=None, seed=0, errors=None, test=None, views=("sidewall", "wake"), wake_error=0.0, free=None, setup_errors=None,
    uncooled=False,
):  # fmt: skip
    """Write campaign.toml, case.toml, recordings and load-cell traces into `folder`; what was drawn.

    `setup_errors` gives fields of `SetupErrors`.  `wake_error` (K) is a smooth error in the wake's frames, as of a solver.
    `uncooled`: cameras with the errors of `uncooled_camera`, one drawn for each view; or errors that both have.
    """
    folder, hidden, errors, test = (
        Path(folder),
        HiddenEffects(hidden or {}),
        errors or MeasurementErrors(),
        test or MeasurementProgramme(),
    )
    folder.mkdir(parents=True, exist_ok=True)
    rng, setup = np.random.default_rng([seed, 5]), SetupErrors(**(setup_errors or {}))
    draw = _NormalDraw(rng, errors, np.random.default_rng([seed, 6]))
    length = test.pair.length + draw(errors.length) + setup.length
    pair = replace(test.pair, columns=test.columns, length=length, rc=test.pair.rc * setup.density)
    common = {k: float(np.exp(draw(getattr(errors, k)))) for k in ("mu", "fraction", "convection")}
    truth = {
        "hidden": hidden.sizes,
        "seed": seed,
        "length": length,
        "drawn": common,
        "recordings": {},
        "setup_errors": dict(setup_errors or {}),
    }
    lines = [f'title = "independent laboratory {seed}"', 'case = "case.toml"']
    free = ["friction.mu", "contact.spot_fraction", "ambient.convection"] if free is None else free
    lines.append(f"free = {free!r}".replace("'", '"'))
    wired = thermocouples.ThermocoupleSet.draw(test, draw)
    for number, (pressure, speed) in enumerate(test.conditions, 1):
        scatter = tuple(draw(errors.jitter) for _ in range(test.repetitions))
        mu = test.mu * common["mu"] * (1.0 + draw(errors.level))
        condition = TrueCondition(
            pair,
            test,
            hidden,
            pressure * setup.load,
            speed * setup.speed,
            mu,
            test.fraction * common["fraction"],
            test.convection * common["convection"],
            scatter,
        )
        given = f'with = {{ "contact.pressure" = {pressure}, "schedule.speed" = {speed} }}'
        requests = {(r, True): test.frame_fractions for r in range(1, test.repetitions + 1)}
        requests |= {(r, False): test.wait_fractions for r in range(1, test.repetitions)}
        sliding, moments, times, cell = simulate_condition(condition, requests)
        camera_clock = _draw_clock(draw, errors)
        for view in views:
            name = f"condition{number}_{view}.nc"
            seen = [m for m in moments if m.has_frame]
            seeds = (seed, views.index(view), number)
            camera = _UncooledCamera.draw(seeds, uncooled) if uncooled else None
            truth["recordings"][name] = _write_recording(
                folder / name, view, condition, sliding, seen, draw, camera_clock, setup, wake_error, camera
            )
            lines += ["", "[[recording]]", f'file = "{name}"', given, f"sigma_K = {max(test.netd, 1e-3)}"]
        if test.sensors:
            name = f"condition{number}_beads.csv"
            np.savetxt(
                folder / name, wired.table(condition, moments, draw, camera_clock, AIR_DEGC), delimiter=",", fmt="%.6g"
            )
            lines += wired.campaign_lines(name, given, test.netd)
        mu_read = cell * (1.0 + draw(errors.cell)) + LOAD_CELL_NOISE * draw.rng.normal(size=len(cell))
        name = f"condition{number}_mu.csv"
        rows = np.column_stack([times, mu_read])
        np.savetxt(folder / name, rows, delimiter=",", header="time_s,mu", comments="", fmt="%.9g")
        lines += ["", "[[force]]", f'file = "{name}"', given, f"sigma = {LOAD_CELL_NOISE}"]
    setup.exchange_recordings(folder)
    (folder / "case.toml").write_text(stated_case(test))
    (folder / "campaign.toml").write_text("\n".join(lines) + "\n")
    return truth


@dataclass(frozen=True)
class _NormalDraw:
    """Normal numbers of a given width, times the size of all errors."""

    rng: np.random.Generator
    errors: MeasurementErrors
    places: np.random.Generator

    def __call__(self, width):
        return float(self.errors.size * width * self.rng.normal())

    def draw_centre(self):
        """About which point of an image (shares of its extent) it turns and grows."""
        return tuple(self.places.uniform(size=2))


@dataclass(frozen=True)
class _UncooledCamera:
    """One uncooled camera: its errors, what draws whatever stays with it, and what is new in this recording."""

    errors: CameraErrors
    device: np.random.Generator
    rng: np.random.Generator

    @classmethod
    def draw(cls, seeds, errors):
        """The camera of a view by its `seeds` (campaign, view, condition), with random errors where they are True."""
        seed, view, condition = seeds
        own = draw_errors(np.random.default_rng([seed, 7, view])) if errors is True else errors
        return cls(own, np.random.default_rng([seed, 8, view]), np.random.default_rng([seed, 9, view, condition]))


def _draw_clock(draw, errors):
    offset, rate = abs(draw(errors.clock)), draw(errors.drift)
    return lambda t, r: t + offset + rate * t * (1.0 if r > 1 else 0.5)


def _write_recording(file, view, condition, sliding, moments, draw, camera_clock, setup, wake_error, camera=None):
    """Write one recording; its own errors."""
    errors, pair, test = draw.errors, condition.pair, condition.test
    pitch, length, side = test.pitch[view], test.pair.length, round(0.5 * pair.width + 5e-3, 9)
    if view == "sidewall":
        u = np.arange(-1e-3 + 0.5 * pitch, length + 1e-3, pitch)
        v = np.arange(-1e-3 + 0.5 * pitch, pair.height + 1e-3, pitch)
    else:
        u = np.arange(length + 0.5 * pitch, length + test.wake_length, pitch)
        v = np.arange(-side + 0.5 * pitch, side, pitch)
        moments = [m for m in moments if m.sliding]
    geometry = Geometry(
        (draw(errors.shift), draw(errors.shift)), draw(errors.larger), np.deg2rad(draw(errors.turned)),
        fixed=draw.draw_centre(),
    )  # fmt: skip
    concerned = setup.is_affected(file.name)
    geometry = setup.place_image(geometry) if concerned else geometry
    waves = [(m, n, draw(errors.map)) for m, n in ((1, 0), (0, 1), (1, 1), (2, 1))]
    a, b = np.linspace(0.0, 1.0, len(u)), np.linspace(0.0, 1.0, len(v))[:, None]
    gain = 1.0 + sum(k * np.sin(np.pi * m * (a - 0.4)) * np.cos(np.pi * n * (b - 0.3)) for m, n, k in waves)
    psf, emissivity = 0.7 * (1.0 + draw(errors.spread)), min(0.95 + draw(errors.emissivity), 1.0)
    optics = Optics(psf, emissivity - (setup.emissivity if concerned else 0.0), gain=gain)
    box = _view_box(view, pair, test.wake_length)
    T = np.array([simulate_image(_view_field(view, condition, sliding, m), box, AIR_DEGC + condition.air(m.t), u, v, optics, geometry)
                  for m in moments])  # fmt: skip
    if view == "wake" and wake_error:
        road = (np.abs(v) < 0.5 * pair.width)[:, None]
        T = T + wake_error * np.exp(-a / 0.4) * np.cos(1.3 * np.arange(len(T)))[:, None, None] * road
    pattern = draw.rng.uniform(*errors.pattern)
    fixed, noise = pattern * draw.rng.normal(size=T.shape[1:]), test.netd * draw.rng.normal(size=T.shape)
    time = np.array([m.t for m in moments])
    if camera:
        motion = np.array([m.sliding * condition.speed / pitch for m in moments])
        T = record_frames(T, time, camera.errors, camera.device, camera.rng, fixed + noise, motion)
    else:
        T = T + fixed + noise
    lag = condition.hidden("time_lag") + (setup.clock if concerned else 0.0)
    time = np.array([camera_clock(m.t, m.repetition) + lag for m in moments])
    _write_netcdf(file, view, T, time, [m.repetition for m in moments], u, v, test.netd)
    out = {"geometry": asdict(geometry), "emissivity": optics.emissivity, "psf": optics.psf, "pattern": pattern}
    return out | ({"camera": asdict(camera.errors)} if camera else {})


def _view_box(view, pair, wake_length):
    if view == "sidewall":
        return (0.0, pair.length), (0.0, pair.height)
    return (pair.length, pair.length + wake_length + 2.5e-3), (-0.5 * pair.width, 0.5 * pair.width)


def _view_field(view, condition, sliding, m):
    """The field (z, x) degC of a view at a moment."""
    if view == "wake":
        places, rise = m.wake
        less = RectBivariateSpline(_lateral_places(condition.pair), places, m.wake_deficit, kx=1, ky=1)

        # behind the trailing edge the road cools as the root of the distance: lines over it, up to the edge
        roots = np.sqrt(np.concatenate([[0.0], places]))
        edge = rise[0] - (rise[1] - rise[0]) / (roots[2] - roots[1]) * roots[1]

        def road(x, y):
            distance = np.maximum(x - condition.pair.length, 0.0)
            return AIR_DEGC + np.interp(np.sqrt(distance), roots, [edge, *rise]) - less(y, distance)

        return road

    def wall(x, z):
        rise = condition.pair.evaluate_height_modes(z) @ m.state.T @ condition.pair.evaluate_length_modes(x).T
        return AIR_DEGC + rise - RectBivariateSpline(*WallDeficit.evaluation_grid(condition.pair), m.wall_deficit)(z, x)

    return wall


def _write_netcdf(file, view, T, time, repetition, u, v, netd):
    import xarray as xr

    coords = {
        "time": ("frame", time, {"units": "s"}), "repetition": ("frame", repetition, {"units": "1"}),
        "u": ("u", u, {"units": "m"}), "v": ("v", v, {"units": "m"}),
    }  # fmt: skip
    known = {
        "view": view, "source": "independent laboratory", "Conventions": "CF-1.11", "emissivity": 0.95,
        "reflected_degC": AIR_DEGC, "netd_K": max(netd, 1e-3), "psf_sigma_px": 0.7, "registration_sigma_px": 0.2,
    }  # fmt: skip
    ds = xr.Dataset({"temperature": (("frame", "v", "u"), T, {"units": "degC"})}, coords=coords, attrs=known)
    ds.to_netcdf(file, engine="h5netcdf")
