"""VEM between wheels and bodies, in several points: sums of springs, action and reaction, no jumps, and its Jacobian."""

import math

import numpy as np
import pytest
import trimesh
from hard import export, floor

from cdl_fmu.frames import axis_rotation
from cdl_fmu.mesh.rocks import rock
from cdl_fmu.rbc import RBC
from cdl_fmu.slave.model import Instance, ModelError
from cdl_fmu.vem import VEM

R, K = 0.125, 1e6
SMOOTH = {"n_g": 0.0, "h_g": 0.0}


@pytest.fixture(scope="module")
def meshes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("meshes")
    return {
        "floor": floor(folder / "floor.stl"),
        "cube": export(folder / "cube.stl", trimesh.creation.box((0.2, 1.0, 0.2))),
        "rock": export(folder / "rock.stl", rock(3, (0.22, 0.20, 0.10))),
        "stone": export(folder / "stone.stl", rock(5, (0.18, 0.16, 0.09))),
    }


def meeting(*paths, n_wheels=1, fixed=True, **parameters):
    """Wheels and bodies with these meshes, the wheels out of the way."""
    given = {f"body[{j}].mesh": path for j, path in enumerate(paths, 1)}
    for j in range(1, len(paths) + 1):
        given |= {f"body[{j}].fixed": "on" if fixed else "off", f"body[{j}].k": K}
    instance = Instance(VEM(n_wheels, 0, len(paths)), **(SMOOTH | given | parameters))
    for wheel in instance.u.wheel:
        put(wheel, (0.0, 0.0, 9.0))
    instance.initialise()
    return instance


def put(tool, r, v=(0.0, 0.0, 0.0), w=(0.0, 0.0, 0.0), T=None):
    tool.r_0[:], tool.v_0[:], tool.w_0[:] = r, v, w
    tool["T"][:] = np.eye(3) if T is None else T


def tools(instance):
    """Inputs and answers of all tools."""
    return list(zip((*instance.u.wheel, *instance.u.body), (*instance.y.wheel, *instance.y.body)))


def pairs(instance):
    return [pair for pair in instance.y.pair if pair.on > 0.0]


