"""BCM on flat ground: closed forms, symmetries and identities of its forces."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import beta

from cdl_fmu import BCM, Instance, load_soil, unloading
from cdl_fmu.bcm import loads
from cdl_fmu.bcm.soil import Soil
from cdl_fmu.frames import axis_rotation

SOIL = load_soil("mss_d")
R = B = 0.125
K_EQ = SOIL["k_c"] / B + SOIL["k_phi"]
BARE = dict(n_g=0, c_d=0)  # a smooth wheel without damping
FRICTIONLESS = BARE | dict(phi=0, c=0, rho=0)


def bcm(**parameters) -> Instance:
    instance = Instance(BCM(), **(SOIL | parameters))
    instance.initialise()
    return instance


def drive(instance, sinkage=0.0, v=(0, 0, 0), w=(0, 0, 0), T=None, r=None):
    """Force and torque on a wheel at this sinkage of its lowest rim point (upright) or with its centre at r."""
    wheel = instance.u.wheel[0]
    wheel.r_0[:] = (0.0, 0.0, R - sinkage) if r is None else r
    wheel["T"][:] = np.eye(3) if T is None else T
    wheel.v_0[:], wheel.w_0[:] = v, w
    instance.step(0.0, 1e-3)
    return instance.y.wheel[0].f_0.copy(), instance.y.wheel[0].t_0.copy()


def random_pose(rng):
    T = axis_rotation(2, rng.uniform(-3, 3)) @ axis_rotation(1, rng.uniform(-0.3, 0.3)) @ axis_rotation(3, rng.uniform(-3, 3))
    return dict(T=T, r=(*rng.uniform(-1, 1, 2), R - rng.uniform(0.005, 0.04)), v=rng.normal(0, 0.1, 3), w=rng.normal(0, 1, 3))


def test_rim_loads_of_the_reference_vector():
    """Values computed independently with a converged quadrature; rim alone, without side faces."""
    p = bcm(**BARE, eta=0.3, V_theta=0.01, V_j=0.01).arrays[0][0]
    soil = Soil(K_EQ, SOIL["n"], unloading.unloading_of(p), 0.0, R, (0.0,) * 4, (0.0,) * 4)
    out = loads.rim(p, soil, None, math.tan(SOIL["phi"]), R, R - 0.0288, 0.0, 1.0, 0.1, 0.01, 0.0, 0.0, 1.0, 0.0, 0.125, 0.2)
    fx, fa, fr, _, ma = out[:5]
    assert (fx, fa, fr, -ma) == pytest.approx((150.66545, -66.35109, 280.82908, 22.31559), rel=1e-5)


@pytest.mark.parametrize(
    ("gravity", "eta", "sinkage", "stiffness"),
    [
        (9.81, 1.0, 26.65e-3, 29506),
        (9.81, 0.5, 27.39e-3, 28784),
        (9.81, 0.3, 28.82e-3, 27382),
        (9.81, 0.0, 33.67e-3, 23311),
        (3.71, 1.0, 19.22e-3, 15509),
        (3.71, 0.5, 19.76e-3, 15107),
        (3.71, 0.3, 20.80e-3, 14363),
        (3.71, 0.0, 24.26e-3, 12267),
    ],
)
def test_rest_sinkage_and_stiffness_of_the_reference_wheel(gravity, eta, sinkage, stiffness):
    """27 kg a wheel, normal stress alone; moving forwards, so that the exit angle is reduced to eta."""
    wheel = bcm(**FRICTIONLESS, eta=eta)
    rest = brentq(lambda z: drive(wheel, z, v=(1.0, 0, 0))[0][2] - 27 * gravity, 1e-3, 0.1)
    assert rest == pytest.approx(sinkage, rel=5e-4)
    drive(wheel, rest, v=(1.0, 0, 0))
    assert wheel.y.contact[0].K[2] == pytest.approx(stiffness, rel=2e-3)


def test_a_wheel_at_rest_sinks_symmetrically_whatever_eta():
    wheel = bcm(**BARE, eta=0.3)
    rest = brentq(lambda z: drive(wheel, z)[0][2] - 27 * 9.81, 1e-3, 0.1)
    assert rest == pytest.approx(26.65e-3, rel=5e-4)
    force, _ = drive(wheel, rest)
    shown = wheel.y.diagnostics[0]
    assert shown.theta_exit == -shown.theta_entry
    assert force[0] == pytest.approx(0.0, abs=1e-9)


def test_shallow_sinkage_follows_the_beta_form():
    wheel = bcm(**FRICTIONLESS, eta=1)
    z, n = 0.02 * 2 * R, SOIL["n"]
    closed = B * K_EQ * math.sqrt(2 * R) * beta(n + 1, 0.5) * z ** (n + 0.5)
    assert drive(wheel, z)[0][2] == pytest.approx(closed, rel=0.01)


@pytest.mark.parametrize("z", [0.005, 0.02, 0.04])
def test_compaction_resistance_is_the_work_of_pressing_the_rut(z):
    """Energy: what the wheel loses per metre is b times the integral of p dz."""
    force, _ = drive(bcm(**FRICTIONLESS, eta=0), z, v=(1.0, 0, 0))
    n = SOIL["n"]
    assert -force[0] == pytest.approx(B * K_EQ * z ** (n + 1) / (n + 1), rel=1e-6)


def test_mapped_shear_velocity_is_the_displacement_form_in_steady_rolling():
    """Janosi and Hanamoto's shear stress over the shear displacement since entry, integrated along the rim."""
    z, K, omega = 0.02882, 0.02, 1.0
    wheel = bcm(**BARE, V_j_mode="mapped", K=K, eta=0.3)
    for s in (-0.2, 0.05, 0.2, 0.4, 0.7):
        force, _ = drive(wheel, z, v=((1 - s) * R * omega, 0, 0), w=(0, omega, 0))
        theta_1 = math.acos(1 - z / R)
        theta = np.linspace(-0.3 * theta_1, theta_1, 4001)
        sigma = K_EQ * (R * (np.cos(theta) - math.cos(theta_1))).clip(0) ** SOIL["n"]
        j = R * ((theta_1 - theta) - (1 - s) * (math.sin(theta_1) - np.sin(theta)))
        tau = (SOIL["c"] + sigma * math.tan(SOIL["phi"])) * np.sign(j) * (1 - np.exp(-np.abs(j) / K))
        reference = B * R * np.trapezoid(tau * np.cos(theta) - sigma * np.sin(theta), theta)
        assert force[0] == pytest.approx(reference, abs=1e-4 * force[2])


