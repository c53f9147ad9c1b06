"""Rover: the multibody system of the chapter's experiment (Table 8.2), two wheels on a rigid link, integrated by MuJoCo.

The contact forces come from other slaves; their interface Jacobian lets one implicit step of MuJoCo carry stiff contacts at 1 ms.
"""

from __future__ import annotations

from functools import partial

import mujoco
import numpy as np

from cdl_fmu.frames import axis_rotation
from cdl_fmu.slave.interface import (
    ENVIRONMENT,
    body_pose,
    body_support,
    body_wrench,
    contact_jacobian,
    n_pairs,
    pair_contacts,
    tool_twists,
    wheel_pose,
    wheel_wrench,
)
from cdl_fmu.slave.kernel import compiled
from cdl_fmu.slave.model import Event, Instance, Model, ModelError
from cdl_fmu.slave.records import Array, Choice, Real, Record

from .implicit import ANCHOR, ROW
from .interface import commands, joints
from .rover_mjcf import STEERED, two_wheel
from .rover_step import LIMIT, LOST, advance, is_at, observe, predict, show

_RADIUS, _WIDTH, _MASS = 0.125, 0.125, 2.0  # wheel of Table 8.2, for the inertia it leaves out


class Rover(Model):
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
        self.inputs = (
            wheel_wrench(n)
            | contact_jacobian(n)
            | commands(n)
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
            wheel_pose(n)
            | Record(rock=body_pose(n_bodies).fields["body"])
            | joints(n)
            | Record(
                body=Record(
                    r_0=Real(0.0, "m", "Middle between the wheel centres, resolved in world", (3,)),
                    yaw=Real(0.0, "rad", "Heading of the body from the x axis, positive to the left"),
                    pitch=Real(0.0, "rad", "Pitch of the body, positive nose down"),
                    v_0=Real(0.0, "m/s", "Velocity of r_0, resolved in world", (3,)),
                    w_0=Real(0.0, "rad/s", "Angular velocity of the body, resolved in world", (3,)),
                ),
                applied=Array(
                    n, Record(f_0=Real(0.0, "N", "Contact force that acted on the wheel in the last step, resolved in world", (3,)))
                ),
            )
            | tool_twists(n, n_bodies)
        )

    def check(self, p) -> None:
        axle, diameter = float(p.wheel_inertia_axle), float(p.wheel_inertia_diameter)
        if axle > 2 * diameter:
            raise ModelError(
                f"wheel_inertia_axle = {axle:g} kg.m2: it must be at most twice wheel_inertia_diameter = {diameter:g} kg.m2, "
                "as no body has more; lower it or raise wheel_inertia_diameter"
            )
        for j in range(self.sizes["n_bodies"]):
            xx, yy, zz, xy, xz, yz = p.rock[j].inertia
            least, middle, most = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            if least <= 0.0 or most > (least + middle) * (1.0 + 1e-9):
                raise ModelError(
                    f"rock[{j + 1}].inertia = {xx:.4g}, {yy:.4g}, {zz:.4g}, {xy:.4g}, {xz:.4g}, {yz:.4g} kg.m2: no body has these (its "
                    "principal ones must be positive, none above the other two's sum); take those of the rock's mesh"
                )

    def bind(self, instance: Instance):
        # MuJoCo would write its warnings to MUJOCO_LOG.TXT in the working directory; a lost state is caught by the step instead.
        mujoco.set_mju_user_warning(lambda text: None)
        simulation = None

        def initialise(t: float) -> None:
            nonlocal simulation
            simulation = _Simulation(instance)
            simulation.initialise()

        return initialise, lambda t, h: simulation.step(h)


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


