"""Bodies other than wheels on SCM's soil: plates against the closed form, footpads, rocks, several at once, and what is refused."""

import math
import re

import fmpy
import numpy as np
import pytest
import trimesh
from bodies import N_BODIES, Bodies, ball, box, plate
from soil import fields, surface, volume_error

from cdl_fmu.scm import SCM
from cdl_fmu.scm.tiles import SINKAGE
from cdl_fmu.slave.build import build_fmu
from cdl_fmu.slave.model import Instance, ModelError
from orchestrator.fmu import Slave, SlaveError

#: No damping, and shear that needs more displacement than there is.
BARE = dict(c_d=0, tau_r=0, K=10, k_0=2e8, strength="plates")
STILL = BARE | dict(plasticity=0, transport_depth=0, erosion_sweeps=0)
H = 2e-3
DOWN, UP = (0.0, 0.0, -0.1), (0.0, 0.0, 0.1)


@pytest.mark.parametrize(("diameter", "pressures"), [(0.10, (1987.0, 11165.0, 30643.0)), (0.15, (2187.0, 12287.0, 33721.0))])
def test_plate_sinkage(tmp_path, diameter, pressures):
    """F = pi R^2 (k_c/R + k_phi) z^n: mean pressure [Pa] at 10, 20 and 30 mm on the soil of Table 8.2."""
    bodies = Bodies(plate(tmp_path / "plate.stl", diameter), cell=diameter / 20.0, **BARE)
    bodies.place(0, 0.0013, -0.0007, 0.0)
    area = 0.25 * math.pi * diameter**2
    for pressure in pressures:
        wrench = bodies.move(0.1, DOWN, h=H)[-1]
        assert wrench[2] / area == pytest.approx(pressure, rel=0.005)
        assert np.abs(wrench[[0, 1, 3, 4, 5]]).max() < 1e-3 * wrench[2]
        assert volume_error(bodies.instance) == 0.0


def test_plate_with_reeces_law(tmp_path):
    bodies = Bodies(plate(tmp_path / "plate.stl", 0.1), cell=0.005, pressure_model="reece", **BARE)
    bodies.place(0, 0.0, 0.0, 0.0)
    p = bodies.instance.p
    expected = (p.c * p.k_c_1 + p.rho * p.gravity * 0.05 * p.k_phi_1) * (0.02 / 0.05) ** p.n
    assert bodies.move(0.2, DOWN, h=H)[-1, 2] / (0.25 * math.pi * 0.1**2) == pytest.approx(expected, rel=0.005)


def test_the_width_can_be_given(tmp_path):
    forces = []
    for b in (0.0, 0.06, 0.03):
        bodies = Bodies(plate(tmp_path / "plate.stl", 0.12), **{"body[1].b": b}, **BARE)
        bodies.place(0, 0.0, 0.0, 0.0)
        forces.append(bodies.move(0.1, DOWN, h=H)[-1, 2])
    assert forces[0] == pytest.approx(forces[1], rel=1e-3)
    p = bodies.instance.p
    assert forces[2] / forces[1] == pytest.approx((p.k_c / 0.03 + p.k_phi) / (p.k_c / 0.06 + p.k_phi), rel=1e-6)


def test_a_plate_that_drags_grains_along_keeps_its_friction(tmp_path):
    """Soil that loses grains to it is still sheared; soil that it meets anew is not yet, on K = 20 mm of its 200 mm."""
    bodies = Bodies(plate(tmp_path / "plate.stl", 0.2), strength="plates")
    bodies.place(0, 0.0, 0.0, 0.0)
    bodies.move(0.4, (0.0, 0.0, -0.05), h=H)
    wrench = bodies.move(2.0, (0.05, 0.0, -4e-4), h=H)[-500:].mean(axis=0)
    assert 0.8 < -wrench[0] / (wrench[2] * math.tan(bodies.instance.p.phi)) < 1.0


