"""VEM's single contact point on flat ground and on patches, against closed forms."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from cdl_fmu.frames import axis_rotation
from cdl_fmu.slave.model import Instance, ModelError
from cdl_fmu.vem import VEM

R, K, MASS = 0.125, 1e5, 10.0
SMOOTH = {"n_g": 0.0, "h_g": 0.0}
SAND = {"k_c": 2e4, "k_phi": 5e6, "n": 0.8}


def wheel_on(n_patches=0, **parameters):
    """A wheel of 0.125 m on a contact of 1e5 N/m."""
    instance = Instance(VEM(1, n_patches), **(SMOOTH | {"k": K, "effective_mass": MASS} | parameters))
    put(instance)
    instance.initialise()
    return instance


def put(instance, z=R, v=(0.0, 0.0, 0.0), w=(0.0, 0.0, 0.0), T=None, at=(0.0, 0.0)):
    wheel = instance.u.wheel[0]
    wheel.r_0[:], wheel.v_0[:], wheel.w_0[:] = (*at, z), v, w
    wheel["T"][:] = np.eye(3) if T is None else T


def force(instance, *args, **kwargs):
    """Force [N] on the wheel there."""
    put(instance, *args, **kwargs)
    instance.step(0.0, 1e-3)
    return instance.y.wheel[0].f_0.copy()


def fall(instance, z, v, seconds, gravity, h=1e-4):
    """Heights and velocities of a free wheel of ``MASS``, by RK4, as the force has no memory."""

    def rate(y):
        return np.array([y[1], force(instance, y[0], (0.0, 0.0, y[1]))[2] / MASS - gravity])

    y, out = np.array([z, v]), []
    for _ in range(round(seconds / h)):
        a = rate(y)
        b = rate(y + 0.5 * h * a)
        c = rate(y + 0.5 * h * b)
        y = y + h / 6.0 * (a + 2.0 * b + 2.0 * c + rate(y + h * c))
        out.append(y)
    return np.array(out)


# -- normal force


def test_the_spring_is_linear_and_ends_with_the_contact():
    wheel = wheel_on()
    for depth in (1e-6, 1e-3, 5e-3):
        assert force(wheel, R - depth) == pytest.approx([0.0, 0.0, K * depth], rel=1e-9)
    assert not force(wheel, R + 1e-9).any() and wheel.y.contact[0].in_contact == 0.0
    assert force(wheel_on(n_g=12.0, h_g=0.01), R + 0.008)[2] == pytest.approx(K * 0.002)  # on the grousers' tips
    wheel.u.wheel[0].active = 0.25
    assert force(wheel, R - 1e-3)[2] == pytest.approx(0.25 * K * 1e-3)
    assert wheel.y.contact[0].K[2] == pytest.approx(0.25 * K)


@pytest.mark.parametrize("n", [0.5, 1.0, 1.7])
def test_bekker_s_spring_is_the_integral_of_his_pressure(n):
    soil = SAND | {"n": n}
    wheel = wheel_on(normal_model="bekker", b_w=0.1, **soil)
    k_eq = soil["k_c"] / 0.1 + soil["k_phi"]
    for depth in (1e-4, 2e-3, 5e-3):
        half = math.sqrt(2.0 * R * depth)
        parabola = 0.2 * k_eq * quad(lambda x: (depth - x * x / (2.0 * R)) ** n, 0.0, half, limit=200)[0]  # noqa: B023
        assert force(wheel, R - depth)[2] == pytest.approx(parabola, rel=1e-6)
        half = math.sqrt(2.0 * R * depth - depth**2)
        arc = 0.2 * k_eq * quad(lambda x: (math.sqrt(R * R - x * x) - R + depth) ** n, 0.0, half, limit=200)[0]  # noqa: B023
        assert force(wheel, R - depth)[2] == pytest.approx(arc, rel=0.01)


@pytest.mark.parametrize("ratio", [0.05, 0.2, 0.6])
def test_oscillation_decays_by_lehr_s_ratio(ratio):
    """Logarithmic decrement: 2 pi D / sqrt(1 - D^2)."""
    rest = R - MASS * 9.81 / K
    heights = fall(wheel_on(damping_ratio=ratio), rest + 5e-4, 0.0, 0.2, 9.81)[:, 0] - rest
    inner = heights[1:-1]
    peaks = inner[(inner > heights[:-2]) & (inner >= heights[2:])]
    assert peaks[0] / 5e-4 == pytest.approx(math.exp(-2.0 * math.pi * ratio / math.sqrt(1.0 - ratio**2)), rel=1e-3)


def test_a_ratio_of_1_is_critical():
    """The wheel does not overshoot, and with a little less it does."""
    rest = R - MASS * 9.81 / K
    for ratio, overshoots in ((1.0, False), (0.9, True)):
        heights = fall(wheel_on(damping_ratio=ratio), rest + 5e-4, 0.0, 0.3, 9.81)[:, 0] - rest
        assert bool(heights.min() < -1e-7) is overshoots


def rebound(ratio):
    """Speed after an impact over that before it, of a spring and damper that do not pull: Schwager & Poeschel 2007, eq. (20)."""
    if ratio < 1.0:
        share = ratio / math.sqrt(1.0 - ratio**2)
        return math.exp(-share * (math.pi - math.atan2(2.0 * ratio * math.sqrt(1.0 - ratio**2), 1.0 - 2.0 * ratio**2)))
    root = math.sqrt(ratio**2 - 1.0)
    return math.exp(-ratio / root * math.log((ratio + root) / (ratio - root)))


@pytest.mark.parametrize("ratio", [0.0, 0.05, 0.3, 0.8, 1.5])
def test_restitution_of_an_impact(ratio):
    motion = fall(wheel_on(damping_ratio=ratio), R, -0.5, 0.2, 0.0)
    e = motion[-1, 1] / 0.5
    assert motion[-1, 0] > R
    assert e == pytest.approx(rebound(ratio), abs=1e-3)
    if ratio <= 0.05:  # where nothing keeps it from pulling: exp(-pi D / sqrt(1 - D^2))
        assert e == pytest.approx(math.exp(-math.pi * ratio / math.sqrt(1.0 - ratio**2)), rel=0.01)


def test_a_wheel_that_leaves_is_not_held():
    wheel = wheel_on(damping_ratio=1.0)
    for speed in np.linspace(0.0, 2.0, 21):
        assert force(wheel, R - 2e-4, (0.0, 0.0, speed))[2] >= 0.0
    assert not force(wheel, R - 2e-4, (0.3, 0.0, 2.0)).any()


def test_bekker_s_contact_begins_without_a_jump():
    """Its damping falls with the depth, where n is above 0.5; that of a linear spring is there at once."""
    wheel = wheel_on(normal_model="bekker", damping_ratio=1.0, **SAND | {"n": 1.5})
    linear = wheel_on(damping_ratio=1.0)
    first = [force(w, R - 1e-9, (0.0, 0.0, -0.5))[2] for w in (wheel, linear)]
    assert first[0] < 1.0 and first[1] == pytest.approx(2.0 * math.sqrt(K * MASS) * 0.5, rel=1e-3)


# -- friction


def curve(v, mu, mu_static, v_static, v_creep):
    """Coefficient of friction at a sliding speed [m/s]."""
    return (mu + (mu_static - mu) * math.exp(-((v / v_static) ** 2))) * math.tanh(v / v_creep)


def test_sliding_friction_is_mu_times_the_load_against_the_motion():
    wheel = wheel_on(mu=0.6)
    for angle in (0.0, 0.7, 2.0):
        f = force(wheel, R - 1e-3, (0.2 * math.cos(angle), 0.2 * math.sin(angle), 0.0))
        assert f == pytest.approx([-60.0 * math.cos(angle), -60.0 * math.sin(angle), 100.0], rel=1e-9)
    assert force(wheel, R - 1e-3, (0.2, 0.0, 0.0), (0.0, 0.2 / (R - 0.0), 0.0))[0] == pytest.approx(0.0, abs=1e-6)  # rolls
    assert force(wheel, R - 1e-3, (0.0, 0.0, 0.0), (0.0, 4.0, 0.0))[0] == pytest.approx(60.0)  # spins: driven ahead
    assert wheel.y.diagnostics[0].drive_torque == pytest.approx(60.0 * R)


def test_static_friction_falls_to_sliding_friction():
    law = {"mu": 0.4, "mu_static": 0.7, "v_static": 0.01, "v_creep": 1e-4}
    wheel = wheel_on(**law)
    for v in (1e-6, 1e-4, 1e-3, 5e-3, 0.01, 0.03, 0.1):
        assert -force(wheel, R - 1e-3, (v, 0.0, 0.0))[0] / 100.0 == pytest.approx(curve(v, **law), rel=1e-6)
    assert -force(wheel, R - 1e-3, (5e-4, 0.0, 0.0))[0] == pytest.approx(70.0, rel=3e-3)
    assert -force(wheel, R - 1e-3, (0.1, 0.0, 0.0))[0] == pytest.approx(40.0, rel=1e-9)
    without = wheel_on(mu=0.4)
    assert -force(without, R - 1e-3, (5e-4, 0.0, 0.0))[0] == pytest.approx(40.0, rel=1e-3)


@pytest.mark.parametrize("share", [0.2, 0.9])
def test_a_locked_wheel_on_an_incline_creeps(share):
    """v = v_creep atanh(tan a / mu): where friction balances the downhill part of the load."""
    wheel = wheel_on(mu=0.6, v_creep=1e-4)
    speed = 1e-4 * math.atanh(share)
    assert -force(wheel, R - 1e-3, (speed, 0.0, 0.0))[0] == pytest.approx(share * 60.0, rel=1e-9)


# -- interface Jacobian


def resolved(instance):
    return instance.y.contact[0]["axes"].copy(), instance.y.contact[0].F.copy()


@pytest.mark.parametrize("model", ["linear", "bekker"])
@pytest.mark.parametrize("slope", [0.0, 0.3])
def test_the_jacobian_is_the_force_s_derivative(model, slope):
    """Tangent of the normal force, secant of friction, at the contact point; on flat ground and on a patch that slopes."""
    T = axis_rotation(1, 0.1) @ axis_rotation(3, 0.4)
    wheel = wheel_on(int(slope > 0.0), normal_model=model, damping_ratio=0.3, **SAND)
    if slope:
        tilt(wheel, slope)
    height = R / math.cos(slope) - 4e-3
    v, w = np.array([0.02, 0.01, -0.03]), (0.3, 0.5, -0.2)
    force(wheel, height, v, w, T)
    axes, F = resolved(wheel)
    contact = wheel.y.contact[0]
    Ks, Ds, point = contact.K.copy(), contact.D.copy(), contact.point_0.copy()
    assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-12) and np.linalg.det(axes) == pytest.approx(1.0)
    assert pytest.approx(wheel.y.wheel[0].f_0, rel=1e-12) == axes.T @ F
    assert np.cross(point - (0.0, 0.0, height), wheel.y.wheel[0].f_0) == pytest.approx(wheel.y.wheel[0].t_0, abs=1e-9)
    sliding = axes @ (v + np.cross(w, point - (0.0, 0.0, height)))
    assert F[:2] == pytest.approx(-Ds[:2] * sliding[:2], rel=1e-9)  # secant
    n, e = axes[2], 1e-7
    more = [axes[2] @ force(wheel, height + s * e * n[2], v, w, T, s * e * n[:2]) for s in (1.0, -1.0)]
    assert (more[1] - more[0]) / (2.0 * e) == pytest.approx(Ks[2] + _of_damping(model, Ds[2], sliding[2], height, slope, T), rel=1e-3)
    more = [axes[2] @ force(wheel, height, v + s * e * n, w, T) for s in (1.0, -1.0)]
    assert (more[1] - more[0]) / (2.0 * e) == pytest.approx(Ds[2], rel=1e-6)


def _of_damping(model, damper, v_n, height, slope, T):
    """What damping that grows with the depth adds to the stiffness, which the tangent leaves out [N/m]."""
    if model == "linear":
        return 0.0
    normal = np.array([-math.sin(slope), 0.0, math.cos(slope)])
    depth = R * math.sqrt(1.0 - (T[1] @ normal) ** 2) - height * math.cos(slope)
    return -v_n * damper * 0.5 * (SAND["n"] - 0.5) / depth


def tilt(wheel, slope):
    """A patch that rises along x."""
    patch = wheel.u.patch[0]
    nx = patch.z.shape[0]
    patch.origin[:], patch.spacing = (-0.15, -0.1), 0.025
    patch.z[:] = math.tan(slope) * (patch.origin[0] + patch.spacing * np.arange(nx))[:, None]


def test_a_slope_is_the_level_case_turned():
    slope, turn = 0.25, axis_rotation(2, -0.25).T  # level to slope, in world
    level, sloped = wheel_on(), wheel_on(1)
    tilt(sloped, slope)
    v, w, T = np.array([0.05, -0.02, -0.01]), np.array([0.1, 0.8, 0.2]), axis_rotation(3, 0.3)
    f = force(level, R - 2e-3, v, w, T)
    centre = turn @ (0.0, 0.0, R - 2e-3)
    turned = force(sloped, centre[2], turn @ v, turn @ w, T @ turn.T, centre[:2])
    assert turned == pytest.approx(turn @ f, rel=1e-6, abs=1e-5)
    assert sloped.y.wheel[0].t_0 == pytest.approx(turn @ level.y.wheel[0].t_0, rel=1e-6, abs=1e-5)
    assert pytest.approx(level.y.contact[0].F, rel=1e-6, abs=1e-5) == sloped.y.contact[0].F


# -- state and bad values


def test_a_refused_step_changes_nothing():
    wheel = wheel_on()
    force(wheel, R - 1e-3)
    before = wheel.block[wheel.slices["x"]].copy()
    with pytest.raises(ModelError, match="wheel 1 is buried"):
        force(wheel, -0.2)
    with pytest.raises(ModelError, match="must be finite"):
        force(wheel, math.nan)
    assert np.array_equal(wheel.block[wheel.slices["x"]], before)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"k": 0.0}, "k = 0 N/m: it must be at least 1 N/m"),
        ({"damping_ratio": -0.1}, "damping_ratio = -0.1: it must be at least 0"),
        ({"mu": 11.0}, "mu = 11: it must be at most 10"),
        ({"v_creep": 0.0}, "v_creep = 0 m/s: it must be at least 1e-09 m/s"),
        ({"effective_mass": 0.0}, "effective_mass = 0 kg: it must be at least 0.001 kg"),
    ],
)
def test_bad_parameters_are_refused(change, text):
    with pytest.raises(ModelError, match=text):
        wheel_on(**change)


def test_sizes_that_do_not_fit_together_are_refused():
    with pytest.raises(ValueError, match=r"n_patches = 1: choose 0 \(flat ground\) or 2"):
        VEM(2, 1)
    with pytest.raises(ValueError, match="wheels stand on bodies, on patches or on a mesh of the ground; choose one"):
        VEM(1, 1, 1)
