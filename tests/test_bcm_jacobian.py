"""The interface Jacobian that BCM sends: stiffness and damping against finite differences, anchor and contact frame."""

import numpy as np
import pytest

from cdl_fmu import BCM, Instance, load_soil
from cdl_fmu.frames import axis_rotation

SOIL = load_soil("mss_d")
R = 0.125
DRIVING = dict(v=(0.1, 0.02, -0.01), w=(0.0, 1.0, 0.2))


def bcm(**parameters) -> Instance:
    instance = Instance(BCM(), **(SOIL | parameters))
    instance.initialise()
    return instance


def force_in_axes(instance, z, v, w, T=None):
    """F of the contact, with the wheel's centre at R - z above the ground."""
    wheel = instance.u.wheel[0]
    wheel.r_0[:] = (0.0, 0.0, R - z)
    wheel["T"][:] = np.eye(3) if T is None else T
    wheel.v_0[:], wheel.w_0[:] = v, w
    instance.step(0.0, 1e-3)
    return instance.y.contact[0].F.copy()


CAMBERED = axis_rotation(1, 0.15)


@pytest.mark.parametrize(
    ("parameters", "T", "tolerance"),
    [
        (dict(n_g=0, c=0), None, 1e-4),
        (dict(n_g=0, c=0, rho=0), CAMBERED, 1e-4),
        (dict(n_g=0, c=0, eta=0.0), None, 1e-4),
        (dict(n_g=0, c=0, normal_model="wong_reece"), None, 1e-4),
        (dict(n_g=0), None, 2e-3),  # the cohesion of soil that comes into contact is left out
        (dict(), None, 1e-2),  # so are the grousers' faces
    ],
)
def test_normal_stiffness_is_the_tangent_of_the_normal_force(parameters, T, tolerance):
    instance = bcm(**parameters)
    eps = 1e-6
    low, high = (force_in_axes(instance, 0.025 + s * eps, **DRIVING, T=T)[2] for s in (-1, 1))
    force_in_axes(instance, 0.025, **DRIVING, T=T)
    assert instance.y.contact[0].K[2] == pytest.approx((high - low) / (2 * eps), rel=tolerance)
    assert instance.y.contact[0].K[0] == instance.y.contact[0].K[1] == 0.0


def test_normal_damping_is_the_tangent_of_the_damping_force():
    instance = bcm(n_g=0, c=0, phi=0, rho=0)
    eps = 1e-5
    up, down = (force_in_axes(instance, 0.025, v=(0.1, 0, s * eps), w=(0, 1, 0))[2] for s in (1, -1))
    force_in_axes(instance, 0.025, v=(0.1, 0, 0), w=(0, 1, 0))
    assert instance.y.contact[0].D[2] == pytest.approx((down - up) / (2 * eps), rel=1e-6)


@pytest.mark.parametrize("speed", [1e-6, 0.01, 0.3])
@pytest.mark.parametrize("parameters", [dict(n_g=0), dict(), dict(kappa_q=1.0)])
def test_lateral_damping_is_the_secant_of_the_lateral_force(speed, parameters):
    """A locked wheel pushed sideways: all of F_y is -D_y v_y, at every speed."""
    instance = bcm(**parameters)
    force = force_in_axes(instance, 0.025, v=(0, speed, 0), w=(0, 0, 0))
    assert force[1] == pytest.approx(-instance.y.contact[0].D[1] * speed, rel=1e-9)


@pytest.mark.parametrize("speed", [1e-6, 0.01, 0.3])
@pytest.mark.parametrize("parameters", [dict(n_g=0), dict(t_g=0)])
def test_longitudinal_damping_is_the_secant_of_friction(speed, parameters):
    """A locked wheel with a symmetric contact, where the normal stress has no share in F_x."""
    instance = bcm(eta=1, **parameters)
    force = force_in_axes(instance, 0.025, v=(speed, 0, 0), w=(0, 0, 0))
    assert force[0] == pytest.approx(-instance.y.contact[0].D[0] * speed, rel=1e-9)


