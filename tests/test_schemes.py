"""Coupling schemes: stability on stiff contacts, agreement, order of the slaves, and what the master says when a slave fails."""

import numpy as np
import pytest
from systems import rover_on

from cdl_fmu import BCM
from orchestrator.results import open_result
from orchestrator.run import run
from orchestrator.schemes import SCHEMES, _move_on, _twist_indices

WEIGHT = (50.0 + 2 * 2.0) * 9.81  # Table 8.2


def drive(system, folder, scheme="ij", step=1e-3, **options):
    outcome = run(system, folder, scheme=scheme, step=step, **options)
    return outcome, open_result(outcome.result)


def spring(n=2):
    from linear_spring import LinearSpring  # an example; systems.py puts the folder on the path

    return LinearSpring(n)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_the_rover_rests_where_the_soil_bears_it(scheme, tmp_path):
    system = rover_on(tmp_path, BCM(2), start_z=0.0990, stop_time=1.0)
    _, result = drive(system, tmp_path, scheme)
    total = sum(result.cdl[f"contact.wheel[{i}].f_0[3]"].values[-1] for i in (1, 2))
    assert total == pytest.approx(WEIGHT, rel=1e-4)
    assert result.cdl["rover.body.r_0[3]"].values[-1] == pytest.approx(0.098994, abs=2e-6)


@pytest.mark.parametrize("scheme", ["ij", "jacobi"])
def test_a_contact_of_1e6_newton_per_metre_is_stable_at_1_ms(scheme, tmp_path):
    system = rover_on(tmp_path, spring(), start_z=0.126, stop_time=1.0, k=1e6, d=2e3)
    _, result = drive(system, tmp_path, scheme)
    z = result.cdl["rover.body.r_0[3]"].values
    assert np.isfinite(z).all() and z.min() > 0.12 and z.max() < 0.127
    late = result.time.values > 0.8
    assert np.ptp(z[late]) < 1e-6
    assert z[-1] == pytest.approx(0.125 - WEIGHT / 2 / 1e6, abs=1e-6)


@pytest.mark.parametrize(
    ("contact", "reason"), [({"d": 10.0, "v_s": 1.0}, "its spring (omega = "), ({"v_s": 1e-3}, "friction and damping")]
)
def test_explicit_exchange_of_a_stiff_contact_is_warned_about_once_a_wheel(contact, reason, tmp_path):
    system = rover_on(tmp_path, spring(), start_z=0.1248, stop_time=0.2, k=1e6, **contact)
    outcome, _ = drive(system, tmp_path, "gs-mid")
    assert 1 <= len(outcome.warnings) <= 2
    assert all(w.startswith("rover.wheel[") and reason in w and "use scheme ij or a smaller step" in w for w in outcome.warnings)
    assert drive(system, tmp_path, "ij")[0].warnings == []


def test_soft_soil_under_an_explicit_exchange_needs_no_warning(tmp_path):
    system = rover_on(tmp_path, BCM(2), start_z=0.099, stop_time=0.2, c_d=3.0, V_j=0.05)
    outcome, _ = drive(system, tmp_path, "gs", step=1e-4)
    assert outcome.warnings == []


def test_schemes_agree_as_the_step_shrinks(tmp_path):
    """A drop of 5 mm on soil: the interface Jacobian at 1 ms against the fixed point at 0.1 ms."""
    system = rover_on(tmp_path, BCM(2), start_z=0.104, stop_time=0.3)
    _, fine = drive(system, tmp_path / "fine", "aitken", step=1e-4, record_interval=1e-3)
    reference = fine.cdl["rover.body.r_0[3]"].values
    for scheme in ("ij", "gs-mid", "aitken"):
        _, result = drive(system, tmp_path / scheme, scheme)
        assert np.abs(result.cdl["rover.body.r_0[3]"].values - reference).max() < 4e-4, scheme


def test_mid_step_pose_is_the_pose_half_a_step_later():
    rate, dt = np.array([0.3, -0.2, 0.5]), 0.01
    u = np.concatenate([[1.0, 2.0, 3.0], np.eye(3).ravel(), [4.0, 5.0, 6.0], rate])
    at = (np.arange(3), np.arange(3, 12), np.arange(12, 15), np.arange(15, 18))
    _move_on(u, at, dt)
    T = u[3:12].reshape(3, 3)
    assert u[:3] == pytest.approx([1.04, 2.05, 3.06])
    assert pytest.approx(np.eye(3), abs=1e-15) == T @ T.T
    # A vector fixed to the body moves with w x r: T' is the body's rotation.
    r = np.array([0.1, 0.7, -0.3])
    assert T.T @ r == pytest.approx(r + dt * np.cross(rate, r), abs=1e-4)


def test_free_twists_are_those_of_wheels_then_bodies():
    class Slave:
        inputs = [
            *(f"{tool}.{part}[{k}]" for tool in ("body[1]", "wheel[10]", "wheel[2]") for part in ("w_0", "r_0", "v_0") for k in (1, 2, 3)),
            *(f"free_twist[{k}]" for k in range(1, 19)),
        ]

    twists, free = _twist_indices(Slave)
    expected = [f"{tool}.{part}[{k}]" for tool in ("wheel[2]", "wheel[10]", "body[1]") for part in ("v_0", "w_0") for k in (1, 2, 3)]
    assert [Slave.inputs[i] for i in twists] == expected
    assert [Slave.inputs[i] for i in free] == [f"free_twist[{k}]" for k in range(1, 19)]
    Slave.inputs = Slave.inputs[:27]
    assert _twist_indices(Slave) is None
