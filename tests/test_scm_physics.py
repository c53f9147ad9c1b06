"""SCM under one wheel: closed forms, signs, memory, energy."""

import math

import numpy as np
import pytest
from bodies import Bodies, plate
from soil import ALONG_X, BARE, LOAD, STILL, B, Carriage, R, on_soil, scm, towards

from cdl_fmu import load_soil
from cdl_fmu.scm.stress import power, tabulate
from cdl_fmu.terramechanics import flow_value
from orchestrator.validate import repetitive

SOIL = load_soil("mss_d")
N, K_EQ = SOIL["n"], SOIL["k_c"] / B + SOIL["k_phi"]
TAN_PHI = math.tan(SOIL["phi"])
FRICTIONLESS = BARE | STILL | dict(phi=0, c=0, rho=0)
POSITIONS = [(ALONG_X, (0.0, 0.0)), (ALONG_X, (0.0033, 0.0071)), (towards(45), (0.0, 0.0)), (towards(45), (0.0033, 0.0071))]


def rim(sinkage, f):
    """Integral over the contact arc of a wheel at this sinkage of f(theta, depth) b r [m2]."""
    theta_1 = math.acos(1 - sinkage / R)
    theta = np.linspace(-theta_1, theta_1, 4001)
    depth = (R * (np.cos(theta) - math.cos(theta_1))).clip(0.0)
    return np.trapezoid(f(theta, depth), theta) * B * R


def pressed(sinkage=0.02, **parameters) -> Carriage:
    """A smooth wheel that pressed its mould into still soil, and was then put into it without shearing it: at this sinkage [m]."""
    carriage = Carriage(scm(**(BARE | STILL | parameters)))
    carriage.move(1.0, up=-sinkage)
    carriage.move(0.02, up=0.05)
    carriage.move(0.02, up=-0.05)
    carriage.move(1e-3)
    return carriage


@pytest.mark.parametrize("cell", [0.01, 0.005])
@pytest.mark.parametrize(("heading", "at"), POSITIONS)
def test_rest_sinkage_of_a_wheel_put_down_gently(cell, heading, at):
    """27 kg sink in by 26.65 mm, as on BCM; to 0.5 %."""
    carriage = on_soil(heading=heading, at=at, cell=cell, **FRICTIONLESS)
    assert carriage.sinkage == pytest.approx(26.65e-3, rel=5e-3)


@pytest.mark.parametrize("steps", [40, 4000])
def test_force_does_not_depend_on_the_steps_in_which_the_wheel_was_lowered(steps):
    readings = Carriage(scm(**FRICTIONLESS)).move(1.0, h=1.0 / steps, up=-0.03)
    assert np.interp(LOAD, readings[:, 2], readings[:, 6]) == pytest.approx(26.65e-3, rel=5e-3)


def test_soil_does_not_creep_under_a_wheel_that_is_held():
    carriage = Carriage(scm(**FRICTIONLESS))
    carriage.move(1.0, up=-0.02)
    first, last = carriage.move(1.0)[[0, -1], 2]
    assert last == pytest.approx(first, rel=1e-3)


@pytest.mark.parametrize("cell", [0.01, 0.005])
@pytest.mark.parametrize("z", [0.01, 0.02, 0.04])
def test_compaction_resistance_is_the_work_of_pressing_the_rut(z, cell):
    carriage = Carriage(scm(cell=cell, **FRICTIONLESS | dict(k_0=1e10)), depth=z)
    resistance = -carriage.move(1.5, forward=0.1, rate=0.1 / R)[500:, 0].mean()
    assert resistance == pytest.approx(B * K_EQ * z ** (N + 1) / (N + 1), rel=0.025)


def test_sinkage_and_resistance_of_rolling_hardly_depend_on_the_step():
    coarse, fine = (on_soil(n_g=0).move(2.0, h=h, forward=0.1, rate=0.8)[-round(1.0 / h) :].mean(axis=0) for h in (4e-3, 5e-4))
    assert coarse[6] == pytest.approx(fine[6], rel=5e-3)
    assert coarse[0] == pytest.approx(fine[0], abs=5e-3 * LOAD)


def test_unloaded_soil_is_stiff_and_loaded_again_bears_what_it_bore():
    carriage = Carriage(scm(**FRICTIONLESS))
    carriage.move(1.0, up=-0.02)
    bore = carriage.move(2e-3)[-1, 2]
    unloading = carriage.move(0.02, up=1e-3)[:, 2]
    plan_area = 2 * B * math.sqrt(2 * R * 0.02 - 0.02**2)
    assert (unloading[1] - unloading[2]) / 1e-6 == pytest.approx(2e8 * plan_area, rel=0.2)
    carriage.move(0.02, up=-1e-3)
    assert carriage.move(1e-3)[-1, 2] == pytest.approx(bore, rel=2e-3)
    assert carriage.move(1.0, up=-1e-3)[-1, 2] > 1.1 * bore