@pytest.mark.parametrize("axis", [0, 1])
def test_mirrored_motion_gives_the_mirrored_wrench(axis):
    """Left and right mirror exactly; so do fore and aft, as a wheel knows no forward."""
    wheel, rng = bcm(kappa_q=0.3), np.random.default_rng(1)
    S = np.diag([-1.0 if i == axis else 1.0 for i in range(3)])
    for _ in range(20):
        pose = random_pose(rng)
        force, torque = drive(wheel, **pose)
        mirrored = dict(T=S @ pose["T"] @ S, r=S @ pose["r"], v=S @ pose["v"], w=-S @ pose["w"])
        f, t = drive(wheel, **mirrored)
        assert f == pytest.approx(S @ force, abs=1e-9)
        assert t == pytest.approx(-S @ torque, abs=1e-9)


def test_rotation_about_the_vertical_rotates_the_wrench():
    wheel, rng = bcm(), np.random.default_rng(2)
    for _ in range(20):
        pose = random_pose(rng)
        force, torque = drive(wheel, **pose)
        Q = axis_rotation(3, rng.uniform(-3, 3)).T
        f, t = drive(wheel, T=pose["T"] @ Q.T, r=Q @ pose["r"], v=Q @ pose["v"], w=Q @ pose["w"])
        assert f == pytest.approx(Q @ force, abs=1e-9)
        assert t == pytest.approx(Q @ torque, abs=1e-9)


