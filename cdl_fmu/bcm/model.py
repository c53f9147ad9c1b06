"""The BCM model: records, checks and step."""

from __future__ import annotations

import math

from ..contact import (
    LEAST_CAMBER_COSINE,
    SLIP_FLOOR,
    anchor_here,
    lowest_point,
    show,
)
from ..frames import cross, dot
from ..slave.interface import ENVIRONMENT, TESTED, contact_jacobian, diagnostics, patch_in, wheel_active, wheel_pose, wheel_wrench
from ..slave.kernel import kernel
from ..slave.model import KernelModel, Rule
from ..slave.pool import ConstantPool
from ..slave.records import Choice, Real, Record
from ..soil import BEARING_RULES, RHO_RULE, SOIL
from ..strength import STRENGTH, STRENGTHS
from ..terrain.follow import TAU_N
from ..terrain.stand import (
    GROUND,
    STAND_EVENTS,
    check_grounds,
    ground_pool,
    initialise_flat,
    initialise_planes,
    stand_state,
    step_on_flat,
    step_on_mesh,
    step_on_patches,
)
from ..terramechanics import bekker_modulus, flow_value, slip_ratio, travel_speed
from ..unloading import UNLOADING, unloading_of
from ..wheel import WHEEL, WHEEL_RULES
from . import loads
from .soil import Soil

_LOCAL_STRESS = Rule(
    "normal_model = wong_reece: with compaction the stress is that of the local depth; use bekker", lambda p: p.normal_model == 2.0
)


class BCM(KernelModel):
    """Bekker based contact model: wheels in sand whose ground is one plane a wheel.

    Bekker's normal stress (8.5) and a shear stress by shear velocity (8.6), limited by Mohr and Coulomb (8.7), are integrated
    over the rim between the entry and the exit angle; grousers and wheel sides bear Rankine's passive earth pressure (8.8). With
    ``strength`` = critical_state soil below the rim loses strength as it is sheared and pushed along, and the wheel sinks by its slip.

    Known limit: the exit angle follows the rim's speed even where the wheel stands still, so on soil with almost no friction
    (phi below 0.05 rad) a spinning wheel is pushed backwards and the contact gives up to 1 W; from 0.2 rad on it only takes power.

    Args:
        n_wheels: Number of wheels.
        n_patches: 0 for flat ground at ``ground_z``, or n_wheels: patch i is the ground of wheel i, and its contact plane is fitted
            in it as in Fig. 8.4.
        n_compacted: 0, or n_patches: the patches say what pressed the soil before, and the wheels feel it.
        n_grounds: 1 if the ground is a mesh, in which the contact plane is fitted alike.
    """

    parameters = (
        ENVIRONMENT
        | SOIL
        | WHEEL
        | STRENGTH
        | UNLOADING
        | Record(
            ground_z=Real(0.0, "m", "Height of the undeformed ground; sinkage counts from it, on a patch too", min=-1e6, max=1e6),
            eta=Real(0.5, "1", "Least ratio of exit to entry angle, reached when driving", min=0.0, max=1.0),
            V_theta=Real(0.01, "m/s", "Speed over which the exit angle falls from the entry angle to eta of it", min=1e-6, max=100.0),
            V_j=Real(0.05, "m/s", "Shear velocity that mobilises 63 % of the shear strength", min=1e-6, max=100.0),
            V_j_mode=Choice("Shear velocity scale", constant="V_j at every speed", mapped="shear displacement since entry, by K"),
            normal_model=Choice("Normal stress over the rim", bekker="Bekker at local sinkage", wong_reece="two parts, 0 at the exit"),
            c_1=Real(0.43, "1", "Angle of the largest normal stress / entry angle at slip 0; used by wong_reece", min=0.0, max=0.95),
            c_2=Real(0.32, "1", "Its increase with slip; used by wong_reece", min=-0.95, max=0.95),
            strength=STRENGTHS.starting_with("plates"),
            c_d=Real(1.9, "s/m", "Normal damping: stress grows by this times the sinking speed (1.9: 28 % of critical)", min=0.0, max=1e3),
            kappa_q=Real(0.0, "1", "Share of the rim's pressure that surcharges grouser faces and sides", min=0.0, max=1.0),
            tau_n=TAU_N,
        )
    )
    rules = (
        *BEARING_RULES,
        RHO_RULE,
        Rule(
            "slope = {p.slope:g} rad: steeper than the soil's friction holds, phi = {p.phi:.4g} rad; use at most {p.phi:.4g} rad",
            lambda p: p.slope > p.phi,
        ),
        *WHEEL_RULES,
    )
    events = STAND_EVENTS

    def __init__(self, n_wheels: int = 1, n_patches: int = 0, n_compacted: int = 0, n_grounds: int = 0):
        check_grounds(n_wheels, n_patches, n_grounds)
        if n_compacted not in (0, n_patches):
            raise ValueError(
                f"n_compacted = {n_compacted}: choose 0 or n_patches, which is {n_patches}: all patches carry compaction, or none"
            )
        super().__init__(n_wheels=n_wheels, n_patches=n_patches, n_compacted=n_compacted, n_grounds=n_grounds)
        sizes = {"p": n_patches, "c": n_compacted, "g": n_grounds}
        self.identifier = f"cdl_bcm_w{n_wheels}" + "".join(f"{letter}{size}" for letter, size in sizes.items() if size)
        self.inputs = wheel_pose(n_wheels) | wheel_active(n_wheels) | patch_in(n_patches, n_compacted > 0)
        self.state = stand_state(n_wheels, n_patches, n_grounds)
        self.outputs = wheel_wrench(n_wheels) | contact_jacobian(n_wheels) | diagnostics(n_wheels)
        self.initialise_kernel = initialise_planes if n_patches or n_grounds else initialise_flat
        if n_patches:
            self.step_kernel = step_on_patches(_contact, n_compacted > 0)
        else:
            self.step_kernel = (step_on_mesh if n_grounds else step_on_flat)(_contact)
        if n_grounds:
            self.files, self.needed_files, self.pool_class = GROUND, tuple(GROUND), ConstantPool
        if n_compacted:
            self.rules = (*BCM.rules, _LOCAL_STRESS)

    def make_pool(self, p, files) -> ConstantPool | None:
        return ground_pool(files) if self.sizes["n_grounds"] else None


