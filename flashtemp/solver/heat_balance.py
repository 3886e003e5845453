"""The heat balance C dh/dt = Q of a scene: heat capacities, conductances, boundary heat and the energy ledger.

The state (theory.md, section 8) is the enthalpy rise h of every cell over rho c (K above ambient, equal to the
temperature rise while rho c is constant), the worn depth of every column under the block, and the ledger: energies in
J per metre across.  The integrator takes the same steps for all of them, so the ledger audits the integration itself.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from flashtemp.model.effect_laws import EffectLaws, has_pressure_shift, mean_over_columns
from flashtemp.model.scene import Scene
from flashtemp.physics.elastic_block import FaceCompliance, face_compliance, foundation_stiffness
from flashtemp.solver import kernels_2d
from flashtemp.solver.boundary_heat import BoundaryHeat
from flashtemp.solver.elastic_contact import PRESSURE_RTOL, ElasticFoundation
from flashtemp.solver.enthalpy import LinearCapacity, TabulatedCapacity, build_heat_capacity
from flashtemp.solver.road_frame import RoadFrame
from flashtemp.solver.winkler_foundation import SpringFoundation

LEDGER_ENTRIES = ("friction", "into_road", "lane_out", "lane_air")
LEDGER_WEIGHTS = {"friction": 1.0, "into_road": 0.0}  # by which entries add to the heat in block and road together
LANE_LEDGER_WEIGHTS = {"lane_out": -1.0, "lane_air": 1.0}  # of the lanes, times their fraction of the width
MIN_MODULUS_RATIO = 0.05  # lower limit of the modulus, which is linear in temperature
MEAN_PRESSURE_EFFECT_K = 20.0  # K: typical effect of a pressure change by the mean pressure, scale of the worn depth


class HeatBalance:
    """The constant part of the heat balance of a scene.

    `share` is the fraction of the width that a column of road cells stands for.  `pressure_rtol` is the tolerance of
    the elastic block's pressure, as a fraction of the load.
    """

    def __init__(self, scene: Scene, pressure_rtol: float = PRESSURE_RTOL):
        self.scene, mesh, self.pressure_rtol = scene, scene.mesh, pressure_rtol
        self.laws = EffectLaws(scene)
        self.n = mesh.n_cells
        rc, k = np.empty(mesh.n_plane), np.empty(mesh.n_plane)
        rc[mesh.block], k[mesh.block] = (
            scene.block_property("volumetric_capacity"),
            scene.block_property("conductivity"),
        )
        rc[mesh.road], k[mesh.road] = scene.road.volumetric_capacity, scene.road.conductivity
        self.capacity, self.conductivity = rc * mesh.volume, k
        along = np.where(mesh.level < mesh.n_road, 1.0, self.laws("block.conductivity_along", 1.0, None, None))
        self.half_x = mesh.width / (2 * k * along * mesh.thickness)
        self.half_z = mesh.thickness / (2 * k * mesh.width)
        self.gap = np.zeros(mesh.n_plane)  # m K/W of a joint, between a cell and the one above
        for layer, cells in zip(scene.layers[:-1], mesh.layers, strict=False):
            below = mesh.block[:, cells.stop - 1]
            self.gap[below] = layer.contact_resistance / mesh.width[below]
        self.gx, self.gz = np.empty_like(self.half_x), np.empty_like(self.half_x)
        one = np.ones(mesh.n_plane)
        self.ones = one if mesh.n_across == 1 else np.broadcast_to(1.0, self.n)  # a broadcast takes no memory in 3D
        halves = self.half_x, self.half_z, self.gap
        kernels_2d.face_conductances(mesh.start, mesh.n_road, *halves, one, self.gx, self.gz)
        self.road_frame = RoadFrame.from_scene(scene, self.laws)
        self.g_in = 1.0 / self.half_x[: mesh.n_road] if self.road_frame is None else np.zeros(mesh.n_road)
        faces = mesh.x[1:]
        back = np.concatenate([[mesh.x[0]], mesh.x_centre[:-1]])
        self.upwind_weight = (faces - mesh.x_centre) / (mesh.x_centre - back)
        self.areal_capacity = scene.road.volumetric_capacity * mesh.thickness[: mesh.n_road]  # rho c dz, J/(m2 K)
        self.no_inflow = np.zeros(mesh.n_road * mesh.n_across)
        self.cell_block = mesh.everywhere(mesh.block[:, 0]).ravel()
        self.deepest_road_cells = mesh.start[mesh.first : mesh.last].copy()  # of a plane, on lines under the block
        self.cell_road = mesh.everywhere(mesh.road[mesh.first : mesh.last, -1]).ravel()
        self.half_block = np.full(len(self.cell_block), mesh.height[1] / (2 * scene.block.conductivity))
        self.half_road = np.full(len(self.cell_road), mesh.depth[1] / (2 * scene.road.conductivity))
        self.outflow_cells = [mesh.road[i].copy() for i in (0, -2, -1)]  # first, last but one and last line
        self.zero_columns = np.zeros(len(self.cell_block))
        self.volumetric = [d for d in self.laws.deposits if d.share > 0]
        self.depth_fraction = sum((d.share for d in self.volumetric), 0.0)
        self.deposit_weights, self.deep_cells = self._deposit_weights()
        self.share = self._reference_fraction()
        self.boundary = BoundaryHeat(scene, self.laws, k)
        self.ledger = LEDGER_ENTRIES + tuple(sorted(self.boundary.ledger_names() - set(LEDGER_ENTRIES)))
        self.worn = slice(self.n, self.n + len(self.cell_block))
        self.ledger_index = {name: self.worn.stop + i for i, name in enumerate(self.ledger)}
        self.ledger_slice = slice(self.worn.stop, self.worn.stop + len(self.ledger))
        self.size = self.ledger_slice.stop
        stiffness = scene.stiffness or foundation_stiffness(scene.length, scene.height, scene.modulus)
        self.foundation = SpringFoundation(mesh.column_x, mesh.column_area, scene.length, stiffness)
        # one unit of worn depth changes the contact about as much as 1 K does, so one absolute tolerance serves all
        self.worn_unit = max(scene.schedule.pressure.value) / (MEAN_PRESSURE_EFFECT_K * stiffness)
        self.abrades = self.laws.has_law("block.abrasion")
        self.expansion = self.laws("block.expansion", 0.0, None, None)

    def _reference_fraction(self) -> float:
        """phi_ref (theory.md, section 1.7): the contact fraction at the highest mean pressure.

        Columns of road cells stand for this constant fraction of the width.  They take all heat that the block loses,
        whatever the local contact fraction is (`ContactState.road_coverage`).
        """
        schedule, mesh = self.scene.schedule, self.scene.mesh
        now = self.scene.law_context(schedule.phases[0], 0.0)
        pressure = np.full(len(mesh.column_x), max(schedule.pressure.value))
        now = now.under_block(mesh, local_pressure=pressure)
        phi = float(np.mean(np.clip(self.laws("contact.spot_fraction", 0.0, None, now), 1e-6, 1.0)))
        return phi + self.laws("contact.resolved", 0.0, None, now) * (1.0 - phi)

    def _deposit_weights(self) -> tuple[np.ndarray, np.ndarray]:
        """Exact cell means of the decaying heat sources, eq. (7), and their cells; normalised to the block's height."""
        mesh = self.scene.mesh
        weight = np.zeros(mesh.n_block)
        for d in self.volumetric:
            inside = -np.diff(np.exp(-mesh.height / d.depth))
            weight += d.share * inside / inside.sum()
        weight /= max(self.depth_fraction, 1e-300)
        used = np.flatnonzero(weight > 1e-18)
        weight = weight[: used[-1] + 1 if len(used) else 0].copy()
        deep = mesh.everywhere(mesh.block[:, : len(weight)])
        return weight, np.ascontiguousarray(np.swapaxes(deep, 1, 2)).reshape(len(self.cell_block), -1)

    @cached_property
    def is_contact_static(self) -> bool:
        """Whether pressure and contact laws depend on position and schedule only: not on wear, temperature or tilt."""
        coupled = ("holder.compliance", "contact.shear_traction", "contact.cover")
        constant = self.laws.base_contact_only and not self.laws.contact_varies
        return constant and not (
            self.abrades or self.expansion or self.scene.modulus_slope or any(map(self.laws.has_law, coupled))
        )

    @cached_property
    def elastic_block(self) -> ElasticFoundation | None:
        """The contact of an elastic block; None on springs, and where nothing changes the prescribed pressure."""
        if self.scene.stiffness is not None or not has_pressure_shift(self.laws):
            return None
        bed, modulus = self.foundation, self.scene.modulus
        return ElasticFoundation(
            bed.x, bed.dx, bed.length, modulus, bed.stiffness, self._face_compliance, self.pressure_rtol
        )

    @cached_property
    def _face_compliance(self) -> FaceCompliance:
        """Compliance of the face: of all columns in 3D, or of one plane in plane strain."""
        mesh, whole = self.scene.mesh, self.scene.elastic_3d and self.scene.resolved
        edges = mesh.x[mesh.first : mesh.last + 1]
        return face_compliance(edges, mesh.height, self.scene.poisson, mesh.y if whole else None)

    @cached_property
    def nonlinear_conductivity(self) -> bool:
        return self.laws.has_law("block.conductivity") or self.laws.has_law("road.conductivity")

    @cached_property
    def heat_capacity(self) -> LinearCapacity | TabulatedCapacity | None:
        """c/c0 of the cells over temperature, or None where it is constant."""
        return build_heat_capacity(self.scene, self.laws)

    def ledger_weight(self, name: str) -> float:
        """Weight with which a ledger entry adds to the heat in block and road together."""
        return self.share * LANE_LEDGER_WEIGHTS[name] if name in LANE_LEDGER_WEIGHTS else LEDGER_WEIGHTS.get(name, 1.0)

    def temperature_rise(self, h: np.ndarray) -> np.ndarray:
        """Temperature rise (cells,) K of an enthalpy rise h.  Raises SolverFailure where c is not positive."""
        return h if self.heat_capacity is None else self.heat_capacity.temperature_rise(h)

    def enthalpy_rise(self, rise: np.ndarray) -> np.ndarray:
        """Enthalpy rise K of temperature rises, the inverse of `temperature_rise`; also of the first cells only."""
        return rise if self.heat_capacity is None else self.heat_capacity.enthalpy_rise(rise)

    def capacity_ratio(self, rise: np.ndarray) -> np.ndarray:
        """dh/dT (cells,) at temperature rises."""
        return self.ones if self.heat_capacity is None else self.heat_capacity.capacity_ratio(rise)

    @cached_property
    def initial_depth(self) -> np.ndarray:
        """Depth (columns,) in m worn before the first start."""
        now = self.scene.law_context(self.scene.schedule.phases[0], 0.0)
        return mean_over_columns(self.laws, "block.worn", self.scene.mesh, now, 0.0, has_kinks=True)

    def initial_state(self) -> np.ndarray:
        """State (size,) before the first start: all cells at ambient temperature, the block worn by `initial_depth`."""
        y = np.zeros(self.size)
        y[self.worn] = self.initial_depth / self.worn_unit
        return y

    def worn_depth(self, y: np.ndarray) -> np.ndarray:
        """Worn depth (columns,) in m of a state."""
        return y[self.worn] * self.worn_unit

    def thermal_displacement(self, T: np.ndarray) -> np.ndarray:
        """T_exp of eq. (21): displacement (columns,) m of the free face towards the road at rises T (cells,).

        On springs every column expands by itself with its sides fixed (Boley and Weiner, Theory of Thermal Stresses,
        1960).  The elastic block follows Maysel's theorem.
        """
        mesh, poisson = self.scene.mesh, self.scene.poisson
        strain = self.expansion * mesh.planes(T)[mesh.block]  # lines, levels, across
        if self.elastic_block is None:
            confined = (1.0 + poisson) / (1.0 - poisson)
            return np.einsum("ijk,j->ik", strain, confined * np.diff(mesh.height)).ravel()
        thermal = self.elastic_block.compliance.thermal
        if thermal is None:  # not computed in three dimensions: the matrix would be too large
            thermal = face_compliance(mesh.x[mesh.first : mesh.last + 1], mesh.height, poisson).thermal
            assert thermal is not None
        n, planes = len(thermal), len(self.cell_block) // len(thermal)
        strain = np.swapaxes(strain, 1, 2) if planes == 1 else strain
        displacement: np.ndarray = thermal.reshape(n, -1) @ strain.reshape(-1, planes)
        return displacement.ravel()

    def relative_modulus(self, T: np.ndarray) -> Any:
        """Young's modulus at rises T (cells,) over that at ambient temperature, at the mean rise of the block."""
        slope, mesh, cells = self.scene.modulus_slope, self.scene.mesh, self.scene.mesh.block
        if slope == 0.0:
            return 1.0
        mean = (mesh.volume[cells] * (mesh.planes(T)[cells] @ mesh.share)).sum() / mesh.volume[cells].sum()
        factor = 1.0 + slope * mean
        return factor if np.real(factor) > MIN_MODULUS_RATIO else MIN_MODULUS_RATIO

    def advection_coefficient(self, now) -> np.ndarray:
        """rho c v dz (n_road,) W/(m K), by which heat moves from line to line; 0 for road in its own frame."""
        return self.areal_capacity * (now.speed if self.road_frame is None else 0.0)

    def road_heat(self, columns: np.ndarray) -> float:
        """Heat (J/m) of `columns` (..., n_road, n_across) of road, enthalpy rises in K, for lines of equal length."""
        mesh = self.scene.mesh
        return (self.capacity[mesh.road[0]] * (columns @ mesh.share)).sum()

    def stored_heat(self, y: np.ndarray) -> tuple[float, float]:
        """Heat in block and in road lanes above ambient, J per metre across."""
        mesh = self.scene.mesh
        E = self.capacity * (mesh.planes(y[: self.n]) @ mesh.share)
        return float(E[mesh.block].sum()), float(E[mesh.road].sum())