def test_contact_never_drives_the_wheel():
    """The soil takes power from any motion that does not rise from it."""
    wheel, rng = bcm(), np.random.default_rng(3)
    for _ in range(200):
        pose = random_pose(rng)
        pose["v"][2] = -abs(pose["v"][2])
        pose["w"][0] = 0.0
        force, torque = drive(wheel, **pose)
        assert force @ pose["v"] + torque @ pose["w"] <= 1e-9


def test_no_grousers_is_a_smooth_wheel():
    states = dict(sinkage=0.025, v=(0.08, 0.02, 0), w=(0, 1, 0.1))
    smooth, none = drive(bcm(n_g=0), **states), drive(bcm(h_g=0), **states)
    assert smooth == pytest.approx(np.array(none), abs=0)


def test_grousers_add_little_thrust_and_kappa_q_is_capped_by_the_soil():
    def pull(**parameters):
        return drive(bcm(c_d=0, t_g=0, **parameters), 0.0288, v=(0.05, 0, 0), w=(0, 1, 0))[0]

    smooth, toothed, loaded = pull(n_g=0), pull(n_g=12), pull(n_g=12, kappa_q=1)
    assert 0.0 < toothed[0] - smooth[0] < 0.1 * smooth[2]
    arc = 1.5 * math.acos(1 - 0.0288 / R)
    strength = B * (R + 0.01) * (SOIL["c"] * arc + math.tan(SOIL["phi"]) * smooth[2] * 1.2 / (B * R))
    assert toothed[0] < loaded[0] < strength


def test_grouser_force_is_continuous_over_a_turn():
    wheel = bcm(kappa_q=0.5)
    forces = [drive(wheel, 0.025, v=(0.1, 0.01, 0), w=(0, 1, 0), T=axis_rotation(2, a))[0] for a in np.linspace(0, 2 * math.pi / 12, 4001)]
    steps = np.abs(np.diff(forces, axis=0)).max()
    assert np.ptp(forces, axis=0)[2] > 0.1  # they are felt
    assert steps < 0.02 * np.ptp(forces, axis=0).max()
    assert forces[-1] == pytest.approx(forces[0], abs=1e-9)


def test_meeting_failure_wedges_shear_on_the_tips():
    """So many grousers that their wedges meet carry soil: shear acts at the tips, and the rim's speed counts there."""
    few = drive(bcm(**BARE | dict(n_g=12), t_g=0, rho=0, c=0), 0.02, w=(0, 1, 0))[1][1]
    many = drive(bcm(**BARE | dict(n_g=60), t_g=0, rho=0, c=0, V_j=1e-6), 0.02, w=(0, 1, 0))[1][1]
    full = drive(bcm(**BARE, t_g=0, rho=0, c=0, V_j=1e-6), 0.02, w=(0, 1, 0))[1][1]
    assert abs(few) < abs(many)
    assert many == pytest.approx(full * 1.08, rel=1e-3)


def test_sides_resist_a_sideways_wheel_by_rankine():
    """Locked wheel pushed sideways fast: the sides bear half gamma h^2 N along the sunk segment."""
    phi = SOIL["phi"]
    wheel = bcm(**BARE | dict(c=0, eta=1, V_j=1e-6))
    sideways = drive(wheel, 0.03, v=(0, 0.1, 0))[0]
    wheel = bcm(**BARE | dict(c=0, eta=1, V_j=1e-6, rho=0))
    rim_only = drive(wheel, 0.03, v=(0, 0.1, 0))[0]
    theta_1 = math.acos(1 - 0.03 / R)
    theta = np.linspace(-theta_1, theta_1, 4001)
    h = R * (np.cos(theta) - math.cos(theta_1))
    N_phi = math.tan(math.pi / 4 + phi / 2) ** 2
    closed = np.trapezoid(0.5 * SOIL["rho"] * 9.81 * h**2 * N_phi * R * np.cos(theta), theta)
    assert rim_only[1] - sideways[1] == pytest.approx(closed, rel=1e-4)
    assert -rim_only[1] == pytest.approx(math.tan(phi) * np.trapezoid(B * R * K_EQ * h ** SOIL["n"], theta), rel=1e-4)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_a_locked_wheel_creeps_under_a_lateral_load_by_the_velocity_law(share):
    """Without static friction the creep speed is -V_j ln(1 - load/strength)."""
    wheel = bcm(**BARE | dict(c=0, rho=0), V_j=0.02)
    strength = -drive(wheel, 0.025, v=(0, 100.0, 0))[0][1]
    speed = -0.02 * math.log(1 - share)
    assert -drive(wheel, 0.025, v=(0, speed, 0))[0][1] == pytest.approx(share * strength, rel=1e-9)