@kernel
def _contact(p, wheel, patch, n_x, n_y, n_z, d, wrench, contact, shown):
    """Wrench, Jacobian and diagnostics of a wheel whose centre is d [m] above a plane with the normal n.

    Args:
        patch: What pressed the soil before, None where nothing did.
    """
    T = wheel.T
    a_x, a_y, a_z = T[1, 0], T[1, 1], T[1, 2]
    sin_g = dot(a_x, a_y, a_z, n_x, n_y, n_z)
    cos_g = math.sqrt(max(1.0 - sin_g * sin_g, LEAST_CAMBER_COSINE**2))
    x_x, x_y, x_z = cross(a_x, a_y, a_z, n_x, n_y, n_z)
    x_x, x_y, x_z = x_x / cos_g, x_y / cos_g, x_z / cos_g
    r_x, r_y, r_z = cross(x_x, x_y, x_z, a_x, a_y, a_z)
    v, w = wheel.v_0, wheel.w_0
    v_x = dot(v[0], v[1], v[2], x_x, x_y, x_z)
    v_a = dot(v[0], v[1], v[2], a_x, a_y, a_z)
    v_r = dot(v[0], v[1], v[2], r_x, r_y, r_z)
    w_x = dot(w[0], w[1], w[2], x_x, x_y, x_z)
    w_a = dot(w[0], w[1], w[2], a_x, a_y, a_z)
    w_r = dot(w[0], w[1], w[2], r_x, r_y, r_z)
    travel = travel_speed(v_x, p.r_w * w_a)
    slip = slip_ratio(v_x, p.r_w * w_a, SLIP_FLOOR)

    r = wheel.r_0
    x_0, y_0 = (r[0], x_x, a_x, r_x), (r[1], x_y, a_y, r_y)
    soil = Soil(bekker_modulus(p.k_c, p.k_phi, p.b_w), p.n, unloading_of(p), TESTED * p.b_w, p.r_w, x_0, y_0)
    tan_phi = math.tan(p.phi)
    N_phi = flow_value(p.phi)
    toothed = p.n_g > 0.0 and p.h_g > 0.0
    r_tip = p.r_w + p.h_g if toothed else p.r_w
    r_s = loads.shear_radius(p, N_phi)
    fx, fa, fr, mx, ma, mr, k_z, d_x, d_y, d_z, thrust, strength, first, last = loads.rim(
        p, soil, patch, tan_phi, r_s, d, sin_g, cos_g, v_x, v_a, v_r, w_x, w_a, w_r, travel, slip
    )
    if toothed:
        angle = math.atan2(-dot(T[2, 0], T[2, 1], T[2, 2], x_x, x_y, x_z), dot(T[2, 0], T[2, 1], T[2, 2], r_x, r_y, r_z))
        thrust_left = max(0.0, strength * r_tip / p.r_w - abs(thrust))
        gx, ga, gr, nx, na, nr, kz, ex, ey, ez = loads.grousers(
            p, soil, patch, tan_phi, N_phi, r_s, d, sin_g, cos_g, v_x, v_a, v_r, w_x, w_a, w_r, travel, angle, thrust_left
        )
        fx, fa, fr, mx, ma, mr = fx + gx, fa + ga, fr + gr, mx + nx, ma + na, mr + nr
        k_z, d_x, d_y, d_z = k_z + kz, d_x + ex, d_y + ey, d_z + ez
    sa, sx, sr, sy = loads.sides(p, soil, patch, N_phi, d, sin_g, cos_g, v_x, v_a, w_x, w_a, w_r, travel)
    fa, mx, mr, d_y = fa + sa, mx + sx, mr + sr, d_y + sy

    weight = wheel.active
    fx, fa, fr, mx, ma, mr = weight * fx, weight * fa, weight * fr, weight * mx, weight * ma, weight * mr
    f, m = wrench.f_0, wrench.t_0
    f[0], f[1], f[2] = fx * x_x + fa * a_x + fr * r_x, fx * x_y + fa * a_y + fr * r_y, fx * x_z + fa * a_z + fr * r_z
    m[0], m[1], m[2] = mx * x_x + ma * a_x + mr * r_x, mx * x_y + ma * a_y + mr * r_y, mx * x_z + ma * a_z + mr * r_z
    y_x, y_y, y_z = cross(n_x, n_y, n_z, x_x, x_y, x_z)
    point = contact.point_0
    point[0], point[1], point[2] = r[0] - p.r_w * n_x, r[1] - p.r_w * n_y, r[2] - p.r_w * n_z
    axes = contact.axes
    axes[0, 0], axes[0, 1], axes[0, 2] = x_x, x_y, x_z
    axes[1, 0], axes[1, 1], axes[1, 2] = y_x, y_y, y_z
    axes[2, 0], axes[2, 1], axes[2, 2] = n_x, n_y, n_z
    contact.F[0] = fx
    contact.F[1] = fa * cos_g - fr * sin_g
    contact.F[2] = fa * sin_g + fr * cos_g
    contact.K[2] = weight * max(0.0, k_z)
    contact.D[0] = weight * d_x
    contact.D[1] = weight * d_y * cos_g * cos_g
    contact.D[2] = weight * max(0.0, d_z)
    contact.in_contact = 1.0 if d < r_tip * cos_g + 0.5 * p.b_w * abs(sin_g) else 0.0
    theta_1 = loads.entry_angle(p, d, cos_g)
    rear = loads.exit_share(p.eta, abs(travel), p.V_theta)
    entry, exit_ = math.copysign(theta_1, travel), -math.copysign(theta_1 * rear, travel)
    if patch is not None:  # the plane is above the floor, which is what the wheel touches
        contact.in_contact = 1.0 if contact.F[2] > 0.0 else 0.0
        entry, exit_ = (first, last) if travel >= 0.0 else (last, first)
    anchor_here(wheel, contact)
    show(wheel, p.ground_z - lowest_point(p, wheel), slip, entry, exit_, f, -ma, shown)
