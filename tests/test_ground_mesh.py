"""BCM and VEM on ground that is a mesh: the contact plane of Fig. 8.4 fitted in it."""

import math

import numpy as np
import pytest
import trimesh

from cdl_fmu.bcm import BCM
from cdl_fmu.frames import axis_rotation
from cdl_fmu.slave.model import Instance, ModelError
from cdl_fmu.vem import VEM
from orchestrator.drive import simulate
from orchestrator.experiment import ExperimentError, load_experiment
from orchestrator.results import open_result

both = pytest.mark.parametrize(("model", "flat", "depth"), [(BCM(1, n_grounds=1), BCM(1), 0.025), (VEM(1, n_grounds=1), VEM(1), 3e-4)])
SMOOTH = {"n_g": 0}


def sheet(path, slope=0.0, height=lambda x, y: 0.0 * x, spacing=0.25):
    """An open surface that rises along x."""
    x, y = np.arange(-2.0, 4.01, spacing), np.arange(-1.0, 1.01, spacing)
    X, Y = np.meshgrid(x, y, indexing="ij")
    vertices = np.stack([X, Y, math.tan(slope) * X + height(X, Y)], axis=2).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(len(x) - 1), np.arange(len(y) - 1), indexing="ij")
    a = (i * len(y) + j).ravel()
    b, c, d = a + len(y), a + len(y) + 1, a + 1
    mesh = trimesh.Trimesh(vertices, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]), process=False)
    mesh.export(path)
    return path


def wrench_of(instance, r_0, v_0=(0.1, 0.0, 0.0), slope=0.0, rate=1.0):
    wheel = instance.u.wheel[0]
    T = axis_rotation(2, -slope)
    wheel.r_0[:], wheel["T"][:] = r_0, T
    wheel.v_0[:], wheel.w_0[:] = T.T @ v_0, (0.0, rate, 0.0)
    instance.step(0.0, 1e-3)
    return np.concatenate([instance.y.wheel[0].f_0, instance.y.wheel[0].t_0])


@both
def test_a_level_mesh_is_flat_ground(model, flat, depth, tmp_path):
    on_mesh, on_flat = Instance(model, ground=sheet(tmp_path / "flat.stl"), **SMOOTH), Instance(flat, **SMOOTH)
    for instance in (on_mesh, on_flat):
        instance.initialise()
    for x in (0.0, 0.11, 0.3):
        r_0 = x, 0.02, 0.125 - depth
        assert wrench_of(on_mesh, r_0) == pytest.approx(wrench_of(on_flat, r_0), rel=1e-6, abs=1e-6)


@both
def test_a_slope_is_the_level_case_turned(model, flat, depth, tmp_path):
    slope = 0.2
    on_mesh, on_flat = Instance(model, ground=sheet(tmp_path / "slope.ply", slope), **SMOOTH), Instance(flat, **SMOOTH)
    for instance in (on_mesh, on_flat):
        instance.initialise()
    up = np.array([-math.sin(slope), 0.0, math.cos(slope)])
    turned = wrench_of(on_mesh, (0.125 - depth) * up, slope=slope)
    T = axis_rotation(2, -slope)
    level = wrench_of(on_flat, (0.0, 0.0, 0.125 - depth))
    assert T @ turned[:3] == pytest.approx(level[:3], rel=2e-3, abs=0.3)
    assert T @ turned[3:] == pytest.approx(level[3:], rel=2e-3, abs=0.05)


@both
def test_a_wheel_beside_the_mesh_and_a_missing_mesh_are_refused(model, flat, depth, tmp_path):
    instance = Instance(model, ground=sheet(tmp_path / "flat.stl"))
    instance.initialise()
    with pytest.raises(ModelError, match=r"wheel 1, at \(9, 0, 0\.12\) m, has no ground below its top: keep it on the mesh"):
        wrench_of(instance, (9.0, 0.0, 0.12))
    with pytest.raises(ModelError, match="ground names no file: give the path of the ground's mesh"):
        Instance(model).initialise()
    with pytest.raises(ModelError, match=r"ground = .*mesh\.stl"):
        (tmp_path / "mesh.stl").write_text("nothing")
        Instance(model, ground=tmp_path / "mesh.stl").initialise()


@pytest.mark.parametrize("tier", ["BCM", "VEM"])
def test_a_rover_drives_over_waves(tier, tmp_path):
    """Its wheels follow the ground, and the loads of both sum to the weight but for what lifts and lowers it."""
    waves = sheet(tmp_path / "waves.stl", height=lambda x, y: 0.03 * np.sin(4.0 * x) * np.cos(3.0 * y), spacing=0.05)
    outcome = simulate(
        "two_wheel", tmp_path / "out", tiers=[tier, tier], overrides={f"{tier.lower()}.ground": str(waves)}, stop_time=3.0, picture=False
    )
    result = open_result(outcome.result)
    x, y, z = (result.cdl[f"rover.wheel[1].r_0[{k}]"].values for k in (1, 2, 3))
    above = z - 0.03 * np.sin(4.0 * x) * np.cos(3.0 * y)
    assert np.ptp(z) > 0.02
    assert np.ptp(above) < (0.004 if tier == "BCM" else 0.002)
    loads = sum(result.cdl[f"{tier.lower()}.diagnostics[{k}].normal_load"].values for k in (1, 2))
    assert loads == pytest.approx(54 * 9.81, rel=0.05)


def test_a_mesh_and_scm_are_refused_together(tmp_path):
    path = sheet(tmp_path / "flat.stl")
    with pytest.raises(ExperimentError, match=r"bcm\.ground: all wheels stand on the soil of the one on SCM; give scm\.base"):
        load_experiment("two_wheel", tiers=["SCM", "BCM"], overrides={"bcm.ground": str(path)})
    with pytest.raises(ValueError, match="n_grounds = 1: choose 0, or without patches 1"):
        BCM(1, 1, n_grounds=1)
