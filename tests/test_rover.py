"""The rover: mechanics, frames, servos, saved state, and contact forces integrated implicitly."""

import math

import numpy as np
import pytest

from cdl_fmu.slave.model import Instance, ModelError
from mbs.rover import Rover

H = 1e-3
G = 9.81
R_W = 0.125
WEIGHT = (50 + 2 * 2) * G


def rover(**parameters):
    r = Instance(Rover(), **parameters)
    r.initialise()
    return r


def cross(a, b):  # np.cross takes 20 times as long
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def contact(r, i, law, damping=0.0, traction=0.0, angle=0.0, pose=None, jacobian=True):
    """Contact on wheel i with normal force law(z) -> (F, K) over the penetration z of flat ground at z = 0, at ``angle`` from nadir.

    ``damping`` acts vertically at the hub, ``traction`` [N.s/m] on the sliding velocity of the contact point. Returns the force.
    """
    pose = r.y.wheel[i] if pose is None else pose
    u, c = r.u.wheel[i], r.u.contact[i]
    u.f_0[:], u.t_0[:], c.in_contact, c.F[:], c.K[:], c.D[:] = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    depth = R_W - pose["r_0"][2]
    load, stiffness = law(depth) if depth > 0 else (0.0, 0.0)
    load -= damping * pose["v_0"][2]
    if depth <= 0 or load <= 0:
        return np.zeros(3)
    normal = np.array([0.0, 0.0, 1.0])
    heading = cross(pose["T"][1], normal)
    heading /= np.linalg.norm(heading)
    axes = np.array([heading, cross(normal, heading), normal])
    arm = R_W * (math.sin(angle) * heading - math.cos(angle) * normal)
    slide = axes @ (pose["v_0"] + cross(pose["w_0"], arm))
    force = np.array([-traction * slide[0], -traction * slide[1], load])
    u.f_0[:] = axes.T @ force
    u.t_0[:] = cross(arm, u.f_0)
    if jacobian:
        c.in_contact = 1.0
        c.point_0[:], c.axes[:], c.F[:], c.K[:] = pose["r_0"] + arm, axes, force, (0.0, 0.0, stiffness)
        c.D[:] = traction, traction, damping
        for name in ("r_0", "T", "v_0", "w_0"):
            c.anchor[name][...] = pose[name]
    return u.f_0.copy()


def spring(stiffness):
    return lambda z: (stiffness * z, stiffness)


def bekker(load=WEIGHT / 2, sinkage=0.02665, exponent=2.99):
    """Bekker's wheel force near Table 8.2: F = load (z / sinkage)^(n + 1/2)."""
    return lambda z: (load * (z / sinkage) ** exponent, exponent * load / sinkage * (z / sinkage) ** (exponent - 1))


def drive(r, seconds, law, h=H, record=None, **options):
    """Step the rover on contacts that see its present pose (Gauss-Seidel order); the recorded values per step."""
    out = []
    for k in range(round(seconds / h)):
        for i in range(2):
            contact(r, i, law, **options)
        r.step(k * h, h)
        if record:
            out.append(record(r))
    return np.array(out)


def copy(record):
    return {name: np.array(record[name]) for name in ("r_0", "T", "v_0", "w_0")}


def kinetic_energy(r):
    arm = rotation(r) @ (0, 0, 0.1)
    v = r.y.body.v_0 + np.cross(r.y.body.w_0, arm)
    e = 50.0 * (v @ v) / 2
    for w in r.y.wheel:
        spin = w["T"] @ w["w_0"]
        e += 2.0 * (w["v_0"] @ w["v_0"]) / 2 + spin @ ((0.0625 / 6, 0.015625, 0.0625 / 6) * spin) / 2
    return e


def rotation(r):
    a, b = r.y.body.yaw, r.y.body.pitch
    yaw = np.array([[math.cos(a), -math.sin(a), 0], [math.sin(a), math.cos(a), 0], [0, 0, 1]])
    pitch = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
    return yaw @ pitch


def test_start_pose_and_frames():
    r = rover(**{"start.x": 0.4, "start.z": 0.2, "start.pitch": 0.1, "start.yaw": 0.3})
    along = rotation(r) @ (0.3, 0, 0)
    assert r.y.body.r_0 == pytest.approx([0.4, 0, 0.2])
    assert r.y.wheel[0].r_0 == pytest.approx(r.y.body.r_0 + along)  # front, and lower: positive pitch is nose down
    assert r.y.wheel[1].r_0 == pytest.approx(r.y.body.r_0 - along)
    assert r.y.wheel[0].r_0[2] < 0.2
    axle = r.y.wheel[0]["T"].T @ (0, 1, 0)
    assert axle == pytest.approx([-math.sin(0.3), math.cos(0.3), 0])  # to the left