@pytest.mark.parametrize("yaw", [0.0, 30.0])
def test_a_tilted_plate(tmp_path, yaw):
    """Pressure acts along its normal, each part at its own depth, and rights it."""
    bodies = Bodies(box(tmp_path / "box.stl", 0.15, 0.12, 0.04), **STILL)
    tilt, depth = math.radians(10.0), 0.02
    bodies.place(0, 0.0, 0.0, 0.0, pitch=-10.0, yaw=yaw)
    f_x, f_y, f_z, t_x, t_y, _ = bodies.move(depth / 0.1, DOWN, h=H)[-1]
    k = bodies.instance.p.k_c / (0.15 * 0.12 * 2.0 / 0.54) + bodies.instance.p.k_phi
    s = (np.arange(2000) + 0.5) / 2000 * 0.15 - 0.075
    force = k * np.maximum(depth - s * math.sin(tilt), 0.0) ** bodies.instance.p.n * 0.12 * 0.15 / 2000
    along = np.array([math.cos(math.radians(yaw)), math.sin(math.radians(yaw))])
    across = np.array([-along[1], along[0]])
    pull, turn = np.array([f_x, f_y]), np.array([t_x, t_y])
    assert f_z == pytest.approx(force.sum() * math.cos(tilt), rel=0.02)
    assert pull @ along == pytest.approx(f_z * -math.tan(tilt), rel=0.02)
    assert abs(pull @ across) < 0.01 * f_z
    assert turn @ across == pytest.approx(-(force * s).sum(), rel=0.02)
    assert abs(turn @ along) < 0.02 * abs(turn @ across)


def test_the_lowest_of_two_layers_counts(tmp_path):
    """A narrow foot below a wide belly, both in the ground: the belly bears beside the foot alone."""
    foot, belly = trimesh.creation.box((0.1, 0.1, 0.02)), trimesh.creation.box((0.2, 0.2, 0.02))
    foot.apply_translation([0.0, 0.0, 0.01])
    belly.apply_translation([0.0, 0.0, 0.06])
    trimesh.util.concatenate([foot, belly]).export(tmp_path / "body.stl")
    bodies = Bodies(tmp_path / "body.stl", **STILL)
    bodies.place(0, 0.0, 0.0, 0.0)
    force = bodies.move(0.7, DOWN, h=1e-2)[-1, 2]
    p = bodies.instance.p
    assert force == pytest.approx((p.k_c / 0.1 + p.k_phi) * (0.01 * 0.07**p.n + 0.03 * 0.02**p.n), rel=0.02)


def test_a_footpad_dragged_sideways_meets_friction_and_the_soil_ahead(tmp_path):
    bodies = Bodies(box(tmp_path / "pad.stl", 0.2, 0.15, 0.05), c_d=0, tau_r=0, plasticity=0, transport_depth=0)
    bodies.place(0, 0.0, 0.0, 0.0)
    bodies.move(0.2, DOWN, h=H)
    p = bodies.instance.p
    drag = bodies.move(0.6, (0.05, 0.0, 0.0), h=H)
    assert drag[0, 0] > -20.0 and abs(drag[:, 1]).max() < 1.0
    limit = p.c * 0.03 + drag[-1, 2] * math.tan(p.phi)
    assert -1.1 * limit < drag[-1, 0] < -0.6 * limit
    assert volume_error(bodies.instance) == 0.0


def test_a_wall_bears_rankines_pressure(tmp_path):
    """A buried pad that has no floor below it, pushed against undisturbed soil."""
    bodies = Bodies(
        box(tmp_path / "pad.stl", 0.2, 0.15, 0.05), c_d=0, tau_r=0, K=1e-4, k_0=2e8, strength="plates", plasticity=0, transport_depth=0
    )
    bodies.place(0, 0.0, 0.0, 0.0)
    bodies.move(0.3, DOWN, h=H)
    bodies.move(0.01, UP, h=H)
    force = bodies.move(0.01, (0.05, 0.0, 0.0), h=H)[-1]
    p, height = bodies.instance.p, 0.029
    N_phi = math.tan(math.pi / 4 + p.phi / 2) ** 2
    expected = 0.15 * height * (0.5 * p.rho * p.gravity * height * N_phi + 2.0 * p.c * math.sqrt(N_phi))
    assert force[0] == pytest.approx(-expected, rel=0.1)
    assert force[2] == 0.0 and abs(force[1]) < 0.01 * expected
    back = bodies.move(0.02, (-0.05, 0.0, 0.0), h=H)[-1]
    assert back[0] > 0.5 * expected


