"""Rover: the multibody system of the chapter's experiment (Table 8.2), two wheels on a rigid link, integrated by MuJoCo.

The contact forces come from other slaves; their interface Jacobian lets one implicit step of MuJoCo carry stiff contacts at 1 ms.
"""

from __future__ import annotations

from cdl_fmu.slave.interface import (
    ENVIRONMENT,
    body_pose,
    body_support,
    body_wrench,
    contact_jacobian,
    pair_contacts,
    tool_twists,
    wheel_pose,
    wheel_wrench,
)
from cdl_fmu.slave.kernel import kernel
from cdl_fmu.slave.model import Event, KernelModel, ModelError, Rule
from cdl_fmu.slave.records import Array, Choice, Real, Record

from .interface import commands, joints
from .mujoco_library import MUJOCO
from .rover_kernels import ARGUMENTS, initialise, step
from .rover_memory import RoverPool
from .rover_mjcf import STEERED
from .rover_step import LIMIT, LOST

_RADIUS, _WIDTH, _MASS = 0.125, 0.125, 2.0  # wheel of Table 8.2, for the inertia it leaves out


class Rover(KernelModel):
    """Two-wheel rover of Table 8.2: wheels on a rigid massless link, a point mass above its middle, free in all but roll; and rocks.

    The body frame lies in the middle between the wheel centres, x forward, y to the left, z up; wheel 1 is the front wheel,
    wheel 2 the rear wheel, which steers about the body's z axis. Positive pitch lowers the nose.

    Step: the contact force on each axis is F = F0 - K (x - x_a) - D (v - v_a), implicit in the velocity at the step's end; where
    ``contact[i].in_contact`` is 0, ``wheel[i].f_0, t_0`` act as they are. If a normal force comes out negative the step is redone
    with that contact off. The torque that the contact's point does not explain acts on the wheel as it is.

    MuJoCo gives what bodies are: kinematics, mass matrix, gravity and gyroscopic forces. The step is own code, as its matrix is what
    rigid contacts need, and contacts between two bodies have to be implicit in the motion of both.

    Args:
        n_wheels: Number of wheels, 2.
        n_bodies: Number of rocks, free bodies unless they are fixed.
        n_hard: Number of slaves of hard contacts that act beside the soil's, on ``hard[k].``: pairs of wheels and rocks.
    """

    feedthrough = False
    starts_from_inputs = True
    library = MUJOCO
    pool_class = RoverPool
    arguments = ARGUMENTS
    initialise_kernel = staticmethod(initialise)
    step_kernel = staticmethod(step)
    events = {
        LOST: Event(
            "the rover's motion left all bounds (a position or rate is not finite or beyond 1e6): check the contact forces that it gets, "
            "shorten the communication step, or send the contacts' stiffness and damping (contact[i].K, D)"
        )
    }

    parameters = ENVIRONMENT | Record(
        wheel_base=Real(0.6, "m", "Distance of the wheel centres (Table 8.2)", min=1e-3, max=100.0),
        mass=Real(50.0, "kg", "Point mass in the middle between the wheels (Table 8.2)", min=1e-3, max=1e5),
        mass_height=Real(0.1, "m", "Height of the point mass above the wheel centres (Table 8.2)", min=-10.0, max=10.0),
        wheel_mass=Real(_MASS, "kg", "Mass of one wheel (Table 8.2)", min=1e-3, max=1e4),
        wheel_inertia_axle=Real(
            _MASS * _RADIUS**2 / 2, "kg.m2", "Inertia of a wheel about its axle (assumption: solid cylinder)", min=1e-6, max=1e4
        ),
        wheel_inertia_diameter=Real(
            _MASS * (3 * _RADIUS**2 + _WIDTH**2) / 12,
            "kg.m2",
            "Inertia of a wheel about a diameter (assumption: solid cylinder)",
            min=1e-6,
            max=1e4,
        ),
        wheel_servo_gain=Real(1e5, "N.m.s/rad", "Gain of the wheel rate servo (assumption: stiff)", min=0.0, max=1e7),
        steer_servo_gain=Real(1e5, "N.m.s/rad", "Gain of the steering rate servo (assumption: stiff)", min=0.0, max=1e7),
        start=Record(
            x=Real(0.3, "m", "Start position of the middle between the wheel centres; 0.3 puts the rear wheel at 0", (), -LIMIT, LIMIT),
            y=Real(0.0, "m", "Start position of the middle between the wheel centres", (), -LIMIT, LIMIT),
            z=Real(_RADIUS, "m", "Start height of the middle between the wheel centres", (), -LIMIT, LIMIT),
            yaw=Real(0.0, "rad", "Start heading from the x axis, positive to the left", (), -10.0, 10.0),
            pitch=Real(0.0, "rad", "Start pitch, positive nose down", (), -1.5, 1.5),
        ),
        with_inverse_inertia=Choice(
            "Output of the inverse inertia at wheels and rocks and of their free twists, for rigid contacts and a master's stability guard",
            off="none",
            on="each step",
        ),
    )

    def __init__(self, n_wheels: int = 2, n_bodies: int = 0, n_hard: int = 0):
        super().__init__(n_wheels=n_wheels, n_bodies=n_bodies, n_hard=n_hard)
        if n_wheels != len(STEERED):
            raise ModelError(f"n_wheels = {n_wheels}: the rover of Table 8.2 has {len(STEERED)} wheels")
        n, n_joints = n_wheels, 5 + n_wheels + sum(STEERED)
        sizes = {"b": n_bodies, "h": n_hard}
        self.identifier = f"cdl_rover_w{n}" + "".join(f"{letter}{size}" for letter, size in sizes.items() if size)
        self.parameters = Rover.parameters | Record(rock=Array(n_bodies, _ROCK))
        self.rules = (_WHEEL_RULE, *map(_rock_rule, range(n_bodies)))
        self.inputs = (
            commands(n)
            | wheel_wrench(n)
            | contact_jacobian(n)
            | Record(
                rock=body_wrench(n_bodies).fields["body"],
                support=body_support(n_bodies).fields["support"],
                hard=Array(n_hard, pair_contacts(n, n_bodies)),
            )
        )
        angles = "x, y, z, yaw, pitch, then per wheel steering angle (where it steers) and wheel angle [m, rad]"
        self.state = Record(
            q=Real(0.0, "1", f"{angles}; per rock position [m] and quaternion", (n_joints + 7 * n_bodies,)),
            q_dot=Real(
                0.0, "1", "Rates of q [m/s, rad/s]; per rock velocity, and angular velocity in its frame", (n_joints + 6 * n_bodies,)
            ),
        )
        self.outputs = (
            joints(n)
            | Record(
                body=Record(
                    r_0=Real(0.0, "m", "Middle between the wheel centres, resolved in world", (3,)),
                    yaw=Real(0.0, "rad", "Heading of the body from the x axis, positive to the left"),
                    pitch=Real(0.0, "rad", "Pitch of the body, positive nose down"),
                    v_0=Real(0.0, "m/s", "Velocity of r_0, resolved in world", (3,)),
                    w_0=Real(0.0, "rad/s", "Angular velocity of the body, resolved in world", (3,)),
                )
            )
            | tool_twists(n, n_bodies)
            | wheel_pose(n)
            | Record(
                rock=body_pose(n_bodies).fields["body"],
                applied=Array(
                    n, Record(f_0=Real(0.0, "N", "Contact force that acted on the wheel in the last step, resolved in world", (3,)))
                ),
            )
        )

    def make_pool(self, p, files) -> RoverPool:
        return RoverPool(*(self.sizes[size] for size in ("n_wheels", "n_bodies", "n_hard")))


