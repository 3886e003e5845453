"""The case as a drawing: the block on the road to scale, and speed and pressure over the whole schedule."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from flashtemp.lab import drawing
from flashtemp.lab.drawing import Shape
from flashtemp.model.case import Case
from flashtemp.model.scene import Scene
from flashtemp.model.schedule import Phase, Schedule
from flashtemp.physics.quantities import KELVIN

BLOCK_BOX: Final = (560.0, 290.0)  # view box of the block, px
SCHEDULE_BOX: Final = (560.0, 290.0)
BLOCK_AREA: Final = (380.0, 130.0)  # largest size of the block in its drawing, px
INTERFACE_Y: Final = 208.0  # of the block's drawing, px
MIN_BLOCK_PX: Final = 6.0  # a block thinner than this is drawn thicker, and the drawing says so
MAX_SPOTS_DRAWN: Final = 80
MAX_REPETITIONS_DRAWN: Final = 20
SAMPLES_PER_PHASE: Final = 60  # of a speed or pressure that varies in time


def format_length(metres: float) -> str:
    """A length with the unit in which it is easy to read.

    >>> format_length(0.025), format_length(3.5), format_length(3e-5)
    ('25 mm', '3.5 m', '30 µm')
    """
    if metres >= 1.0:
        return f"{metres:.4g} m"
    return f"{1e3 * metres:.4g} mm" if metres >= 1e-4 else f"{1e6 * metres:.4g} µm"


def format_pressure(pascal: float) -> str:
    """A pressure in kPa, or in MPa from 1 MPa.

    >>> format_pressure(1.5e5), format_pressure(2e6)
    ('150 kPa', '2 MPa')
    """
    return f"{1e-6 * pascal:.4g} MPa" if pascal >= 1e6 else f"{1e-3 * pascal:.4g} kPa"


def format_duration(seconds: float) -> str:
    """A time in s, min or h.

    >>> format_duration(35.0), format_duration(440.0), format_duration(9000.0)
    ('35 s', '7.3 min', '2.5 h')
    """
    if seconds < 120:
        return f"{seconds:.3g} s"
    return f"{seconds / 60:.2g} min" if seconds < 7200 else f"{seconds / 3600:.2g} h"


# --- block on road ------------------------------------------------------------------------------------------
def draw_block(case: Case) -> tuple[list[Shape], str]:
    """Shapes of the block on the road, to scale, and the same in words."""
    scene = case.scene
    scale = min(BLOCK_AREA[0] / scene.length, BLOCK_AREA[1] / scene.height)
    width, height = max(scale * scene.length, MIN_BLOCK_PX), max(scale * scene.height, MIN_BLOCK_PX)
    left, lifted = (BLOCK_BOX[0] - width) / 2, 26.0 if scene.schedule.alone else 0.0
    bottom = INTERFACE_Y - lifted
    shapes = [
        drawing.rectangle(0, INTERFACE_Y, BLOCK_BOX[0], BLOCK_BOX[1] - INTERFACE_Y, "ft-d-road"),
        drawing.rectangle(
            left - scale * case["road.upstream"], INTERFACE_Y,
            width + scale * (case["road.upstream"] + case["road.downstream"]), 12, "ft-d-road-near",
        ),
        drawing.rectangle(left - 8, bottom - height - 10, width + 16, 10, "ft-d-holder"),
        drawing.rectangle(left, bottom - height, width, height, "ft-d-block"),
        *_draw_layers(scene, left, bottom, width, height),
        *([] if lifted else _draw_spots(scene, left, width, scale)),
        *_draw_motion(scene, left, bottom, width, height),
        *drawing.dimension(left, INTERFACE_Y + 18, left + width, INTERFACE_Y + 18, format_length(scene.length)),
        *drawing.dimension(
            left + width + 18, bottom - height, left + width + 18, bottom, format_length(scene.height)
        ),
        drawing.words(12, BLOCK_BOX[1] - 10, str(case["road.material"]), anchor="start"),
        drawing.words(
            BLOCK_BOX[0] - 12, BLOCK_BOX[1] - 10, f"{scene.ambient - KELVIN:.4g} °C", "ft-d-number", anchor="end"
        ),
    ]  # fmt: skip
    if min(scale * scene.length, scale * scene.height) < MIN_BLOCK_PX:
        shapes.append(drawing.words(BLOCK_BOX[0] / 2, 16, "not to scale: drawn thicker", "ft-d-muted"))
    return shapes, describe_block(case)


def describe_block(case: Case) -> str:
    """The block, its contact and its motion in a sentence."""
    scene = case.scene
    layers = f" of {len(scene.layers)} layers" if scene.layers else ""
    size = " by ".join(format_length(v) for v in (scene.length, case["block.width"], scene.height))
    if scene.schedule.alone:
        return f"Block{layers}, {size}, off the road for {format_duration(scene.schedule.alone)}."
    return (
        f"Block{layers}, {size}, on the road under {describe_range(scene.schedule.pressure.value, format_pressure)} at "
        f"{describe_range(scene.schedule.speed.value, lambda v: f'{v:.4g} m/s')}; contact: {describe_contact(scene)}."
    )


def describe_contact(scene: Scene) -> str:
    """What of the face touches the road."""
    if scene.spot_fraction >= 1.0:
        return "the whole face"
    return f"spots of {format_length(scene.spot_diameter)}, {100 * scene.spot_fraction:.3g} % of the face"


def describe_range(values: Any, write: Any) -> str:
    """The lowest and the highest of several values, or the only one, as text."""
    low, high = min(values), max(values)
    return str(write(low)) if low == high else f"{write(low)} to {write(high)}"


def _draw_layers(scene: Scene, left: float, bottom: float, width: float, height: float) -> list[Shape]:
    """Lines between the layers of the block and their names, or the name of its material."""
    if not scene.layers:
        return []
    shapes, z = [], 0.0
    for n, layer in enumerate(scene.layers):
        low, z = z, z + layer.thickness
        y0, y1 = (bottom - height * v / scene.height for v in (low, z))
        if n:
            shapes.append(drawing.line(left, y0, left + width, y0, "ft-d-layer"))
        if y0 - y1 >= 11:
            text = f"{layer.name}, {format_length(layer.thickness)}"
            shapes.append(drawing.words(left + width / 2, (y0 + y1) / 2 + 4, text))
    return shapes


def _draw_spots(scene: Scene, left: float, width: float, scale: float) -> list[Shape]:
    """The macroasperity spots along the face, to scale, and their description."""
    number = scene.spot_fraction * scene.length / scene.spot_diameter
    drawn = int(min(max(round(number), 1), MAX_SPOTS_DRAWN))
    size = min(max(scene.spot_fraction * width / drawn, 1.5), width)
    pitch = width / drawn
    shapes = [
        drawing.rectangle(left + (k + 0.5) * pitch - size / 2, INTERFACE_Y - 2.5, size, 5, "ft-d-spot")
        for k in range(drawn)
    ]
    text = f"contact: {describe_contact(scene)}"
    return [*shapes, drawing.words(BLOCK_BOX[0] / 2, INTERFACE_Y + 56, text, "ft-d-spot-text")]


def _draw_motion(scene: Scene, left: float, bottom: float, width: float, height: float) -> list[Shape]:
    """Arrows of load and speed with their values, and the leading edge."""
    schedule, top = scene.schedule, bottom - height - 12
    if schedule.alone:
        return [drawing.words(BLOCK_BOX[0] / 2, top - 14, f"off the road for {format_duration(schedule.alone)}")]
    shapes: list[Shape] = []
    for part in (0.2, 0.5, 0.8):
        shapes += drawing.arrow(left + part * width, top - 24, left + part * width, top, "ft-d-load")
    shapes.append(
        drawing.words(
            left + width / 2, top - 32, describe_range(schedule.pressure.value, format_pressure), "ft-d-load-text"
        )
    )
    speed, middle = describe_range(schedule.speed.value, lambda v: f"{v:.4g} m/s"), bottom - min(height / 2, 30)
    both, back = len(schedule.directions) > 1, schedule.directions == {-1}
    front = left + width + 44 if back else left - 16
    tip = front + (52 if back else -52)
    shapes += drawing.arrow(front, middle, tip, middle, "ft-d-speed")
    if both:
        shapes += drawing.arrow(tip, middle, front, middle, "ft-d-speed")
    shapes.append(drawing.words((front + tip) / 2, middle - 10, speed, "ft-d-speed-text"))
    edge = "leads in turn" if both else "leading edge"
    return [*shapes, drawing.words((front + tip) / 2, middle + 18, edge, "ft-d-muted")]


# --- schedule ---------------------------------------------------------------------------------------------------
def draw_schedule(case: Case) -> tuple[list[Shape], str]:
    """Shapes of speed and pressure over all repetitions and waits, and the same in words."""
    schedule = case.scene.schedule
    phases = [p for p in schedule.phases if p.repetition <= MAX_REPETITIONS_DRAWN]
    end = phases[-1].end
    about = describe_schedule(schedule)
    shapes = [drawing.words(56, 18, about, anchor="start")]
    if schedule.alone:
        shapes.append(drawing.words(SCHEDULE_BOX[0] / 2, 140, "nothing slides: no speed and no pressure", "ft-d-muted"))
        return shapes, about
    speeds = [(t, s * p.direction) for p in phases for t, s in _sample_phase(schedule.speed, p, True)]
    loads = [(t, 1e-3 * v) for p in phases for t, v in _sample_phase(schedule.pressure, p, schedule.lifted)]
    shapes += _draw_curve(speeds, end, (36.0, 134.0), "m/s", "ft-d-speed")
    shapes += _draw_curve(loads, end, (160.0, 258.0), "kPa", "ft-d-load")
    for value in nice_ticks(0.0, end, 6):
        x = _time_x(value, end)
        shapes += [drawing.line(x, 258, x, 262, "ft-d-axis"), drawing.words(x, 275, f"{value:.6g}", "ft-d-tick")]
    shapes.append(drawing.words(SCHEDULE_BOX[0] - 12, 288, "time (s)", "ft-d-muted", anchor="end"))
    if schedule.repetitions > MAX_REPETITIONS_DRAWN:
        shapes.append(
            drawing.words(
                56, 288, f"the first {MAX_REPETITIONS_DRAWN} of {schedule.repetitions}", "ft-d-muted", "start"
            )
        )
    return shapes, about


def describe_schedule(schedule: Schedule) -> str:
    """The schedule in a line: repetitions, distance, waits and duration."""
    if schedule.alone:
        return f"block alone for {format_duration(schedule.alone)}"
    many = schedule.repetitions
    wait = f"waits of {format_duration(schedule.wait)}, {'lifted' if schedule.lifted else 'in contact'}; "
    return (
        f"{many} repetition{'s' if many > 1 else ''} of {format_length(schedule.distance)}; "
        f"{wait if schedule.wait and many > 1 else ''}{format_duration(schedule.end_time)} in all"
    )


def _sample_phase(series: Any, phase: Phase, is_zero_at_rest: bool) -> list[tuple[float, float]]:
    """(time, value) of a series over one phase, from and to 0 where the block rests."""
    if not phase.sliding:
        value = 0.0 if is_zero_at_rest else series(phase.begin - phase.start)
        return [(phase.begin, value), (phase.end, value)]
    number = 2 if len(series.value) == 1 else SAMPLES_PER_PHASE
    times = np.linspace(phase.begin, phase.end, number)
    if number > 2:
        kinks = [phase.start + t for t in series.time if phase.begin < phase.start + t < phase.end]
        times = np.unique([*times, *kinks[:SAMPLES_PER_PHASE]])
    return [(float(t), float(series(t - phase.start))) for t in times]


def _time_x(t: float, end: float) -> float:
    return 56.0 + t / end * (SCHEDULE_BOX[0] - 72.0)


def _draw_curve(
    rows: list[tuple[float, float]], end: float, span: tuple[float, float], unit: str, kind: str
) -> list[Shape]:
    """One curve over time with its axis; negative values are drawn below zero."""
    low, high = min(0.0, *(v for _, v in rows)), max(0.0, *(v for _, v in rows))
    ticks = nice_ticks(low, high, 3)
    low, high = min(low, ticks[0]), max(high, ticks[-1])

    def y_of(value: float) -> float:
        return span[1] - (value - low) / ((high - low) or 1.0) * (span[1] - span[0])

    points = [(_time_x(t, end), y_of(v)) for t, v in rows]
    zero, right = y_of(0.0), SCHEDULE_BOX[0] - 16.0
    shapes = [drawing.polyline([(points[0][0], zero), *points, (points[-1][0], zero)], f"{kind}-area", closed=True)]
    for value in ticks:
        y = y_of(value)
        shapes += [
            drawing.line(56, y, right, y, "ft-d-grid"),
            drawing.words(50, y + 4, f"{value:.6g}", "ft-d-tick", "end"),
        ]
    shapes += [drawing.line(56, zero, right, zero, "ft-d-axis"), drawing.polyline(points, f"{kind} ft-d-curve")]
    return [*shapes, drawing.words(14, sum(span) / 2, unit, f"{kind}-text", upward=True)]


def nice_ticks(low: float, high: float, number: int) -> list[float]:
    """Round values from `low` to `high`, about `number` of them.

    >>> nice_ticks(0.0, 150.0, 3), nice_ticks(0.0, 0.1, 3)
    ([0.0, 50.0, 100.0, 150.0], [0.0, 0.05, 0.1])
    """
    span = high - low
    if not span > 0:
        return [low]
    base = 10.0 ** np.floor(np.log10(span / number))
    step = next(float(base * m) for m in (1, 2, 2.5, 5, 10) if base * m * number >= span * (1 - 1e-9))
    first = int(np.ceil(low / step - 1e-9))
    return [float(f"{k * step:.10g}") for k in range(first, int(np.floor(high / step + 1e-9)) + 1)]
