"""The two-wheel rover of Table 8.2 as a MuJoCo model, and rocks."""

from __future__ import annotations

import mujoco

#: Which wheels steer, front wheel first (section 8.4.2: the rear wheel alone).
STEERED = (False, True)

# Rotational inertia of the "point" mass [kg.m2]: small enough to be none, large enough for MuJoCo to take.
_POINT = 1e-12


def two_wheel(n_rocks: int) -> mujoco.MjModel:
    """Model of the rover and of rocks, without drives and contacts, for parameters yet to come (:func:`mbs.rover_state.set_up`).

    Joints in order: x, y, z, yaw, pitch of the body (no roll), then per wheel steering, where it steers, and spin; then the rocks'.
    Where parameters decide what lies in one point or along one axis the numbers here are others, as MuJoCo takes short cuts there.
    """
    return mujoco.MjModel.from_xml_string(f"""
<mujoco model="two-wheel rover">
  <compiler angle="radian"/>
  <option>
    <flag contact="disable" autoreset="disable"/>
  </option>
  <worldbody>
    <body name="body">
      <joint name="x" type="slide" axis="1 0 0"/>
      <joint name="y" type="slide" axis="0 1 0"/>
      <joint name="z" type="slide" axis="0 0 1"/>
      <joint name="yaw" axis="0 0 1"/>
      <joint name="pitch" axis="0 1 0"/>
      <inertial pos="0 0 1" mass="1" diaginertia="{_POINT} {_POINT} {_POINT}"/>
      {"".join(_wheel(i) for i in range(len(STEERED)))}
    </body>
    {"".join(_rock(j) for j in range(n_rocks))}
  </worldbody>
</mujoco>""")


def _wheel(i: int) -> str:
    return f"""
      <body name="wheel{i}" pos="1 0 0">
        {f'<joint name="steer{i}" axis="0 0 1"/>' if STEERED[i] else ""}
        <joint name="spin{i}" axis="0 1 0"/>
        <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
      </body>"""


def _rock(j: int) -> str:
    return f"""
    <body name="rock{j}">
      <freejoint/>
      <inertial pos="1 1 1" mass="1" fullinertia="3 4 5 .1 .2 .3"/>
    </body>"""