def test_rear_wheel_starts_at_zero():
    r = rover()
    assert r.y.wheel[1].r_0 == pytest.approx([0, 0, R_W])
    assert r.y.wheel[0].r_0 == pytest.approx([0.6, 0, R_W])


def test_free_fall():
    r = rover()
    for k in range(500):
        r.step(k * H, H)
    assert r.y.body.v_0 == pytest.approx([0, 0, -G * 0.5], rel=1e-10)
    assert R_W - r.y.body.r_0[2] == pytest.approx(G * 0.125, rel=3e-3)
    assert r.y.applied["f_0"] == pytest.approx(0)


def test_free_motion_keeps_energy_and_does_not_roll():
    errors = []
    for h in (H, H / 4):
        r = rover(gravity=0.0, wheel_servo_gain=0.0, steer_servo_gain=0.0)
        r.u.wheel[0].f_0[:] = 30, 200, 60
        r.u.wheel[0].t_0[:] = 5, 1, 2  # the constraint against roll carries the torque about x
        for _ in range(round(0.1 / h)):
            r.step(0.0, h)
        r.u.wheel[0].f_0[:] = r.u.wheel[0].t_0[:] = 0
        start = kinetic_energy(r)
        for _ in range(round(0.3 / h)):
            r.step(0.0, h)
            assert abs(rotation(r)[2, 1]) < 1e-12
            assert np.linalg.norm(r.y.wheel[0].r_0 - r.y.wheel[1].r_0) == pytest.approx(0.6, rel=1e-12)
        assert abs(r.y.body.pitch) > 0.05
        assert abs(r.y.body.yaw) > 0.05
        errors.append(abs(kinetic_energy(r) / start - 1))
    assert errors[0] < 1e-2
    assert errors[1] < errors[0] / 3  # first order in the step


def test_twist_is_the_derivative_of_the_pose():
    r = rover()
    r.u.command.wheel_rate[:] = 3, 2
    r.u.command.steer_rate[1] = 0.8
    r.u.wheel[0].f_0[:] = 30, 20, 400
    h = 1e-5
    for k in range(3000):
        r.step(k * H, 1e-4 if k < 2999 else h)
    before = [copy(w) for w in r.y.wheel]
    body = r.y.body.r_0.copy()
    r.step(0, h)
    assert (r.y.body.r_0 - body) / h == pytest.approx(r.y.body.v_0, abs=1e-4)
    assert abs(r.y.body.pitch) > 0.1
    assert abs(r.y.body.yaw) > 0.01
    for old, new in zip(before, r.y.wheel):
        assert (new["r_0"] - old["r_0"]) / h == pytest.approx(new["v_0"], abs=1e-3)
        turn = new["T"].T @ old["T"]  # world to world
        spin = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / (2 * h)
        assert spin == pytest.approx(new["w_0"], abs=1e-3)
        assert new["T"] @ new["T"].T == pytest.approx(np.eye(3), abs=1e-12)


def test_a_wheel_that_drives_forward_turns_about_its_axle_to_the_left():
    r = rover()
    r.u.command.wheel_rate[:] = 1.0
    for k in range(500):
        r.step(k * H, H)
    assert r.y.joint.wheel_angle == pytest.approx(0.5 * np.ones(2), rel=1e-3)
    assert r.y.wheel[0].w_0 == pytest.approx(np.add(r.y.body.w_0, (0, 1, 0)), abs=1e-3)
    # Material at the wheel's front goes down; the free body pitches back a little.
    angle = r.y.joint.wheel_angle[0] + r.y.body.pitch
    assert 0.3 < angle < 0.5
    assert r.y.wheel[0]["T"][0] == pytest.approx([math.cos(angle), 0, -math.sin(angle)], abs=1e-12)


def test_servos_track_under_load():
    r = rover()
    r.u.command.wheel_rate[:] = 1.0
    r.u.command.steer_rate[:] = 0.8
    r.u.wheel[0].t_0[1] = -20
    r.u.wheel[1].t_0[:] = 0, -20, -20
    for k in range(500):
        r.step(k * H, H)
        assert r.y.joint.wheel_rate == pytest.approx(np.ones(2), abs=1e-3)
    assert r.y.joint.steer_angle[1] == pytest.approx(0.4, abs=1e-3)
    assert r.y.joint.steer_angle[0] == 0  # the front wheel does not steer