def test_a_rock_leaves_a_crater_with_a_rim_and_is_not_held_back(tmp_path):
    bodies = Bodies(ball(tmp_path / "rock.stl", 0.05), c_d=0, tau_r=0, k_0=2e8)
    bodies.place(0, 0.003, -0.002, 0.05)
    pressed = bodies.move(0.3, DOWN, h=H)
    assert (np.diff(pressed[:, 2]) > -0.5).all() and pressed[-1, 2] > 50.0
    assert volume_error(bodies.instance) == 0.0
    pulled = bodies.move(0.3, UP, h=H)
    # Some soil slides down against it on the way.
    assert (pulled[:, 2] >= 0.0).all() and pulled[5:, 2].max() < 0.01 * pressed[-1, 2] and not pulled[-1].any()
    for k in range(200):
        bodies.instance.step(k * H, H)
    assert volume_error(bodies.instance) == 0.0
    ground = surface(bodies.instance)
    x, y = (o + ground.spacing * np.arange(n) for o, n in zip(ground.origin, ground.z.shape))
    radius, direction = np.hypot(x[:, None] - 0.003, y[None, :] + 0.002), np.arctan2(y[None, :] + 0.002, x[:, None] - 0.003)
    assert ground.z[radius < 0.01].max() < -0.01
    rim = [ground.z[(radius > 0.04) & (radius < 0.09) & (np.abs(direction - a) < 0.4)].max() for a in np.radians([-135, -45, 45, 135])]
    assert min(rim) > 0.001 and max(rim) < 1.3 * min(rim)
    assert np.abs(ground.z[radius > 0.2]).max() == 0.0


def test_bodies_side_by_side(tmp_path):
    """They feel one another's soil alike, whichever is called first, and no volume is lost where their footprints meet."""
    file = box(tmp_path / "box.stl", 0.1, 0.1, 0.04)

    def pressed(first):
        bodies = Bodies(file, c_d=0, tau_r=0)
        for i, x in enumerate((-0.05, 0.05)):
            bodies.place(i if first else 1 - i, x, 0.0, 0.0)
        bodies.move(0.2, DOWN, DOWN, h=H)
        bodies.move(0.1, (0.0, 0.05, 0.0), (0.0, -0.05, 0.0), h=H)
        assert volume_error(bodies.instance) == 0.0
        return [bodies.wrench(i if first else 1 - i) for i in range(2)]

    left, right = pressed(True)
    assert left[2] == pytest.approx(right[2], rel=0.02) and left[2] > 50.0
    assert left[1] < -10.0 and right[1] > 10.0


def test_a_body_far_from_another_feels_nothing_of_it(tmp_path):
    file = box(tmp_path / "box.stl", 0.1, 0.1, 0.04)
    alone, beside = Bodies(file), Bodies(file)
    for bodies in alone, beside:
        bodies.place(0, 0.0, 0.0, 0.0)
    beside.place(1, 0.8, 0.0, 0.0)
    assert np.array_equal(alone.move(0.2, DOWN, h=H), beside.move(0.2, DOWN, DOWN, h=H))
    assert beside.wrench(1) == pytest.approx(beside.wrench(0), rel=1e-3, abs=0.01)


def test_a_step_taken_back_is_retaken_to_the_same_bits(tmp_path):
    bodies = Bodies(box(tmp_path / "pad.stl", 0.1, 0.1, 0.04))
    bodies.place(0, 0.0, 0.0, 0.0, pitch=5.0, yaw=20.0)
    bodies.move(0.1, DOWN, h=H)
    saved, pose = bodies.instance.save(), bodies.instance.u.body[0].r_0.copy()
    first = bodies.move(0.05, (0.05, 0.02, -0.05), h=H)
    rows = bodies.instance.pool.rows.copy()
    bodies.instance.restore(saved)
    assert np.array_equal(bodies.instance.u.body[0].r_0, pose)
    assert np.array_equal(bodies.move(0.05, (0.05, 0.02, -0.05), h=H), first)
    assert np.array_equal(bodies.instance.pool.rows[: len(rows)], rows)


def test_a_body_without_a_pose_is_waited_for(tmp_path):
    bodies = Bodies(box(tmp_path / "pad.stl", 0.1, 0.1, 0.04))
    body, instance = bodies.instance.u.body[0], bodies.instance
    body["T"][:] = body.r_0[:] = 0.0
    for k in range(2):
        instance.step(k * H, H)
        assert not bodies.wrench(0).any() and not fields(instance, SINKAGE).any()
    assert instance.warnings == ["scm: body 1 has no pose yet (T is no rotation or nothing was ever set): no force (t = 0 s)"]
    with pytest.raises(ModelError, match=r"body\[1\] still has no pose after 2 steps: connect body\[1\].r_0, T, v_0, w_0 \(t = "):
        instance.step(2 * H, H)
    bodies.place(0, 0.0, 0.0, 0.1)
    instance.step(2 * H, H)