def test_yaw_meets_a_turning_moment():
    assert drive(bcm(), 0.025, v=(0.1, 0, 0), w=(0, 1, 0.5))[1][2] < -0.1


def test_camber_turns_the_wheel_upright_and_gives_no_force_along_the_ground():
    """Pressure that depends on depth alone has no resultant along the plane, and none about the axle."""
    wheel = bcm(**FRICTIONLESS, eta=1)
    T = axis_rotation(1, 0.1)  # the axle's left end is raised
    force, torque = drive(wheel, 0.025, T=T)
    assert force[:2] == pytest.approx((0, 0), abs=1e-9)
    assert (T @ torque)[1] == pytest.approx(0, abs=1e-9)
    assert torque[0] < 0.0  # the deeper, right edge is pushed up
    assert drive(wheel, 0.025)[0][2] == pytest.approx(force[2], rel=0.15)


def test_wong_reece_stress_vanishes_at_the_exit_and_bears_less_than_bekker():
    motion = dict(sinkage=0.025, v=(0.1, 0, 0), w=(0, 1, 0))
    both = [drive(bcm(**BARE, normal_model=model, eta=0.3), **motion)[0] for model in ("bekker", "wong_reece")]
    assert both[1][2] < both[0][2]
    p = bcm(**FRICTIONLESS, normal_model="wong_reece", eta=0, c_1=0, c_2=0)
    q = bcm(**FRICTIONLESS, eta=0)
    # With theta_m = theta_0 = 0 there is nothing behind the maximum: Bekker's law is left.
    assert drive(p, 0.025, v=(1, 0, 0))[0] == pytest.approx(drive(q, 0.025, v=(1, 0, 0))[0], rel=1e-4)


def test_separation_has_no_adhesion_and_sinking_is_damped():
    wheel = bcm()
    rest = drive(wheel, 0.02)[0][2]
    assert drive(wheel, 0.02, v=(0, 0, -0.1))[0][2] > 1.15 * rest
    assert drive(wheel, 0.02, v=(0, 0, 2.0))[0] == pytest.approx((0, 0, 0), abs=1e-9)
    lifted, torque = drive(wheel, -0.0101, v=(0.1, 0, 0), w=(0, 1, 0))
    assert not lifted.any() and not torque.any()
    assert wheel.y.contact[0].in_contact == 0.0


def test_diagnostics_of_a_driven_wheel():
    wheel = bcm(ground_z=1.0)
    T = axis_rotation(3, 0.3)
    v = T.T @ (0.1, 0.01, 0)
    force, torque = drive(wheel, v=v, w=T.T @ (0, 1.0, 0), T=T, r=(0, 0, 1.0 + R - 0.027))
    shown = wheel.y.diagnostics[0]
    heading = T @ force
    assert shown.sinkage == pytest.approx(0.027)
    assert shown.slip == pytest.approx(0.2)
    assert shown.slip_angle == pytest.approx(math.atan2(0.01, 0.1))
    assert (shown.drawbar_pull, shown.lateral_force, shown.normal_load) == pytest.approx(tuple(heading))
    assert shown.drive_torque == pytest.approx(-(T @ torque)[1]) and shown.drive_torque > 0
    assert shown.theta_entry == pytest.approx(math.acos(1 - 0.027 / R))
    assert shown.theta_exit == pytest.approx(-0.5 * shown.theta_entry, rel=1e-4)
    drive(wheel, v=T.T @ (-0.1, 0, 0), w=T.T @ (0, -0.125 / R, 0), T=T, r=(0, 0, 1.0 + R - 0.027))
    assert shown.slip == pytest.approx(0.2)
    assert shown.theta_entry < 0 < shown.theta_exit