def test_steering_turns_the_axle_of_a_pitched_rover():
    r = rover(**{"start.pitch": 0.2}, gravity=0.0)
    r.u.command.steer_rate[1] = 0.5
    for k in range(1000):
        r.step(k * H, H)
    steer, body = r.y.joint.steer_angle[1], rotation(r)
    assert steer == pytest.approx(0.5, abs=1e-3)
    axle = r.y.wheel[1]["T"][1]
    assert axle == pytest.approx(body @ (-math.sin(steer), math.cos(steer), 0), abs=1e-12)
    assert abs(axle[2]) > 0.05


def test_static_equilibrium_on_springs():
    r = rover(**{"start.z": R_W - WEIGHT / 2 / 3e4})
    applied = drive(r, 0.5, spring(3e4), damping=500.0, record=lambda r: r.y.applied["f_0"].copy())
    assert applied[:, :, 2] == pytest.approx(WEIGHT / 2, rel=1e-9)
    assert r.y.body.r_0[2] == pytest.approx(R_W - WEIGHT / 2 / 3e4, rel=1e-12)


def test_applied_force_is_what_changes_the_momentum():
    r = rover(**{"start.z": R_W + 0.01})

    def momentum(r):
        v = r.y.body.v_0 + np.cross(r.y.body.w_0, rotation(r) @ (0, 0, 0.1))
        return 50.0 * v + 2.0 * (r.y.wheel[0].v_0 + r.y.wheel[1].v_0)

    r.u.command.wheel_rate[:] = 1.0
    impulse = np.zeros(3)
    for k in range(200):
        for i in range(2):
            contact(r, i, spring(1e6), damping=1000.0, traction=3000.0)
        r.step(k * H, H)
        impulse += H * (r.y.applied["f_0"].sum(axis=0) - (0, 0, WEIGHT))
    assert impulse[0] > 5.0
    assert momentum(r) == pytest.approx(impulse, rel=1e-5, abs=1e-9)


@pytest.mark.parametrize("angle", [0.0, 0.3])
def test_rolling_loads_sum_to_the_weight(angle):
    """Also where the contact lies ahead of nadir, so that its point moves along the normal as the wheel turns."""
    r = rover(**{"start.z": R_W - 0.02665})
    r.u.command.wheel_rate[:] = 1.0
    load = drive(r, 1.5, bekker(), damping=300.0, traction=2000.0, angle=angle, record=lambda r: r.y.applied["f_0"][:, 2].sum())
    assert r.y.body.v_0[0] > 0.1
    assert load[-300:] == pytest.approx(WEIGHT, rel=1e-3)


@pytest.mark.parametrize(("h", "within"), [(1e-3, 0.002), (4e-3, 0.01), (8e-3, 0.07)])
def test_soft_impact_rebounds_as_in_a_fine_reference(h, within):
    """Omega H of heave 0.03 to 0.26 at rest, twice that at the deepest point; the reference is integrated apart with 1 us."""
    height, mass, law = 0.02, WEIGHT / 2 / G, bekker()
    x, v = height, 0.0
    while v <= 0 or x < 0 or v > G * 1e-6:
        v += 1e-6 * ((law(-x)[0] if x < 0 else 0.0) / mass - G)
        x += 1e-6 * v
    r = rover(**{"start.z": R_W + height})
    top, fell = 0.0, False
    for k in range(round(0.35 / h)):
        for i in range(2):
            contact(r, i, law)
        r.step(k * h, h)
        fell = fell or r.y.body.r_0[2] < R_W
        if fell:
            top = max(top, r.y.body.r_0[2] - R_W)
    assert x == pytest.approx(height, rel=1e-3)
    assert top == pytest.approx(height, rel=within)


@pytest.mark.parametrize("stiffness", [1e6, 1e7, 1e8])
@pytest.mark.parametrize("ratio", [0.05, 0.3, 1.0])
@pytest.mark.parametrize("mass", [1e-3, 50.0])
def test_stiff_contacts_stay_bounded(stiffness, ratio, mass):
    """A drop by 10 mm on rock; with the tiny body mass each contact carries a wheel of 2 kg alone."""
    r = rover(**{"start.z": R_W + 0.01, "mass": mass})
    damping = 2 * ratio * math.sqrt(stiffness * 2.0)
    height = drive(r, 0.3, spring(stiffness), damping=damping, traction=2000.0, record=lambda r: [w["r_0"][2] - R_W for w in r.y.wheel])
    assert height.max() < 0.0112
    assert abs(height[-100:]).max() < 0.01
    if ratio == 1.0:
        assert abs(height[-1]).max() < 5e-4


