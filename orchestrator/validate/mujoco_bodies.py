"""The scenes of the check of hard ground in MuJoCo, with its own contacts, as a second computation of the same."""

from __future__ import annotations

import math
from collections.abc import Callable

import mujoco
import numpy as np

_G = 9.81


def box(side: float, mass: float, z: float) -> str:
    """A free cube whose centre is at height z [m]."""
    return _free("box", f"{side / 2} {side / 2} {side / 2}", mass, z)


def ball(radius: float, mass: float, z: float) -> str:
    """A free ball whose centre is at height z [m]."""
    return _free("sphere", f"{radius}", mass, z)


def step(height: float, x: float, length: float) -> str:
    """A fixed step on the floor from x on [m]."""
    return f'<geom type="box" size="{length / 2} 1 {height / 2}" pos="{x + length / 2} 0 {height / 2}"/>'


def rover(p, z: float) -> str:
    """The rover with parameters ``p`` (:class:`mbs.rover.Rover`) on smooth wheels of Table 8.2 at height z [m], without steering."""
    inertia = f"{p.wheel_inertia_diameter} {p.wheel_inertia_axle} {p.wheel_inertia_diameter}"
    wheels = "".join(
        f"""<body name="wheel{i}" pos="{side * p.wheel_base / 2} 0 0"><joint name="spin{i}" axis="0 1 0"/>
        <inertial pos="0 0 0" mass="{p.wheel_mass}" diaginertia="{inertia}"/>
        <geom type="cylinder" size="0.125 0.0625" euler="{math.pi / 2} 0 0" mass="0"/></body>"""
        for i, side in enumerate((1.0, -1.0))
    )
    return f"""<body name="body" pos="{p.wheel_base / 2} 0 {z}">
      <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint type="slide" axis="0 0 1"/>
      <joint axis="0 0 1"/><joint axis="0 1 0"/>
      <inertial pos="0 0 {p.mass_height}" mass="{p.mass}" diaginertia="1e-6 1e-6 1e-6"/>{wheels}</body>"""


def _free(shape: str, size: str, mass: float, z: float) -> str:
    return f'<body pos="0 0 {z}"><freejoint/><geom type="{shape}" size="{size}" mass="{mass}"/></body>'


class Scene:
    """Bodies on a floor with MuJoCo's contacts, stiff ones with an elliptic friction cone.

    Args:
        bodies: What the functions above give.
        mu: Friction of all.
        slope: Tilt of gravity against the floor [rad].
        solref: MuJoCo's time constant and damping ratio, or less than 0: stiffness and damping over mass.
        impedance: Least share of a contact's force that obeys it [1].
        servo: Gain of the rover's wheel rate servos [N.m.s/rad]. MuJoCo's contacts do not know of the servos' implicit part: far above
            a wheel's inertia over the step they drive the rover faster than its wheels turn.
        h: Step [s].
    """

    def __init__(
        self,
        bodies: str,
        mu: float,
        slope: float = 0.0,
        solref: tuple[float, float] = (0.002, 1.0),
        impedance: float = 0.99,
        servo: float = 0.0,
        h: float = 1e-3,
    ):
        servos = "".join(f'<velocity joint="spin{i}" kv="{servo}"/>' for i in range(2)) if servo else ""
        self.model = mujoco.MjModel.from_xml_string(f"""
<mujoco>
  <compiler angle="radian"/>
  <option timestep="{h}" gravity="{-_G * math.sin(slope)} 0 {-_G * math.cos(slope)}" cone="elliptic" impratio="100"
    integrator="implicitfast" iterations="200" tolerance="1e-12"/>
  <default><geom solref="{solref[0]} {solref[1]}" solimp="{impedance} 0.9999 0.001" friction="{mu} 0 0" condim="3"/></default>
  <worldbody><geom type="plane" size="20 20 1"/>{bodies}</worldbody>
  <actuator>{servos}</actuator>
</mujoco>""")
        self.data = mujoco.MjData(self.model)

    def run(self, seconds: float, record: Callable[[Scene], object], rate: Callable[[float], float] = lambda t: 0.0) -> np.ndarray:
        """Records of all steps; ``rate`` tells the wheels' commanded rate by time [rad/s]."""
        out = []
        for _ in range(round(seconds / self.model.opt.timestep)):
            self.data.ctrl[:] = rate(self.data.time)
            mujoco.mj_step(self.model, self.data)
            out.append(record(self))
        return np.array(out)

    def floor_load(self) -> float:
        """Normal force on the floor [N]."""
        total, force = 0.0, np.zeros(6)
        for c in range(self.data.ncon):
            if 0 in self.data.contact[c].geom:
                mujoco.mj_contactForce(self.model, self.data, c, force)
                total += float(force[0])
        return total
