"""SCM wheels as point clouds from a mesh: the analytic wheel's forces, and which parts of a surface are finer than a cell."""

import numpy as np
import pytest
import trimesh
from soil import BARE, LOAD, Carriage, R, on_soil, scm, towards, volume_error

from cdl_fmu.cloud import load_cloud
from cdl_fmu.scm.features import FLANK, SURFACE, TIP, with_kinds
from cdl_fmu.slave.model import ModelError
from cdl_fmu.wheel_mesh import wheel_mesh

H = 2e-3
WHEEL = dict(r_w=R, b_w=0.125, h_g=0.01, t_g=0.002)
F_X, F_Y, F_Z, T_Y = 0, 1, 2, 4


@pytest.fixture(scope="module")
def wheel_file(tmp_path_factory):
    """The mesh of the wheel with this many grousers."""
    folder = tmp_path_factory.mktemp("wheels")

    def of(n_g):
        path = folder / f"wheel{n_g}.stl"
        if not path.exists():
            wheel_mesh(n_g=n_g, **WHEEL).export(path)
        return path

    return of


def drive(heading, slip=0.2, **parameters):
    """Readings at rest on the ground, and of a drive at constant depth."""
    carriage = Carriage(scm(**parameters), depth=-0.001, heading=heading)
    carriage.move(0.29, h=H, up=-0.1)
    rest = carriage.move(0.02, h=H)[-1]
    rolling = carriage.move(1.2, h=H, forward=0.1, rate=0.1 / (1.0 - slip) / R)
    assert volume_error(carriage.instance) == 0.0
    return rest, rolling[len(rolling) // 3 :].mean(axis=0), carriage.instance


@pytest.mark.parametrize("n_g", [0, 12])
@pytest.mark.parametrize("heading", [0.0, 20.0])
def test_a_meshed_wheel_feels_what_the_analytic_one_does(wheel_file, n_g, heading):
    analytic = drive(towards(heading), n_g=n_g)
    meshed = drive(towards(heading), n_g=n_g, wheel_mesh=wheel_file(n_g))
    for one, other in zip(analytic[:2], meshed[:2]):
        load = one[F_Z]
        assert load > 150.0
        assert other[[F_X, F_Y, F_Z]] == pytest.approx(one[[F_X, F_Y, F_Z]], abs=0.02 * load)
        assert other[T_Y] == pytest.approx(one[T_Y], abs=0.02 * load * R)
    assert meshed[1][F_X] > 0.2 * meshed[1][F_Z]
    one, other = analytic[2].y, meshed[2].y
    assert other.contact[0].in_contact == 1.0
    assert other.contact[0].axes == pytest.approx(one.contact[0].axes)
    assert other.diagnostics[0].sinkage == pytest.approx(one.diagnostics[0].sinkage)
    assert other.diagnostics[0].theta_entry == pytest.approx(one.diagnostics[0].theta_entry, abs=0.1)


def test_the_jacobian_of_a_meshed_wheel_carries_it(wheel_file):
    """Its stiffness and damping settle the wheel under its load, at the depth of the analytic one."""
    analytic, meshed = on_soil(n_g=12), on_soil(n_g=12, wheel_mesh=wheel_file(12))
    assert meshed.instance.y.wheel[0].f_0[2] == pytest.approx(LOAD, rel=0.01)
    assert meshed.sinkage == pytest.approx(analytic.sinkage, rel=0.01)


def test_a_wheel_that_slides_sideways_is_pushed_back(wheel_file):
    def push(**more):
        carriage = Carriage(scm(n_g=0, **more), depth=0.028)
        readings = carriage.move(0.3, h=H, forward=0.1, sideways=0.036, rate=0.8)
        return readings[50:, F_Y].mean() / readings[50:, F_Z].mean()

    assert push() < -0.1
    assert push(wheel_mesh=wheel_file(0)) == pytest.approx(push(), abs=0.04)


@pytest.mark.parametrize("cell", [0.01, 0.005])
def test_grousers_are_finer_than_a_cell(wheel_file, cell):
    elements = load_cloud(wheel_file(12), 0.25 * cell).elements
    kinds = with_kinds(elements, cell)
    n = len(elements)
    assert np.array_equal(kinds[:n, :7], elements)
    radius = np.hypot(elements[:, 0], elements[:, 2])
    radial = (elements[:, 3] * elements[:, 0] + elements[:, 5] * elements[:, 2]) / radius
    tip = (radius > 0.1345) & (radial > 0.9)
    flank = (np.abs(radial) < 0.3) & (np.abs(elements[:, 4]) < 0.1)
    assert np.array_equal(kinds[:n, 7], np.where(tip, TIP, np.where(flank, FLANK, SURFACE)))
    # Below the tips the rim goes on.
    below = kinds[n:]
    assert below[:, 6].sum() == pytest.approx(12 * 0.002 * 0.125, rel=1e-3)
    assert np.hypot(below[:, 0], below[:, 2]) == pytest.approx(R, abs=2e-5)
    assert (below[:, 7] == SURFACE).all()


@pytest.mark.parametrize(
    "mesh",
    [
        trimesh.creation.icosphere(3, 0.03),
        trimesh.creation.box((0.2, 0.1, 0.03)),
        trimesh.creation.box((0.2, 0.1, 0.002)),
        trimesh.creation.cone(0.05, 0.1, sections=64),
    ],
    ids=["ball", "pad", "sheet", "cone"],
)
def test_bodies_without_fine_features_have_none(mesh, tmp_path):
    mesh.export(tmp_path / "body.stl")
    elements = load_cloud(tmp_path / "body.stl", 0.0025).elements
    assert (with_kinds(elements, 0.01)[:, 7] == SURFACE).all()


def test_a_wheel_in_millimetres_is_refused_by_the_name_of_its_parameter(tmp_path):
    mesh = wheel_mesh(n_g=0, **WHEEL)
    mesh.apply_scale(1000.0)
    mesh.export(tmp_path / "wheel.stl")
    with pytest.raises(ModelError, match=r"^wheel_mesh = wheel.stl is 250 m across: the file is most likely in millimetres; scale it by"):
        scm(wheel_mesh=tmp_path / "wheel.stl", **BARE)