class _Simulation:
    """MuJoCo's model and data of one instance, with views of their memory bound once.

    The records x are the state; MuJoCo's data are loaded from them whenever they differ, that is after a restore.
    """

    def __init__(self, instance: Instance):
        self.instance = instance
        n_wheels, n_rocks, n_hard = (instance.model.sizes[size] for size in ("n_wheels", "n_bodies", "n_hard"))
        n = n_wheels + n_rocks
        p, u, x, y = instance.p, instance.u, instance.x, instance.y
        m = self.m = two_wheel(p, n_rocks)
        d = self.d = mujoco.MjData(m)
        self.q, self.q_dot = d.qpos, d.qvel
        choice = instance.model.parameters.fields["with_inverse_inertia"]
        self.with_inverse_inertia = p.with_inverse_inertia == choice.value("on")

        bodies = [m.body(name).id for name in ("body", *(f"wheel{i}" for i in range(n_wheels)), *(f"rock{j}" for j in range(n_rocks)))]
        spins = np.array([m.joint(f"spin{i}").dofadr[0] for i in range(n_wheels)])
        steers = np.array([m.joint(f"steer{i}").dofadr[0] if STEERED[i] else -1 for i in range(n_wheels)])
        gains = np.zeros(m.nv)
        gains[spins], gains[steers[steers >= 0]] = p.wheel_servo_gain, p.steer_servo_gain
        moves = np.zeros((n, m.nv))
        for i, body in enumerate(bodies[1:]):
            if i >= n_wheels and p.rock[i - n_wheels].fixed == _ROCK.fields["fixed"].value("on"):
                continue
            while body:
                first = m.body_dofadr[body]
                moves[i, first : first + m.body_dofnum[body]] = 1.0
                body = m.body_parentid[body]
        # What a wheel carries, and what a rock is.
        masses = np.array([p.mass / n_wheels + p.wheel_mass] * n_wheels + [p.rock[j].mass for j in range(n_rocks)])

        self.h, self.mass, self.bias = np.zeros(1), np.zeros((m.nv, m.nv)), np.zeros(m.nv)
        self.where = np.zeros((n, 3)), np.zeros((n, 3, 3)), np.zeros((n, 6)), np.zeros((n, 6, m.nv))
        self.before = tuple(np.zeros_like(a) for a in self.where[:3])
        inputs, outputs = instance.model.inputs, instance.model.outputs
        soil = u["contact"], u["wheel"], _array(u, "support", inputs), _array(u, "rock", inputs)
        hard = _hard(u, inputs, n_hard, n_wheels, n_rocks)
        n_contacts = n + hard[2].size
        rows, n_rows = np.zeros((3 * n_contacts + 3 * n_rocks, m.nv + ROW)), np.zeros(1, np.int64)
        anchors, lifted, applied = np.zeros((1 + n_hard, n, ANCHOR)), np.zeros(n_contacts), np.zeros((n, 3))
        A, forces = np.zeros((m.nv, m.nv)), np.zeros(m.nv)

        drives = gains, spins, steers, u["command"]["wheel_rate"], u["command"]["steer_rate"]
        dynamics = self.mass, self.bias, moves
        contacts = soil, hard, anchors, lifted, rows, n_rows, A, forces
        coordinates, bodies, joint = (x["q"], x["q_dot"], self.q, self.q_dot), np.array(bodies), y["joint"]
        self.is_at_state = _bound(is_at, *coordinates)
        self.observe = _bound(observe, moves, bodies, m.body_rootid, d.xpos, d.xmat, d.cvel, d.subtree_com, d.cdof, self.where)
        self.advance = _bound(advance, self.h, drives, dynamics, masses, self.where, *contacts, self.q, self.q_dot, applied)
        twists = np.zeros((6 * n, m.nv)), self.q_dot, y["inverse_inertia"], y["free_twist"]
        self.predict = _bound(predict, self.h, drives, dynamics, masses, self.where, self.before, *contacts, *twists)
        frames = self.where, applied, y["wheel"], _array(y, "rock", outputs), y["applied"]
        joints = joint["steer_angle"], joint["wheel_angle"], joint["wheel_rate"]
        self.show = _bound(show, *coordinates, spins, steers, *frames, joints, bodies, d.cvel, instance.arrays[3]["body"])

    def initialise(self) -> None:
        p = self.instance.p
        start = p.start
        self.q[:5] = start.x, start.y, start.z, start.yaw, start.pitch
        n_rocks = self.instance.model.sizes["n_bodies"]
        for rock, q in zip(p.rock if n_rocks else (), self.q[self.q.size - 7 * n_rocks :].reshape(-1, 7)):
            T = axis_rotation(1, rock.roll) @ axis_rotation(2, rock.pitch) @ axis_rotation(3, rock.yaw)
            q[:3] = rock.x, rock.y, rock.z
            mujoco.mju_mat2Quat(q[3:], T.T.ravel())
        self.h[0] = 1e-3  # until a step tells
        self.write_outputs()

    def step(self, h: float) -> int:
        self.h[0] = h
        if not self.is_at_state():
            self.load()
            self.update()
        for before, now in zip(self.before, self.where):
            before[...] = now
        if self.advance() == LOST:
            self.load()
            self.update()
            return LOST
        self.write_outputs()
        return 0

    def load(self) -> None:
        self.q[:] = self.instance.x.q
        self.q_dot[:] = self.instance.x.q_dot

    def update(self) -> None:
        """Bring all that depends on positions and rates up to date."""
        m, d = self.m, self.d
        mujoco.mj_kinematics(m, d)
        mujoco.mj_comPos(m, d)
        mujoco.mj_comVel(m, d)
        mujoco.mj_makeM(m, d)
        mujoco.mj_fullM(m, d, self.mass)
        mujoco.mj_rne(m, d, 0, self.bias)
        self.observe()

    def write_outputs(self) -> None:
        self.update()
        self.show()
        if self.with_inverse_inertia:
            self.predict()


def _array(part, name: str, record: Record) -> np.ndarray:
    """Records of the array ``name``, none if it is empty: NumPy's records hold no empty arrays."""
    return part[name] if record.fields[name].n else np.zeros(0, record.fields[name].record.dtype)


def _hard(u, inputs: Record, n_hard: int, n_wheels: int, n_rocks: int) -> tuple[np.ndarray, ...]:
    """Wrenches on wheels and on rocks, pairs and anchors of all hard contact slaves, each [n_hard, number]."""
    numbers = {"wheel": n_wheels, "body": n_rocks, "pair": n_pairs(n_wheels, n_rocks), "anchor": n_wheels + n_rocks}
    records = pair_contacts(n_wheels, n_rocks).fields
    return tuple(
        u["hard"][name] if n_hard and number else np.zeros((n_hard, number), records[name].record.dtype) for name, number in numbers.items()
    )


def _bound(function, *arguments):
    """A kernel as a call without arguments, on these."""
    return partial(compiled(function, *arguments), *arguments)