@pytest.mark.parametrize(
    ("parameters", "velocity", "text"),
    [
        (
            dict(map_max=(0.2, 1.0)),
            (1.0, 0.0, 0.0),
            r"body 1, at \([\d.]+, 0\) m, leaves the map: keep the box .* \(-1e\+06 to 0.2 m in x",
        ),
        (
            dict(layer_depth=0.02),
            DOWN,
            "body 1 is pressed through the soil's layer, layer_depth = 0.0[0-9]+ m: raise layer_depth, lighten the body or take a stronger",
        ),
        (dict(max_tiles=3), DOWN, "the soil's pool is full, max_tiles = 3 of .*: raise max_tiles"),
    ],
)
def test_a_refused_step_says_why(tmp_path, parameters, velocity, text):
    bodies = Bodies(box(tmp_path / "pad.stl", 0.1, 0.1, 0.04), **parameters)
    bodies.place(1, 0.0, 0.0, 5.0)
    bodies.place(0, 0.0, 0.0, 0.1)
    with pytest.raises(ModelError, match=text):
        bodies.move(0.2, (0.0, 0.0, -0.5), h=1e-2)
        bodies.move(1.0, velocity, h=1e-2)


def test_a_body_needs_a_mesh(tmp_path):
    with pytest.raises(
        ModelError, match=r"scm: body\[2\].mesh names no file: give the path of a closed mesh \(.stl, .obj or .ply, in metres\)"
    ):
        Instance(SCM(1, 0, N_BODIES), "scm", **{"body[1].mesh": box(tmp_path / "pad.stl", 0.1, 0.1, 0.1)}).initialise()


def test_a_body_too_narrow_for_the_soil_is_refused(tmp_path):
    text = r"body\[1\].mesh = pad.stl: its width b = 0.01 m gives k_c/b \+ k_phi <= 0; give body\[1\].b above 0.01158 m, or another soil"
    with pytest.raises(ModelError, match=text):
        Bodies(box(tmp_path / "pad.stl", 0.02, 0.02, 0.02))


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda mesh: mesh.apply_scale(1000.0), "plate.stl is 200 m across: the file is most likely in millimetres; scale it by 0.001"),
        (
            lambda mesh: mesh.update_faces(np.arange(len(mesh.faces)) > 0),
            "plate.stl is open: 3 of its 18 edges have no second face; close it",
        ),
    ],
    ids=["millimetres", "open"],
)
def test_what_is_wrong_with_a_mesh_is_said_by_the_model_and_by_its_fmu(tmp_path, change, text):
    mesh = trimesh.creation.box((0.2, 0.15, 0.05))
    change(mesh)
    mesh.export(tmp_path / "plate.stl")
    with pytest.raises(ModelError, match=rf"^body\[1\].mesh = {text}"):
        Bodies(tmp_path / "plate.stl")
    path = build_fmu(SCM(1, 0, N_BODIES), tmp_path / "scm.fmu")
    slave = Slave("ground", fmpy.read_model_description(str(path)), fmpy.extract(str(path)), print)
    slave.connect([], np.zeros(0), [], np.zeros(0))
    with pytest.raises(SlaveError, match=rf"ground.*body\[1\].mesh = {text}"):
        slave.initialise(0.0, None, {"body[1].mesh": str(tmp_path / "plate.stl")})
    slave.close()


def test_the_identifier_and_the_ports_carry_the_sizes():
    model = SCM(1, 2, 3)
    assert model.identifier == "cdl_scm_w1p2b3"
    assert {"body[3].mesh", "base", "wheel_mesh"} < set(model.files)
    names = {part: {re.sub(r"\[\d\]$", "", s.name) for s in model.scalars[part]} for part in "puy"}
    assert {"body[3].r_0", "body[3].v_0", "body[3].w_0"} < names["u"]
    assert {"body[3].f_0", "body[3].t_0"} < names["y"] and "body[3].b" in names["p"]