def test_contact_never_pulls():
    r = rover(**{"start.z": R_W - 1e-4})
    r.u.wheel[0].f_0[:] = 0
    loads = drive(r, 0.5, spring(1e6), damping=5e3, record=lambda r: r.y.applied["f_0"][:, 2].copy())
    assert loads.min() >= 0.0
    # A damper alone would hold the wheel that is torn off the ground.
    r = rover(gravity=0.0)
    r.u.wheel[0].f_0[2] = 100.0
    r.step(0, H)
    c = r.u.contact[0]
    c.in_contact, c.F[2], c.D[2] = 1.0, 1.0, 1e5
    c.point_0[:] = r.y.wheel[0].r_0 - (0, 0, R_W)
    r.u.wheel[0].f_0[2] = 101.0  # 100 N from elsewhere, 1 N of contact that the damper turns into a pull
    r.step(0, H)
    assert r.y.applied["f_0"][0] == pytest.approx([0, 0, 0])


def test_stiff_spring_is_stable_under_jacobi_with_anchors():
    """Wrench and anchor one step old, 1e6 N/m, 1 ms."""
    results = {}
    for name, stiffness in (("soft", 3e4), ("stiff", 1e6)):
        r = rover(**{"start.z": R_W - WEIGHT / 2 / stiffness})
        r.u.command.wheel_rate[:] = 1.0
        poses = [copy(w) for w in r.y.wheel]
        loads = []
        for k in range(1000):
            for i in range(2):
                contact(r, i, spring(stiffness), damping=60.0, traction=2000.0, pose=poses[i])
            poses = [copy(w) for w in r.y.wheel]
            r.step(k * H, H)
            loads.append(r.y.applied["f_0"][:, 2].copy())
        results[name] = np.array(loads)
        assert r.y.body.v_0[0] == pytest.approx(R_W, rel=0.01)
    assert np.abs(results["stiff"][-500:].sum(axis=1) / WEIGHT - 1).max() < 1e-3
    assert np.abs(results["soft"][-500:].sum(axis=1) / WEIGHT - 1).max() < 1e-3


def test_an_old_anchor_gives_the_same_as_a_fresh_one_on_a_linear_contact():
    """Linear springs and dampers along all axes: an anchor some steps old predicts the force exactly, spin included."""
    finals = []
    for lag in (0, 1):
        r = rover(**{"start.z": R_W - WEIGHT / 2 / 1e6})
        r.u.command.wheel_rate[:] = 0.2
        poses = [[copy(w) for w in r.y.wheel]] * 2
        for k in range(100):
            poses = [poses[1], [copy(w) for w in r.y.wheel]]
            for i in range(2):
                contact(r, i, spring(1e6), damping=60.0, traction=500.0, pose=poses[1 - lag][i])
            r.step(k * H, H)
        finals.append(r.y.body.v_0.copy())
    assert finals[1] == pytest.approx(finals[0], rel=2e-3, abs=1e-5)


def test_stiffness_follows_the_rim_since_the_anchor():
    """Hub moved by 1 mm and wheel turned by 10 mrad since the anchor: a tangential spring feels both at the rim."""
    r = rover(gravity=0.0)
    c, pose = r.u.contact[0], copy(r.y.wheel[0])
    c.in_contact, c.K[0] = 1.0, 1e3
    ahead = 0.01  # the wheel stands at angle 0 now, so the anchor's T is that of angle -10 mrad
    back = np.array([[math.cos(ahead), 0, math.sin(ahead)], [0, 1, 0], [-math.sin(ahead), 0, math.cos(ahead)]])
    for hub, angle in ((1e-3, 0.0), (0.0, 0.01), (1e-3, 0.01)):
        r.initialise()
        c.anchor.r_0[:] = pose["r_0"] - (hub, 0, 0)
        c.anchor["T"][...] = back if angle else np.eye(3)
        c.point_0[:] = c.anchor.r_0 - (0, 0, R_W)
        r.step(0, H)
        # Forward spin moves the lowest rim point back.
        assert r.y.applied[0].f_0 == pytest.approx([-1e3 * (hub - angle * R_W), 0, 0], rel=2e-2)


def test_wrench_without_jacobian_acts_as_it_is():
    r = rover(gravity=0.0)
    r.u.wheel[0].f_0[:] = 1, 2, 54
    r.u.wheel[1].f_0[:] = 1, -2, 54
    r.step(0, H)
    assert r.y.applied["f_0"] == pytest.approx(np.array([[1, 2, 54], [1, -2, 54]]))
    assert r.y.wheel[0].v_0[2] + r.y.wheel[1].v_0[2] == pytest.approx(2 * 2 * H, rel=1e-6)