@pytest.mark.parametrize("stiffness", [dict(k_0=2e7), dict(A_u=5e8), dict(k_0=1e7, A_u=5e8), dict(unloading_ratio=8)])
def test_a_plate_unloaded_and_loaded_again_follows_wongs_law(stiffness):
    branches = repetitive.load(stiffness)
    assert {name: branch.error for name, branch in branches.items()} == pytest.approx(dict.fromkeys(branches, 0.0), abs=0.02)
    assert abs(branches["unloading"].work + branches["reloading"].work) < 1e-9 * branches["loading"].work


@pytest.mark.parametrize("n", [0.8, 1.4])
def test_soil_without_a_stiffness_springs_back_by_what_its_law_and_the_ratio_say(tmp_path, n):
    bodies = Bodies(plate(tmp_path / "plate.stl", 0.1), cell=0.005, n=n, unloading_ratio=8, c_d=0, strength="plates", **STILL)
    bodies.place(0, 0.0, 0.0, 0.0)
    bore = bodies.move(0.2, (0.0, 0.0, -0.1))[-1, 2]
    share = 1 / (8 * n)
    forces = [bore, *bodies.move(1.2 * share * 0.02 / 5e-3, (0.0, 0.0, 5e-3))[:, 2]]
    assert np.count_nonzero(forces) * 5e-6 == pytest.approx(share * 0.02, rel=0.02)
    assert (np.diff(forces) <= 0.0).all()


@pytest.mark.parametrize("speed", [-0.01, 0.001])
def test_stiffness_is_the_slope_of_the_load(speed):
    """Plastic while the wheel sinks, elastic while it rises."""
    carriage = Carriage(scm(**FRICTIONLESS))
    carriage.move(2.0, up=-0.01)
    force = carriage.move(0.02, up=speed)[:, 2]
    K = carriage.instance.y.contact[0].K[2]
    assert pytest.approx((force[-1] - force[-2]) / (-speed * 1e-3), rel=0.1) == K


def test_stiffness_and_damping_along_the_ground_are_secants():
    carriage = pressed(tau_r=0.1, rho=0, c=0)
    carriage.move(0.2, sideways=0.01)
    contact, F_y = carriage.instance.y.contact[0], carriage.reading()[1]
    assert -F_y == pytest.approx(contact.K[1] * (0.002 + 0.1 * 0.01), rel=0.02)
    assert contact.D[1] == pytest.approx(0.1 * contact.K[1])
    assert contact.K[0] == pytest.approx(contact.K[1])


def test_damping_resists_sinking_and_never_pulls():
    still, sinking = pressed(c_d=1.9), pressed(c_d=1.9)
    still.set_inputs()
    sinking.set_inputs(up=-0.1)
    for carriage in (still, sinking):
        carriage.instance.step(0.0, 1e-3)
    # The speed is seen before the pose has moved.
    assert sinking.reading()[2] == pytest.approx(1.19 * still.reading()[2], rel=1e-3)
    assert sinking.instance.y.contact[0].D[2] == pytest.approx(1.9 * still.reading()[2], rel=0.1)
    rising = pressed(c_d=1.9)
    rising.set_inputs(up=2.0)
    rising.instance.step(0.0, 1e-3)
    assert not rising.reading()[:6].any()


@pytest.mark.parametrize("n_g", [0, 12])
def test_a_wheel_that_only_sinks_feels_no_horizontal_force(n_g):
    wrench = Carriage(scm(n_g=n_g)).move(1.0, up=-0.03)[-1]
    assert wrench[2] > 200.0
    assert np.abs(wrench[:2]).max() < 1e-6 * wrench[2] + (2.0 if n_g else 0.0)  # grousers do not stand mirrored


def test_no_force_in_the_air():
    carriage = on_soil()
    carriage.load = None
    carriage.move(0.1, up=1.0)
    assert not carriage.move(0.1, forward=0.1, rate=1.0)[:, :6].any()
    contact = carriage.instance.y.contact[0]
    assert contact.in_contact == 0.0 and not contact.K.any() and not contact.D.any()


