"""Every closed form reproduces its check number of the verification list to the digits given there."""

from math import e, inf, pi, sqrt
from types import SimpleNamespace

import numpy as np
import pytest
from reference import analytical_solutions
from scipy.integrate import quad
from scipy.optimize import brentq, minimize_scalar
from scipy.special import erfcx

from flashtemp.physics.effects import lanes
from flashtemp.physics.friction import heat_kernels
from flashtemp.physics.material import LIBRARY

RUBBER, ROAD = LIBRARY["tread_rubber"], LIBRARY["asphalt"]
DR, DS, L = RUBBER.diffusivity, ROAD.diffusivity, 0.025


def printed(text: str):
    """A check number as printed: equal to half a unit of its last digit, or to 5e-8 where it has more digits.

    (A few numbers of the list are off by up to 4e-8 in their eighth digit, for example V14's zeta.)
    """
    mantissa, _, exponent = text.partition("e")
    last = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
    return pytest.approx(float(text), rel=0.0, abs=max(0.5001 * last, 5e-8 * abs(float(text))))


def test_printed_is_as_strict_as_it_says():
    assert printed("6.757681") == 6.7576814999
    assert printed("6.757681") != 6.7576817
    assert printed("0.748847666") != 0.7488477666
    assert printed("1.225490e-7") != 1.225496e-7


def test_materials_of_the_check_numbers():
    assert printed("1.225490e-7") == DR
    assert printed("4.576659e-7") == DS
    assert RUBBER.effusivity == printed("714.142843")
    assert ROAD.effusivity == printed("1478.174550")


def test_V1_constant_flux():
    assert analytical_solutions.constant_flux(RUBBER, 1e4, 3.5) == printed("29.559970")
    assert analytical_solutions.constant_flux(RUBBER, 1e4, 3.5, 1e-3) == printed("5.292016")


def test_V2_pulse():
    assert analytical_solutions.flux_pulse(ROAD, 7.5e4, 0.25, 1.25) == printed("6.757681")


@pytest.mark.parametrize(
    ("q", "surface", "below"),
    [(1e3, "0.26930182", "0.24055961"), (1e4, "1.4882574", "0.61249238"), (1e5, "2.5459950", "0.41703926")],
)
def test_V3_deep_source(q, surface, below):
    assert analytical_solutions.deep_source(RUBBER, 1e4, 1 / (2 * q), 0.03) == printed(surface)
    assert analytical_solutions.deep_source(RUBBER, 1e4, 1 / (2 * q), 0.03, 1e-4) == printed(below)


def test_V3_tends_to_V1_for_a_shallow_source_and_never_overflows():
    assert analytical_solutions.deep_source(RUBBER, 1e4, 1e-12, 0.03) == printed("2.7367215")
    z = np.array([0.0, 1e-5, 1e-3, 6e-3])
    assert analytical_solutions.deep_source(RUBBER, 1e4, 1e-9, 0.03, z) == pytest.approx(
        analytical_solutions.constant_flux(RUBBER, 1e4, 0.03, z), rel=2e-4
    )


@pytest.mark.parametrize(
    ("q", "other", "tau", "value"),
    [
        (1e4, 1e4, 0.01, "8003.347205"),
        (1e4, 1e5, 0.01, "10462.565551"),
        (1e3, 1e5, 0.003, "1913.655880"),
    ],
)
def test_V4_kernel(q, other, tau, value):
    assert analytical_solutions.persson_kernel(2 * q, 2 * other, DR, tau) == printed(value)


def test_V4_limits_and_step_response():
    assert analytical_solutions.persson_step(2e4, 2e5, DR, 0.01) == printed("127.3120125")
    assert analytical_solutions.persson_kernel(2e4, 2e5, DR, 0.0) == pytest.approx(2e4 * 2e5 / 2.2e5, rel=1e-12)
    late = 1e6 * sqrt(DR * 1.0)  # 350: beyond the switch to the asymptotic series
    assert analytical_solutions.persson_kernel(1e6, 1e6, DR, 1.0) == pytest.approx(
        1 / sqrt(pi * DR) * (1 - late**-2), rel=1e-9
    )
    series, closed = (
        float(analytical_solutions.persson_kernel(y / sqrt(DR), y / sqrt(DR), DR, 1.0)) for y in (300.001, 299.999)
    )
    assert series == pytest.approx(closed, rel=1e-9)  # no step where the series takes over