def test_stiffness_and_damping_oppose_motion_in_any_state():
    instance, rng = bcm(), np.random.default_rng(5)
    for _ in range(500):
        T = axis_rotation(2, rng.uniform(-3, 3)) @ axis_rotation(1, rng.uniform(-0.5, 0.5)) @ axis_rotation(3, rng.uniform(-3, 3))
        force_in_axes(instance, rng.uniform(-0.02, 0.2), v=rng.normal(0, 0.5, 3), w=rng.normal(0, 3, 3), T=T)
        contact = instance.y.contact[0]
        assert (contact.K >= 0).all() and (contact.D >= 0).all()
        assert np.isfinite(instance.block).all()


def test_contact_frame_carries_the_whole_force_and_the_anchor():
    instance = bcm()
    T = axis_rotation(2, 0.7) @ axis_rotation(1, 0.1) @ axis_rotation(3, 0.4)
    force_in_axes(instance, 0.02, **DRIVING, T=T)
    contact, wheel = instance.y.contact[0], instance.y.wheel[0]
    assert wheel.f_0 == pytest.approx(contact.axes.T @ contact.F)
    assert contact.axes @ contact.axes.T == pytest.approx(np.eye(3))
    assert contact.axes[2] == pytest.approx((0, 0, 1))
    assert contact.axes[0] == pytest.approx((np.cos(0.4), np.sin(0.4), 0))
    assert contact.point_0 == pytest.approx((0, 0, -0.02))
    assert contact.in_contact == 1.0
    for field in ("r_0", "T", "v_0", "w_0"):
        assert (contact.anchor[field] == instance.u.wheel[0][field]).all()


def test_active_weighs_the_contact():
    instance = bcm()
    force_in_axes(instance, 0.02, **DRIVING)
    names = [s.name for s in instance.model.outputs.scalars()]
    weighed = [
        i for i, n in enumerate(names) if n.endswith(tuple(f"{f}[{k}]" for f in (".f_0", ".t_0", ".F", ".K", ".D") for k in (1, 2, 3)))
    ]
    full = instance.block[instance.slices["y"]][weighed].copy()
    instance.u.wheel[0].active = 0.25
    instance.step(0.0, 1e-3)
    assert instance.block[instance.slices["y"]][weighed] == pytest.approx(0.25 * full)
    instance.u.wheel[0].active = 0.0
    instance.u.wheel[0].r_0[2] = -5.0  # buried, but nobody asks
    instance.step(0.0, 1e-3)
    assert not instance.block[instance.slices["y"]][weighed].any()
    assert instance.y.contact[0].in_contact == 0.0


SWEEPS = dict(
    rolling=lambda s: dict(z=0.025, v=(0.01 * s, 0, 0), w=(0, 0.08 * s, 0)),
    braking=lambda s: dict(z=0.025, v=(0.1 * s, 0.01, 0), w=(0, 0.5, 0)),
    spinning=lambda s: dict(z=0.025, v=(0.002, 0, 0), w=(0, s, 0.1)),
    sliding=lambda s: dict(z=0.025, v=(0, 0.05 * s, 0.1), w=(0.1, 0, 0.3)),
    touching=lambda s: dict(z=-0.01 + 0.004 * s, v=(0.1, 0.01, 0), w=(0, 1, 0)),
    rising=lambda s: dict(z=0.02, v=(0.1, 0.01, s), w=(0, 1, 0)),
    cambering=lambda s: dict(z=0.025, v=(0.1, 0, 0), w=(0, 1, 0), T=axis_rotation(1, 0.5 * s)),
    turning=lambda s: dict(z=0.025, v=(0.1, 0, 0), w=(0, 1, 1e-7 * s)),
)


@pytest.mark.parametrize("sweep", SWEEPS)
@pytest.mark.parametrize("mode", ["constant", "mapped"])
@pytest.mark.parametrize("model", ["bekker", "wong_reece"])
def test_forces_are_continuous(sweep, mode, model):
    """Through standstill, reversal, touchdown, separation, camber: with an 8 times finer sweep the largest step falls too."""
    instance = bcm(V_j_mode=mode, normal_model=model)

    def largest_step(n):
        # Not centred on 0, so that no point lies on a branch.
        forces = np.array([force_in_axes(instance, **SWEEPS[sweep](s)) for s in np.linspace(-0.99, 1, n)])
        return np.abs(np.diff(forces, axis=0)).max()

    assert largest_step(2401) < 0.25 * largest_step(301) + 1e-6