_ROCK = Record(
    mass=Real(5.0, "kg", "Mass of the rock", min=1e-3, max=1e5),
    center=Real(0.0, "m", "Its centre of mass in its frame, which is that of its mesh", (3,), -10.0, 10.0),
    inertia=Real(
        (0.02, 0.02, 0.02, 0.0, 0.0, 0.0), "kg.m2", "Its inertia about the centre of mass: xx, yy, zz, xy, xz, yz", (6,), -1e5, 1e5
    ),
    x=Real(0.0, "m", "Start position of its frame", (), -LIMIT, LIMIT),
    y=Real(0.0, "m", "Start position of its frame", (), -LIMIT, LIMIT),
    z=Real(0.0, "m", "Start position of its frame", (), -LIMIT, LIMIT),
    yaw=Real(0.0, "rad", "Start rotation about z, then about the new y and x by pitch and roll", (), -10.0, 10.0),
    pitch=Real(0.0, "rad", "Start pitch", (), -1.5708, 1.5708),
    roll=Real(0.0, "rad", "Start roll", (), -10.0, 10.0),
    fixed=Choice("Whether the rock can move", off="it is moved by what acts on it", on="it stays where it is"),
)

_WHEEL_RULE = Rule(
    "wheel_inertia_axle = {p.wheel_inertia_axle:g} kg.m2: it must be at most twice wheel_inertia_diameter = "
    "{p.wheel_inertia_diameter:g} kg.m2, as no body has more; lower it or raise wheel_inertia_diameter",
    lambda p: p.wheel_inertia_axle > 2.0 * p.wheel_inertia_diameter,
)


def _rock_rule(j: int) -> Rule:
    values = ", ".join(f"{{p.rock[{j}].inertia[{k}]:.4g}}" for k in range(6))
    return Rule(
        f"rock[{j + 1}].inertia = {values} kg.m2: no body has these (its principal ones must be positive, none above the other two's sum); "
        "take those of the rock's mesh",
        lambda p: not _is_inertia(p.rock[j].inertia),
    )


@kernel
def _is_inertia(inertia):
    xx, yy, zz, xy, xz, yz = inertia[0], inertia[1], inertia[2], inertia[3], inertia[4], inertia[5]
    # None of the principal ones is above the other two's sum where none is above half the sum of all. Of a plate one is as large.
    half = (xx + yy + zz) * (0.5 + 0.25e-9)
    return _is_positive(xx, yy, zz, xy, xz, yz) and _is_positive(half - xx, half - yy, half - zz, -xy, -xz, -yz)


@kernel
def _is_positive(xx, yy, zz, xy, xz, yz):
    """True for a symmetric positive definite matrix: its pivots are positive (Sylvester)."""
    if not xx > 0.0:
        return False
    yy, zz, yz = yy - xy * xy / xx, zz - xz * xz / xx, yz - xy * xz / xx
    return yy > 0.0 and zz - yz * yz / yy > 0.0