def test_V5_two_half_spaces():
    assert analytical_solutions.contact_flux(RUBBER, ROAD, 40.0, 1e4, 0.01) == printed("98973.7762")
    assert analytical_solutions.contact_flux(RUBBER, ROAD, 40.0, inf, 0.01) == printed("108665.688")
    assert 20.0 + analytical_solutions.contact_temperature(RUBBER, ROAD, 40.0) == printed("33.0299170")


def test_conductance_of_a_contact_at_rest():
    """Barber's relation for 0.75 MPa on heights of 4.5 um decay, E* = 13.3 MPa; theory.md, section 2.7."""
    assert analytical_solutions.resting_conductance(RUBBER, ROAD, 13.3e6, 0.75e6, 4.5e-6) == printed("5012.5313")


def test_V6_interface_source():
    J, TR, TS = analytical_solutions.shared_source(RUBBER, ROAD, 1e5, 1e4, 0.05)
    assert printed("59411.6287") == J
    assert printed("9.57365315") == TS
    assert printed("15.5148160") == TR
    J, TR, TS = analytical_solutions.shared_source(RUBBER, ROAD, 1e5, inf, 0.05)
    assert printed("0.674252074") == J / 1e5
    assert printed("11.5089746") == TR == TS


@pytest.mark.parametrize(
    ("m", "joined", "resisted"),
    [
        (2e4, "49696.5773", "42549.1842"),
        (2e5, "64735.4675", "55934.7523"),
        (2e6, "67153.5709", "58247.9169"),
    ],
)
def test_V7_deep_and_interface_source(m, joined, resisted):
    def flux(alpha):
        return analytical_solutions.shared_deep_source(RUBBER, ROAD, 5e4, 5e4, 1 / m, alpha, 0.01)

    assert flux(inf) == printed(joined)
    assert flux(2e4) == printed(resisted)
    assert flux(1e9) == pytest.approx(flux(inf), rel=1e-4)  # the two branches are one solution


def test_V7_surface_rise():
    assert analytical_solutions.shared_deep_rise(RUBBER, ROAD, 5e4, 5e4, 1 / 2e4, 0.01) == printed("3.60251898")


def test_V8_uniform():
    assert analytical_solutions.road_rise(ROAD, 0.1, 7.5e4, L / 2) == printed("20.241636")
    assert analytical_solutions.road_rise(ROAD, 0.1, 7.5e4, L) == printed("28.625996")
    mean, _ = quad(lambda x: analytical_solutions.road_rise(ROAD, 0.1, 7.5e4, x) / L, 0, L)
    assert mean == printed("19.083997")


def test_V8_linear():
    assert analytical_solutions.road_rise_linear(ROAD, 0.1, 7.5e4, L, L / 2) == printed("13.494424")
    assert analytical_solutions.road_rise_linear(ROAD, 0.1, 7.5e4, L, L) == printed("9.541999")


def test_V8_exponential():
    top = minimize_scalar(
        lambda x: -analytical_solutions.road_rise_exponential(ROAD, 0.1, 7.5e4, 5e-3, x),
        bounds=(1e-3, 1e-2),
        options={"xatol": 1e-12},
    )
    assert -top.fun == printed("6.926413")
    assert top.x * 1e3 == pytest.approx(4.27016, abs=1e-5)
    assert analytical_solutions.road_rise_exponential(ROAD, 0.1, 7.5e4, 5e-3, L) == printed("3.312173")


def test_V8_any_profile_agrees_with_the_three_closed_ones():
    laws = {
        lambda x: 7.5e4: analytical_solutions.road_rise(ROAD, 0.1, 7.5e4, 0.01),
        lambda x: 7.5e4 * (1 - x / L): analytical_solutions.road_rise_linear(ROAD, 0.1, 7.5e4, L, 0.01),
        lambda x: 7.5e4 * np.exp(-x / 5e-3): analytical_solutions.road_rise_exponential(ROAD, 0.1, 7.5e4, 5e-3, 0.01),
    }
    for law, closed in laws.items():
        assert analytical_solutions.road_rise_by_quadrature(ROAD, 0.1, law, 0.01) == pytest.approx(closed, rel=1e-11)