@pytest.mark.parametrize("cell", [0.01, 0.005])
def test_shear_grows_as_janosi_and_hanamoto_say(cell):
    """A locked, pressed wheel moved sideways; shear acts along the rim, so the arc counts and not its plan."""
    sinkage, step = 0.02, 2e-5
    carriage = pressed(sinkage, cell=cell, rho=0, c=0)
    readings = carriage.move(0.5, h=1e-3, sideways=step / 1e-3)
    j = step * (1 + np.arange(len(readings)))
    arc = rim(sinkage, lambda theta, z: z**N) / rim(sinkage, lambda theta, z: z**N * np.cos(theta))
    mobilised = -readings[:, 1] / (readings[:, 2] * TAN_PHI * arc)
    assert mobilised == pytest.approx(1.0 - np.exp(-j / 0.02), rel=0.02)


def test_cohesion_acts_along_the_arc_and_on_the_side_that_pushes():
    with_c, without = (-pressed(c=c, rho=0).move(1e-3, sideways=1.0)[-1, 1] for c in (500.0, 0.0))
    # A cell that is pressed at all counts as a whole: an edge of half a cell on 71 mm.
    below = 500.0 * rim(0.02, lambda theta, z: np.ones_like(z))
    beside = 2.0 * 500.0 * math.tan(math.pi / 4 + SOIL["phi"] / 2) * rim(0.02, lambda theta, z: z * np.cos(theta)) / B  # Rankine
    assert with_c - without == pytest.approx((below + beside) * -math.expm1(-1e-3 / 0.02), rel=0.12)


def test_shear_that_is_taken_back_turns_round_without_a_jump():
    carriage = pressed(rho=0, c=0)
    there, back = carriage.move(1.0, sideways=0.01)[:, 1], carriage.move(2.0, sideways=-0.01)[:, 1]
    assert there[-1] < -30.0
    # It is gone about when the displacement is (soil met on the way there was displaced less), and then resists the way back.
    assert back[800] < 0.0 < back[1100]
    assert back[-1] > 30.0
    assert np.abs(np.diff(np.concatenate([there, back]))).max() < 0.1


@pytest.mark.parametrize(
    ("motion", "axis", "sign"),
    [
        (dict(forward=0.1, rate=1.2), 0, 1),  # slipping: it pulls
        (dict(forward=0.1, rate=0.4), 0, -1),  # skidding: it brakes
        (dict(forward=-0.1, rate=-1.2), 0, -1),
        (dict(rate=1.0), 0, 1),
        (dict(forward=0.1, rate=0.8, sideways=0.02), 1, -1),
        (dict(forward=0.1, rate=0.8, sideways=-0.02), 1, 1),
        (dict(forward=0.1, rate=1.2), 4, -1),  # the drive's torque is resisted
    ],
)
def test_forces_have_the_sign_of_their_cause(motion, axis, sign):
    wrench = on_soil().move(1.0, **motion)[500:].mean(axis=0)
    assert sign * wrench[axis] > 5.0
    assert wrench[2] == pytest.approx(LOAD, rel=0.05)


def test_lateral_force_builds_up_over_a_length_and_not_over_a_time():
    slow, fast = on_soil(n_g=0, tau_r=0), on_soil(n_g=0, tau_r=0)
    a = slow.move(2.0, forward=0.05, sideways=0.01, rate=0.4)[:, 1]
    b = fast.move(1.0, forward=0.1, sideways=0.02, rate=0.8)[:, 1]
    assert b == pytest.approx(a[1::2], abs=0.02 * LOAD)


def test_a_second_wheel_in_the_rut_sinks_little_further_and_meets_less_resistance():
    first = on_soil()
    passed = first.move(2.0, forward=0.1, rate=0.8)[1000:].mean(axis=0)
    second = Carriage(first.instance, at=(0.0, 0.0), depth=passed[6] - 2e-3, load=LOAD)
    second.put_down()
    again = second.move(1.4, forward=0.1, rate=0.8)[700:].mean(axis=0)
    first_mm, second_mm = 1e3 * passed[6], 1e3 * again[6]
    assert first_mm < second_mm < 1.3 * first_mm
    slippery = dict(phi=0.01, c=0, repose=SOIL["phi"])
    rolling = -on_soil(**slippery).move(2.0, forward=0.1, rate=0.8)[1000:, 0].mean()
    trodden = on_soil(**slippery)
    trodden.move(2.0, forward=0.1, rate=0.8)
    behind = Carriage(trodden.instance, at=(0.0, 0.0), depth=trodden.sinkage - 2e-3, load=LOAD)
    behind.put_down()
    assert 0.0 < -behind.move(1.4, forward=0.1, rate=0.8)[700:, 0].mean() < 0.9 * rolling


def test_a_spinning_wheel_digs_in_by_what_it_drags_along():
    def depth(slip, transport_depth):
        carriage = on_soil(n_g=0, transport_depth=transport_depth)
        return carriage.move(3.0, forward=0.03, rate=0.03 / R / (1 - slip))[2000:, 6].mean()

    nothing, little, much = (depth(0.9, d) for d in (0.0, 0.003, 0.006))
    assert nothing < little < much
    assert much > 1.1 * depth(0.0, 0.006)


