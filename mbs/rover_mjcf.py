"""The two-wheel rover of Table 8.2 as a MuJoCo model."""

from __future__ import annotations

import mujoco

from cdl_fmu.frames import vertical

#: Which wheels steer, front wheel first (section 8.4.2: the rear wheel alone).
STEERED = (False, True)

# Rotational inertia of the "point" mass [kg.m2]: small enough to be none, large enough for MuJoCo to take.
_POINT = 1e-12


def two_wheel(p) -> mujoco.MjModel:
    """Model of the rover with parameters ``p`` (:class:`mbs.rover.Rover`).

    Joints in order: x, y, z, yaw, pitch of the body (no roll), then per wheel steering, where it steers, and spin. Actuators in
    order: three axes of each wheel's contact, the spin servos, the steering servos.
    """
    # implicitfast is implicit in the damping of contacts and servos. It leaves out the Coriolis derivatives of implicit: the drive on
    # BCM is as close to the reference with either (rms of the forces at 1 ms within 0.0154 % of the wheel load), in 1.7 us less a step.
    down = " ".join(str(-p.gravity * along) for along in vertical(p.slope, p.uphill))
    return mujoco.MjModel.from_xml_string(f"""
<mujoco model="two-wheel rover">
  <compiler angle="radian"/>
  <option integrator="implicitfast" gravity="{down}">
    <flag contact="disable" autoreset="disable"/>
  </option>
  <worldbody>
    <body name="body">
      <joint name="x" type="slide" axis="1 0 0"/>
      <joint name="y" type="slide" axis="0 1 0"/>
      <joint name="z" type="slide" axis="0 0 1"/>
      <joint name="yaw" axis="0 0 1"/>
      <joint name="pitch" axis="0 1 0"/>
      <inertial pos="0 0 {p.mass_height}" mass="{p.mass}" diaginertia="{_POINT} {_POINT} {_POINT}"/>
      {_wheel(p, 0, p.wheel_base / 2)}
      {_wheel(p, 1, -p.wheel_base / 2)}
    </body>
  </worldbody>
  <actuator>
    {"".join(f'<general site="wheel{i}" biastype="affine" gear="1 0 0 0 0 0"/>' for i in range(2) for axis in "xyz")}
    {"".join(f'<velocity joint="spin{i}" kv="{p.wheel_servo_gain}"/>' for i in range(2))}
    {"".join(f'<velocity joint="steer{i}" kv="{p.steer_servo_gain}"/>' for i in range(2) if STEERED[i])}
  </actuator>
</mujoco>""")


def _wheel(p, i: int, x: float) -> str:
    axle, diameter = p.wheel_inertia_axle, p.wheel_inertia_diameter
    return f"""
      <body name="wheel{i}" pos="{x} 0 0">
        {f'<joint name="steer{i}" axis="0 0 1"/>' if STEERED[i] else ""}
        <joint name="spin{i}" axis="0 1 0"/>
        <inertial pos="0 0 0" mass="{p.wheel_mass}" diaginertia="{diameter} {axle} {diameter}"/>
        <site name="wheel{i}"/>
      </body>"""
