"""The rover crossing a fixed rock on a fixed floor, half of it above: bounded at 1 ms, whatever the stiffness and damping."""

import numpy as np
import pytest
from hard import Coupled, export, floor

from cdl_fmu.mesh.rocks import rock
from cdl_fmu.rbc import RBC
from cdl_fmu.vem import VEM

WEIGHT = 54.0 * 9.81  # Table 8.2


@pytest.fixture(scope="module")
def bodies(tmp_path_factory):
    folder = tmp_path_factory.mktemp("meshes")
    stone = export(folder / "rock.stl", rock(3, (0.22, 0.20, 0.10)))
    return [(floor(folder / "floor.stl"), {"fixed": "on"}), (stone, {"fixed": "on", "x": 0.85})]


def crossing(bodies, contact, hard=None, h=1e-3, **options):
    """Height [m] and load of both wheels [N], over each millisecond, of the rover with grousers whose front wheel climbs the rock."""
    system = Coupled(contact, bodies, {"start.z": 0.135, "start.x": 0.34}, hard, h=h, **options)
    per = round(1e-3 / h)
    rows = []
    for k in range(round(1.2 / h)):
        system.rover.u.command.wheel_rate[:] = min(2.0, 10.0 * k * h)
        system.step()
        rows.append((system.rover.y.body.r_0[2], system.rover.y.applied["f_0"][:, 2].sum()))
    return np.array(rows).reshape(-1, per, 2).mean(axis=1)


def springs(k, ratio):
    return {"effective_mass": 5.0, **{f"body[{j}].{name}": v for j in (1, 2) for name, v in (("k", k), ("damping_ratio", ratio))}}


@pytest.mark.parametrize("ratio", [0.05, 0.3, 1.0])
@pytest.mark.parametrize(("k", "jacobi"), [(1e6, False), (1e7, False), (1e8, False), (1e6, True)])
def test_vem_is_stable(bodies, k, ratio, jacobi):
    rows = crossing(bodies, VEM(2, 0, 2), springs(k, ratio), jacobi=jacobi)
    height, load = rows.T
    assert height.min() > 0.130 and height.max() < 0.165
    assert load.mean() == pytest.approx(WEIGHT, rel=0.02)  # as it neither flies nor falls


def test_stiff_springs_come_near_to_rigid_contact(bodies):
    heights = [crossing(bodies, contact, hard)[:, 0] for contact, hard in ((VEM(2, 0, 2), springs(1e8, 1.0)), (RBC(2, 2), None))]
    assert np.sqrt(np.mean((heights[0] - heights[1]) ** 2)) < 5e-4


def test_rbc_agrees_with_a_finer_step(bodies):
    coarse, fine = crossing(bodies, RBC(2, 2)), crossing(bodies, RBC(2, 2), h=2e-4)
    assert np.sqrt(np.mean((coarse[:, 0] - fine[:, 0]) ** 2)) < 2e-4