def test_V8_wake_and_wall():
    assert analytical_solutions.road_wake(ROAD, 0.1, 7.5e4, L, L + 0.1) == printed("6.757681")
    assert analytical_solutions.isothermal_wall_coefficient(ROAD, 0.1, L) == printed("3335.8827")


@pytest.mark.parametrize(
    ("decay", "proportional", "uniform"),
    [(0.05, "2.97250", "0.297"), (0.1, "2.10203", "0.420"), (0.2, "1.50116", "0.587")],
)
def test_V8_weighted_means_of_an_exponential_pressure(decay, proportional, uniform):
    share = (1 - np.exp(-1 / decay)) * decay
    even = analytical_solutions.road_rise(ROAD, 1.0, 1.0, 1.0) * 2 / 3
    hot, _ = quad(
        lambda u: (
            2 * u * np.exp(-u * u / decay) * analytical_solutions.road_rise_exponential(ROAD, 1.0, 1.0, decay, u * u)
        ),
        1e-12,
        1,
    )
    flat, _ = quad(
        lambda u: 2 * u * np.exp(-u * u / decay) * analytical_solutions.road_rise(ROAD, 1.0, 1.0, u * u), 0, 1
    )
    assert hot / share**2 / even == printed(proportional)
    assert flat / share / even == printed(uniform)


@pytest.mark.parametrize(
    ("peclet", "peak", "place", "middle"),
    [
        (0.1, "0.691254", "-0.243531", "0.685248"),
        (1, "3.115990", "-0.666447", "2.714074"),
        (10, "10.948443", "-0.924381", "8.023985"),
        (100, "35.322929", "-0.987675", "25.097557"),
    ],
)
def test_V9_jaeger(peclet, peak, place, middle):
    X = analytical_solutions.jaeger_strip_peak(peclet)
    assert [printed(place), printed(peak), printed(middle)] == [
        X,
        analytical_solutions.jaeger_strip(peclet, X),
        analytical_solutions.jaeger_strip(peclet, 0.0),
    ]


def test_V9_trailing_edge():
    assert analytical_solutions.jaeger_strip(1.0, -1.0) == printed("2.750090")
    assert analytical_solutions.jaeger_strip(1e6, -1.0) == pytest.approx(sqrt(4 * pi * 1e6), rel=1e-3)


def test_V10_build_up():
    assert printed("1.2204156216") == analytical_solutions.SPOT_OVERLAP_INTEGRAL
    assert [analytical_solutions.flash_build_up(r) for r in (0.1, 0.2, 0.3, 0.5)] == [
        printed("0.49625100"),
        printed("0.67085638"),
        printed("0.78405522"),
        printed("0.91739593"),
    ]
    assert brentq(lambda r: analytical_solutions.flash_build_up(r) - 1 + 1 / e, 0.01, 0.9) == printed("0.17328353")
    assert quad(lambda s: 2 * s * (1 - analytical_solutions.flash_build_up(s * s)), 0, 1)[0] == printed("0.17368569")
    assert quad(analytical_solutions.spot_overlap, 0, 1)[0] == printed("0.42441318")
    assert quad(analytical_solutions.spot_overlap, 0, 0.3419)[0] / quad(analytical_solutions.spot_overlap, 0, 1)[
        0
    ] == pytest.approx(0.632, abs=1e-3)


def test_V10_V11_functions_of_the_kernels():
    r = np.array([0.0, 1e-6, 0.013, 0.1, 0.5, 0.99, 1.0, 2.0])
    assert [heat_kernels.overlap_integral(v) / heat_kernels.FULL_OVERLAP_INTEGRAL for v in r] == pytest.approx(
        analytical_solutions.flash_build_up(r).tolist(), rel=1e-9, abs=1e-15
    )
    assert pytest.approx(analytical_solutions.SPOT_OVERLAP_INTEGRAL, rel=1e-10) == heat_kernels.FULL_OVERLAP_INTEGRAL
    assert heat_kernels.disc_overlap(r) == pytest.approx(analytical_solutions.spot_overlap(r), abs=1e-15)
    for depth in (1e-6, 1e-5, 1e-4, 1e-3):
        share = analytical_solutions.spot_flash_deep(RUBBER, 1e4, depth, 3e-3, 0.1) / analytical_solutions.spot_flash(
            RUBBER, 1e4, 3e-3, 0.1
        )
        assert heat_kernels.flash_response(sqrt(DR * 0.03) / depth) == pytest.approx(share, rel=1e-8)