def test_a_wheel_in_its_rut_is_guided():
    flat, rut = on_soil(n_g=0), on_soil(n_g=0)
    rut.move(2.0, forward=0.1, rate=0.8)
    again = Carriage(rut.instance, at=(0.1, 0.0), depth=rut.sinkage - 2e-3, load=LOAD)
    again.put_down()
    on_flat, in_rut = (-c.move(0.4, sideways=0.05)[:, 1] for c in (flat, again))
    assert in_rut[100:].mean() > on_flat[100:].mean()


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_soil_takes_power_from_every_motion(seed):
    """What it gives back is elastic: little, and less than it took before."""
    rng = np.random.default_rng(seed)
    phase, frequency = rng.uniform(0, 6, 4), rng.uniform(0.5, 3, 4)
    carriage = Carriage(scm())
    work, given_back, taken = 0.0, 0.0, 0.0
    for k in range(3000):
        wave = np.sin(2 * math.pi * frequency * k * 1e-3 + phase)
        up = 20 * (carriage.sinkage - 0.025 - 0.01 * wave[0])
        carriage.set_inputs(forward=0.1 * wave[1], sideways=0.05 * wave[2], up=up, rate=wave[3])
        carriage.instance.step(k * 1e-3, 1e-3)
        wheel, wrench = carriage.instance.u.wheel[0], carriage.instance.y.wheel[0]
        power = wrench.f_0 @ wheel.v_0 + wrench.t_0 @ wheel.w_0
        work += power * 1e-3
        taken, given_back = taken - min(power, 0.0) * 1e-3, given_back + max(power, 0.0) * 1e-3
        assert work <= 1e-9
        carriage.move_on(1e-3)
    assert taken > 1.0
    assert given_back < 0.05 * taken


def test_power_of_a_wheel_that_spins_in_place():
    readings = on_soil().move(1.0, rate=2.0)
    assert (readings[:, 4] * 2.0 < 0.0).all()


def test_grousers_push_when_the_wheel_slips():
    """At the same sinkage, so that what they bear does not count."""
    smooth, toothed = (
        Carriage(scm(n_g=n_g, transport_depth=0), depth=0.025).move(2.0, forward=0.7 * R, rate=1.0)[1000:].mean(axis=0) for n_g in (0, 12)
    )
    assert toothed[0] > smooth[0] + 0.01 * LOAD


def test_force_of_a_smooth_wheel_is_smooth_and_smoother_on_finer_cells():
    noise = []
    for cell in (0.02, 0.01, 0.005):
        readings = on_soil(cell=cell, n_g=0).move(4.0, forward=0.1, rate=0.8)[2500:, :3]
        noise.append(readings.std(axis=0).max() / LOAD)
    assert noise[1] < 0.01
    assert noise[0] > noise[1] > noise[2]


def test_reece_and_bekker_agree_where_their_constants_do():
    bekker = pressed(**FRICTIONLESS).reading()[2]
    gamma_b = 1896.0 * 9.81 * B
    reece = pressed(**(FRICTIONLESS | dict(rho=1896.0, pressure_model="reece", k_phi_1=K_EQ * B**N / gamma_b))).reading()[2]
    assert reece == pytest.approx(bekker, rel=1e-6)


def test_the_rims_pressure_surcharges_grouser_faces():
    """By at most kappa_q N_phi sigma on each face below the soil, sigma the load over the plan of half the contact at least."""
    thrust = {}
    for kappa_q in (0.0, 0.1):
        carriage = on_soil(h_g=0.005, kappa_q=kappa_q, erosion_sweeps=0)
        readings = carriage.move(0.5, forward=0.06, rate=1.0)[-100:]
        thrust[kappa_q] = readings[:, 0].mean()
    sigma = LOAD / (B * math.sqrt(2 * R * 0.02 - 0.02**2))
    most = 0.1 * flow_value(load_soil("mss_d")["phi"]) * sigma * 2 * 0.005 * B
    assert 0.1 * most < thrust[0.1] - thrust[0.0] < most


@pytest.mark.parametrize("n", [0.3, 1.0, 2.49, 4.0])
def test_powers_of_the_depth_are_near_enough_and_positive(n):
    table = np.zeros((2, 257))
    tabulate(n, 0.25, table)
    per_root = 256 / math.sqrt(0.25)
    for depth in np.geomspace(1e-12, 1.0, 200):
        assert power(table, per_root, n, depth) == pytest.approx(depth**n, rel=1e-3)