@pytest.mark.parametrize("normal_model", ["linear", "bekker"])
def test_a_floor_is_flat_ground_met_at_both_ends_of_the_rim(meshes, normal_model):
    """Two springs, so each has half the stiffness; friction, torque and damping with them. Bekker's spring is of the whole width."""
    law = {"normal_model": normal_model, "k_c": 0.0, "k_phi": 5e6, "n": 0.8, "b_w": 0.125}
    linear = normal_model == "linear"
    on_floor = meeting(meshes["floor"], **law | {"body[1].k": K / 2, "effective_mass": 5.0, "body[1].damping_ratio": 0.4})
    flat = Instance(VEM(1), **SMOOTH | law | {"k": K, "effective_mass": 10.0, "damping_ratio": 0.4, "k_phi": 5e6 if linear else 1e7})
    flat.initialise()
    for v, w in (((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), ((0.1, 0.02, -0.01), (0.0, 1.0, 0.0)), ((0.02, 0.0, 0.01), (0.0, -2.0, 0.0))):
        for instance in (on_floor, flat):
            put(instance.u.wheel[0], (0.3, 0.1, R - 5e-4), v, w, axis_rotation(2, 0.7))
            instance.step(0.0, 1e-3)
        one, two = flat.y.wheel[0], on_floor.y.wheel[0]
        assert len(pairs(on_floor)) == 2
        if linear or not any(v):  # damping by Lehr goes with the root of a stiffness, so two halves of Bekker's make 1.41
            assert two.f_0[2] == pytest.approx(one.f_0[2], rel=1e-6)
            # The contact point is halfway into the overlap, and slides that much slower.
            assert two.f_0[:2] == pytest.approx(one.f_0[:2], rel=0.01, abs=1e-9)
            assert two.t_0 == pytest.approx(one.t_0, rel=0.01, abs=1e-3)
    assert on_floor.y.body[0].f_0 == pytest.approx(-on_floor.y.wheel[0].f_0)


def test_a_wheel_between_two_edges(meshes):
    """Two cubes 120 mm apart: each edge presses towards the axle, at both ends of the rim."""
    wheel = meeting(meshes["cube"], meshes["cube"], **{"body[1].mu": 0.0, "body[2].mu": 0.0})
    for body, x in zip(wheel.u.body, (-0.16, 0.16)):
        put(body, (x, 0.0, -0.1))
    sine, depth = 0.06 / (R - 4e-4), 4e-4
    put(wheel.u.wheel[0], (0.0, 0.0, math.sqrt((R - depth) ** 2 - 0.06**2)))
    wheel.step(0.0, 1e-3)
    assert wheel.y.wheel[0].f_0 == pytest.approx([0.0, 0.0, 4.0 * K * depth * math.sqrt(1.0 - sine**2)], rel=1e-4, abs=1e-3)
    assert wheel.y.body[0].f_0[0] == pytest.approx(-2.0 * K * depth * sine, rel=1e-4)
    assert wheel.y.diagnostics[0].sinkage == pytest.approx(depth, rel=1e-4)


def test_a_wheel_in_a_groove(meshes):
    """Two floors at 45 degrees."""
    wheel = meeting(meshes["floor"], meshes["floor"], **{"body[1].mu": 0.0, "body[2].mu": 0.0})
    depth, turns = 3e-4, [axis_rotation(2, sign * 0.25 * math.pi) for sign in (1.0, -1.0)]
    normals = [turn.T @ (0.0, 0.0, 1.0) for turn in turns]
    for body, turn, normal in zip(wheel.u.body, turns, reversed(normals)):
        put(body, 4.0 * normal, T=turn)  # each goes up along the other one's normal
    put(wheel.u.wheel[0], (R - depth) * (normals[0] + normals[1]))
    wheel.step(0.0, 1e-3)
    expected = 2.0 * K * depth * (normals[0] + normals[1])
    assert wheel.y.wheel[0].f_0 == pytest.approx(expected, rel=1e-6, abs=1e-6)


def heap(meshes, **parameters):
    """A wheel between two stones, one the other turned about z, that lie on a floor, all a little deep and on the move."""
    instance = meeting(meshes["floor"], meshes["stone"], meshes["stone"], **{"body[2].fixed": "off", "body[3].fixed": "off"}, **parameters)
    random = np.random.default_rng(4)
    z = trimesh.load_mesh(meshes["stone"]).vertices[:, 2]
    for body, x in zip(list(instance.u.body)[1:], (-0.1, 0.1)):
        put(body, (x, 0.0, -z.min() - 2e-4), 0.05 * random.normal(size=3), random.normal(size=3), axis_rotation(3, math.pi * (x > 0.0)))
    z = np.ptp(z) + R  # from above down to where it touches both
    wheel = instance.u.wheel[0]
    while True:
        put(wheel, (0.0, 0.0, z), 0.05 * random.normal(size=3), (0.1, 1.5, -0.2), axis_rotation(2, math.pi / 12.0))
        instance.step(0.0, 1e-3)
        if {pair.against for pair in pairs(instance) if pair.on == 1.0} == {3.0, 4.0}:
            return instance
        z -= 1e-4
        assert z > 0.1


@pytest.mark.parametrize("grousers", [False, True])
def test_action_is_reaction(meshes, grousers):
    """Forces of all bodies sum up to 0, and so do their torques about any point."""
    instance = heap(meshes, **({"n_g": 12.0, "h_g": 0.01} if grousers else {}))
    force, torque, most = np.zeros(3), np.zeros(3), 0.0
    for tool, wrench in tools(instance):
        force += wrench.f_0
        torque += wrench.t_0 + np.cross(tool.r_0, wrench.f_0)
        most = max(most, np.abs(wrench.f_0).max())
    assert most > 50.0
    assert np.abs(force).max() < 1e-12 * most and np.abs(torque).max() < 1e-12 * most


def test_the_pairs_are_the_wrenches(meshes):
    instance = heap(meshes)
    sums = np.zeros((4, 6))
    for pair in pairs(instance):
        f = pair["axes"].T @ pair.F
        for tool, sign in ((int(pair.on) - 1, 1.0), (int(pair.against) - 1, -1.0)):
            sums[tool] += sign * np.concatenate([f, np.cross(pair.point_0 - tools(instance)[tool][0].r_0, f)])
    for total, (tool, wrench), anchor in zip(sums, tools(instance), instance.y.anchor):
        assert total == pytest.approx(np.concatenate([wrench.f_0, wrench.t_0]), rel=1e-9, abs=1e-9)
        assert np.array_equal(anchor.r_0, tool.r_0) and np.array_equal(anchor["T"], tool["T"]) and np.array_equal(anchor.v_0, tool.v_0)


def test_the_jacobian_of_several_points_is_the_derivative(meshes):
    """Small motions of the wheel change its wrench as the pairs say; friction by its secant, so there is none here."""
    instance = heap(meshes, **{f"body[{j}].mu": 0.0 for j in (1, 2, 3)})
    wheel, start, velocity = instance.u.wheel[0], instance.u.wheel[0].r_0.copy(), instance.u.wheel[0].v_0.copy()
    stiffness, damping = np.zeros((3, 3)), np.zeros((3, 3))
    for pair in pairs(instance):
        if pair.on == 1.0:
            stiffness += pair["axes"].T @ np.diag(pair.K) @ pair["axes"]
            damping += pair["axes"].T @ np.diag(pair.D) @ pair["axes"]

    def change(port, at, e):
        port[:] = at + e
        instance.step(0.0, 1e-3)
        more = instance.y.wheel[0].f_0.copy()
        port[:] = at - e
        instance.step(0.0, 1e-3)
        less, port[:] = instance.y.wheel[0].f_0.copy(), at
        return (more - less) / 2.0

    for e in np.eye(3):
        assert change(wheel.r_0, start, 1e-7 * e) / 1e-7 == pytest.approx(-stiffness @ e, abs=0.03 * K)  # that the normal turns is left out
        assert change(wheel.v_0, velocity, 1e-6 * e) / 1e-6 == pytest.approx(-damping @ e, rel=1e-4, abs=0.02)


@pytest.mark.parametrize(("grousers", "depth", "most"), [(False, 1e-3, 1.5), (True, 3e-4, 1.5), (True, 1e-3, 10.0)])
def test_rolling_over_a_rock_the_force_does_not_jump(meshes, grousers, depth, most):
    """From step to step it changes by no more than k times the change of the gap; deep grousers by 10 times that, 1 % of it."""
    shape = {"n_g": 12.0, "h_g": 0.01} if grousers else {}
    instance = meeting(meshes["rock"], reach=0.05, **{"body[1].mu": 0.0, "body[1].damping_ratio": 0.0}, **shape)
    top, radius = trimesh.load_mesh(meshes["rock"]).vertices[:, 2].max(), R + (0.01 if grousers else 0.0)
    forces, depths = [], []
    for x in np.arange(-0.05, 0.05, 1e-4):
        z = top + radius - depth - 0.15 * (1.0 - math.cos(2.0 * x))
        put(instance.u.wheel[0], (x, 0.0, z), T=axis_rotation(2, x / radius))
        instance.step(0.0, 1e-3)
        forces.append(instance.y.wheel[0].f_0.copy())
        depths.append(instance.y.diagnostics[0].sinkage)
    assert max(depths) > 0.8 * depth
    assert np.abs(np.diff(forces, axis=0)).max() < most * K * np.abs(np.diff(depths)).max()


def test_what_leaves_is_not_held(meshes):
    wheel = meeting(meshes["floor"])
    put(wheel.u.wheel[0], (0.0, 0.0, R - 2e-4), (0.3, 0.0, 2.0))
    wheel.step(0.0, 1e-3)
    assert not wheel.y.wheel[0].f_0.any() and not wheel.y.body[0].f_0.any()


def test_the_weight_of_a_contact_switches_it(meshes):
    wheel = meeting(meshes["floor"])
    forces = []
    for weight in (1.0, 0.25, 0.0):
        put(wheel.u.wheel[0], (0.0, 0.0, R - 2e-4))
        wheel.u.wheel[0].active = weight
        wheel.step(0.0, 1e-3)
        forces.append(wheel.y.wheel[0].f_0[2])
    assert forces == pytest.approx([2.0 * K * 2e-4, 0.5 * K * 2e-4, 0.0])


def test_a_refused_step_changes_nothing(meshes):
    instance = meeting(meshes["floor"], n_wheels=2)
    instance.u.wheel[0]["T"][:] = 0.0  # no pose yet
    instance.u.wheel[1].r_0[2] = R - 0.015
    before = instance.block[instance.slices["x"]].copy()
    with pytest.raises(ModelError, match=r"body 1, at \(0, 0, 0\) m, is overlapped by more than reach = 0.005 m: start what touches it"):
        instance.step(0.0, 1e-3)
    assert np.array_equal(instance.block[instance.slices["x"]], before)
    instance.u.wheel[1].r_0[2] = math.nan
    with pytest.raises(ModelError, match=r"wheel\[2\].r_0\[3\] = nan m: it must be finite"):
        instance.step(0.0, 1e-3)
    assert np.array_equal(instance.block[instance.slices["x"]], before)
    instance.u.wheel[1].r_0[2] = R
    for _ in range(2):
        instance.step(0.0, 1e-3)
    assert "wheel 1 has no pose yet" in instance.warnings[0]
    with pytest.raises(ModelError, match=r"wheel\[1\] still has no pose after 2 steps"):
        instance.step(0.0, 1e-3)


def test_a_body_needs_a_mesh():
    with pytest.raises(ModelError, match=r"body\[1\].mesh names no file"):
        Instance(VEM(1, 0, 1)).initialise()


@pytest.mark.parametrize("model", [VEM(1, 0, 1), RBC(1, 1)], ids=lambda m: m.identifier)
@pytest.mark.parametrize(
    ("thing", "height"), [(trimesh.creation.icosphere(2, 0.03), 0.0), (trimesh.creation.box((2.0, 2.0, 0.2)), 0.15)], ids=["ball", "slab"]
)
def test_a_wheel_deep_within_a_body_or_around_it_is_refused(model, thing, height, tmp_path):
    """Deeper than contacts are looked for, where there would be none: a stone in the wheel, the wheel half in a slab."""
    thing.export(tmp_path / "thing.stl")
    instance = Instance(model, **{"body[1].mesh": tmp_path / "thing.stl"})
    instance.u.wheel[0].r_0[2] = height
    instance.u.body[0].r_0[0] = 1e-3
    with pytest.raises(ModelError, match=r"body 1, at \(0\.001, 0, 0\) m, is overlapped by more than reach = 0\.005 m: start"):
        instance.initialise()
        instance.u.wheel[0].v_0[0] = 1e-3  # with a pose of all zeros it would not have been set yet
        instance.step(0.0, 1e-3)