@pytest.mark.parametrize("kappa", [1e-3, 0.3, 3.0, 100.0, 1e4])
@pytest.mark.parametrize("r", [1e-6, 1e-3, 0.1, 0.99])
def test_V10_V11_flash_of_heat_in_depth_builds_up_with_the_slid_distance(kappa, r):
    """Both integrals of eq. (13) end where the spot has slid r of its diameter; here by adaptive quadrature."""
    nodes = [min(1.0 / kappa, 0.5 * sqrt(r))]
    deep = quad(
        lambda s: 2 * s * analytical_solutions.spot_overlap(s * s) * erfcx(kappa * s), 0, sqrt(r), epsabs=0, epsrel=1e-11,
        limit=200, points=nodes,
    )[0]  # fmt: skip
    flux = analytical_solutions.SPOT_OVERLAP_INTEGRAL * analytical_solutions.flash_build_up(np.array([r]))[0]
    assert heat_kernels.flash_response(kappa, r) == pytest.approx(kappa * sqrt(pi) * deep / flux, rel=1e-7)


def test_V11_spot_flash():
    assert printed("0.6885457813") == analytical_solutions.SPOT_OVERLAP_INTEGRAL / sqrt(pi)
    assert analytical_solutions.spot_flash(RUBBER, 1e4, 3e-3, 0.1) == printed("1.669969")
    assert analytical_solutions.spot_flash(RUBBER, 1e4, 3e-3, 1.0) == printed("0.528091")
    assert analytical_solutions.spot_flash_deep(RUBBER, 1e4, 1e-9, 3e-3, 0.1) == pytest.approx(
        analytical_solutions.spot_flash(RUBBER, 1e4, 3e-3, 0.1), rel=1e-4
    )


@pytest.mark.parametrize(
    ("v", "values"),
    [(0.1, ("0.0621730", "0.5204540", "1.4073459")), (1.0, ("0.00623877", "0.0605060", "0.3243325"))],
)
def test_V11_weighted_flash(v, values):
    found = [analytical_solutions.spot_flash_weighted(RUBBER, 1e4, q, 3e-3, v) for q in (1e3, 1e4, 1e5)]
    assert found == [printed(text) for text in values]


def test_V12_stripes_and_the_closure_they_test():
    duty = (0.05, 0.1, 0.2, 0.3, 0.5)
    values = ("0.12701891", "0.15553895", "0.17201627", "0.16615538", "0.12625818")
    assert [analytical_solutions.periodic_flux_excess(d) for d in duty] == [printed(v) for v in values]
    assert analytical_solutions.periodic_flux_excess(1e-3) == pytest.approx(
        4 / (3 * sqrt(pi)) * sqrt(1e-3) - 0.82391680 * 1e-3, rel=1e-4
    )
    stripe = quad(lambda s: 2 * (1 - s * s), 0, 1)[0] / sqrt(pi)  # overlap of stripes: 1 - w
    ratio = [analytical_solutions.periodic_flux_excess(d) / ((1 - d) * stripe * sqrt(d)) for d in (0.2, 0.05)]
    assert ratio == pytest.approx([0.64, 0.79], abs=0.005)


def test_V13_slab():
    assert analytical_solutions.slab_heating(RUBBER, 7e-3, 1e3, 100.0) == printed("15.8553540")
    assert analytical_solutions.slab_heating(RUBBER, 7e-3, 1e3, 100.0, 7e-3) == printed("2.8167688")
    assert analytical_solutions.constant_flux(RUBBER, 1e3, 100.0) == printed("15.8004687")
    z = np.array([0.0, 1e-4, 5e-4])
    assert analytical_solutions.slab_heating(RUBBER, 7e-3, 1e3, 0.5, z) == pytest.approx(
        analytical_solutions.constant_flux(RUBBER, 1e3, 0.5, z), rel=1e-9
    )


def test_V14_cooling():
    assert analytical_solutions.half_space_cooling(RUBBER, 15.0, 10.0) == printed("0.92925248")
    zeta, C1, tau = analytical_solutions.slowest_slab_mode(RUBBER, 7e-3, 10.0)
    assert [zeta, C1, tau] == [printed("0.50568382"), printed("1.04233469"), printed("1563.609")]
    zeta, C1, tau = analytical_solutions.slowest_slab_mode(RUBBER, 7e-3, 20.0)
    assert [zeta, C1, tau] == [printed("0.68519350"), printed("1.07697471"), printed("851.647")]