def test_state_restores_to_the_same_bits():
    def walk(r, steps, saved_at=None):
        out, saved = [], None
        for k in range(steps):
            if k == saved_at:
                saved = r.block[r.slices["x"]].copy()
            for i in range(2):
                contact(r, i, spring(1e5), damping=100.0, traction=1000.0)
            r.u.command.wheel_rate[:] = 1.0
            r.u.command.steer_rate[1] = 0.5
            r.step(k * H, H)
            out.append(r.block[r.slices["y"]].copy())
        return np.array(out), saved

    first = rover(**{"start.z": R_W - 2e-3})
    once, state = walk(first, 60, saved_at=30)
    inputs_at_30 = rover(**{"start.z": R_W - 2e-3})
    walk(inputs_at_30, 30)
    for i in range(2):
        contact(inputs_at_30, i, spring(1e5), damping=100.0, traction=1000.0)
    for other in (first, rover()):  # after a rollback, and in a fresh instance
        other.block[other.slices["x"]] = state
        other.block[other.slices["u"]] = inputs_at_30.block[inputs_at_30.slices["u"]]
        other.step(0.03, H)
        assert np.array_equal(other.block[other.slices["y"]], once[30])
        rest, _ = walk(other, 29)
        assert np.array_equal(rest, once[31:])


def whole(triangle):
    """Symmetric matrix of which this is the lower triangle, row by row."""
    n = math.isqrt(2 * len(triangle))
    a = np.zeros((n, n))
    a[np.tril_indices(n)] = triangle
    return a + np.tril(a, -1).T


def test_inverse_inertia_of_a_wheel():
    r = rover(with_inverse_inertia="on", gravity=0.0)
    a = whole(r.y.inverse_inertia)
    assert a == pytest.approx(a.T)
    # Off contact the points are the wheel centres: lift of one wheel against the exact inertia of link, point mass and wheels.
    total = 50 + 2 * 2
    pitch = 50 * 0.1**2 + 2 * 2 * 0.3**2 + 2 * 0.015625 - total * (50 * 0.1 / total) ** 2  # about the centre of mass, wheels locked
    assert a[2, 2] == pytest.approx(1 / total + 0.3**2 / pitch, rel=1e-3)
    off = rover(gravity=0.0)
    assert np.all(off.y.inverse_inertia == 0)
    # A brief force answers with it.
    r.u.wheel[0].f_0[:] = 3, 5, 7
    r.step(0, 1e-5)
    v = np.concatenate([(*w["v_0"], *w["w_0"]) for w in r.y.wheel])
    r.initialise()
    r.step(0, 1e-5)
    a = whole(r.y.inverse_inertia)  # of steps of that length
    assert v / 1e-5 == pytest.approx(a @ (3, 5, 7, *[0] * 9), rel=2e-3, abs=1e-4)


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"mass": 0.0}, "mass = 0 kg: it must be at least 0.001 kg"),
        ({"wheel_base": -1.0}, "wheel_base = -1 m: it must be at least 0.001 m"),
        ({"start.z": math.nan}, "start.z = nan m: it must be finite"),
        ({"wheel_inertia_axle": 1.0}, "wheel_inertia_axle = 1 kg.m2: it must be at most twice wheel_inertia_diameter"),
    ],
)
def test_bad_parameters_are_refused(values, text):
    with pytest.raises(ModelError, match=text):
        rover(**values)


def test_other_sizes_are_refused():
    with pytest.raises(ModelError, match=r"n_wheels = 6: the rover of Table 8\.2 has 2 wheels"):
        Rover(n_wheels=6)


def test_bad_inputs_are_refused_and_the_state_stays(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    r = rover()
    r.step(0, H)
    before = r.block[r.slices["x"]].copy()
    r.u.wheel[0].f_0[1] = math.nan
    with pytest.raises(ModelError, match=r"wheel\[1\].f_0\[2\] = nan N: it must be finite"):
        r.step(H, H)
    r.u.wheel[0].f_0[1] = 1e300
    with pytest.raises(ModelError, match=r"the rover's motion left all bounds.*check the contact forces"):
        r.step(H, H)
    assert np.array_equal(r.block[r.slices["x"]], before)
    r.u.wheel[0].f_0[1] = 0.0
    r.step(H, H)
    assert r.y.body.v_0[2] == pytest.approx(-2 * G * H)
    assert list(tmp_path.iterdir()) == []  # no MUJOCO_LOG.TXT