def test_V14_slab_series_joins_its_two_limits():
    z = np.array([0.0, 2e-4, 5e-4])
    assert analytical_solutions.slab_cooling(RUBBER, 7e-3, 20.0, 0.5, z) == pytest.approx(
        analytical_solutions.half_space_cooling(RUBBER, 20.0, 0.5, z), rel=1e-9
    )
    _, C1, tau = analytical_solutions.slowest_slab_mode(RUBBER, 7e-3, 20.0)
    assert analytical_solutions.slab_cooling(RUBBER, 7e-3, 20.0, 1000.0, 7e-3) == pytest.approx(
        C1 * np.exp(-1000.0 / tau), rel=1e-9
    )


def test_V15_scaling():
    assert analytical_solutions.speed_scaling(0.5, 0.1) == printed("2.236068")
    assert analytical_solutions.speed_scaling(1.0, 0.1) == printed("3.162278")


def test_V16_road_driven():
    assert analytical_solutions.approach_to_final_temperature(RUBBER, ROAD, L, 0.2, 3.5) == printed("0.899516")
    assert analytical_solutions.approach_to_final_temperature(RUBBER, ROAD, L, 0.2 / 3, 3.5) == printed("0.726663")


def test_V17_wear():
    assert analytical_solutions.abrasion_relaxation(1.4e9, 6e-11, 3.5) == printed("0.745276")
    assert analytical_solutions.abrasion_relaxation(1.4e9, 6e-11, 35.0) == printed("0.0528657")
    assert analytical_solutions.abrasion_relaxation(1.4e9, 6e-11, 11.904762) == pytest.approx(1 / e, rel=1e-7)
    assert analytical_solutions.abrasion_depth(6e-11, 0.25e6, 35.0) * 1e6 == printed("525.0")


@pytest.mark.parametrize(
    ("diameter", "values"),
    [
        (1e-3, ("0.643900", "0.831310", "0.880001")),
        (3e-3, ("0.873593", "0.943175", "0.959793", "0.627983", "0.285212")),
        (1e-2, ("0.961854", "0.982933", "0.987931")),
    ],
)
def test_V23_lane_factor(diameter, values):
    speeds = (0.1, 0.5, 1.0, 0.01, 0.001)
    assert [analytical_solutions.lane_factor(DS, diameter, L / v) for v in speeds[: len(values)]] == [
        printed(v) for v in values
    ]


def test_V23_retained_is_the_mean_over_depth_of_the_lanes_effect():
    """R(tau) by Bessel functions, and by the overlap of discs under the Gaussian that heat of this age shows in depth."""
    edges = 3e-3 * np.linspace(0.0, 1.0, 20001)
    [factor] = lanes.Lanes().heat(SimpleNamespace(spot_diameter=3e-3), None)
    overlap = factor.law(None, SimpleNamespace(covered=0.0), SimpleNamespace(lane_widening=1.0), edges)
    middle = 0.5 * (edges[1:] + edges[:-1])
    assert analytical_solutions.lane_retained(DS, 3e-3, 0.25) == printed("0.748847666")
    short = 1 - 2 / sqrt(pi) * sqrt(DS * 1e-4) / 3e-3
    assert analytical_solutions.lane_factor(DS, 3e-3, 1e-4) == pytest.approx(short, abs=1e-5)
    for t in (1e-4, 0.025, 0.25, 2.0):
        kept = 1.0 + np.diff(overlap) @ np.exp(-(middle**2) / (4 * DS * t))
        assert kept == pytest.approx(analytical_solutions.lane_retained(DS, 3e-3, t), abs=1e-7)


def test_a_lane_never_falls_below_the_mean_of_the_road():
    [factor] = lanes.Lanes().heat(SimpleNamespace(spot_diameter=3e-3), None)
    for phi in (0.2, 1.0):
        now, p = SimpleNamespace(covered=phi), SimpleNamespace(lane_widening=1.0)
        assert factor.law(None, now, p, np.array([0.0, 1.0])) == pytest.approx([1.0, phi])
