"""The two-wheel rover of Table 8.2 as a MuJoCo model, and rocks."""

from __future__ import annotations

import mujoco

from cdl_fmu.frames import vertical

#: Which wheels steer, front wheel first (section 8.4.2: the rear wheel alone).
STEERED = (False, True)

# Rotational inertia of the "point" mass [kg.m2]: small enough to be none, large enough for MuJoCo to take.
_POINT = 1e-12


def two_wheel(p, n_rocks: int) -> mujoco.MjModel:
    """Model of the rover with parameters ``p`` (:class:`mbs.rover.Rover`) and of rocks, without drives and contacts.

    Joints in order: x, y, z, yaw, pitch of the body (no roll), then per wheel steering, where it steers, and spin; then the rocks'.
    """
    down = " ".join(str(-p.gravity * along) for along in vertical(p.slope, p.uphill))
    return mujoco.MjModel.from_xml_string(f"""
<mujoco model="two-wheel rover">
  <compiler angle="radian"/>
  <option gravity="{down}">
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
    {"".join(_rock(p.rock[j], j) for j in range(n_rocks))}
  </worldbody>
</mujoco>""")


def _wheel(p, i: int, x: float) -> str:
    axle, diameter = p.wheel_inertia_axle, p.wheel_inertia_diameter
    return f"""
      <body name="wheel{i}" pos="{x} 0 0">
        {f'<joint name="steer{i}" axis="0 0 1"/>' if STEERED[i] else ""}
        <joint name="spin{i}" axis="0 1 0"/>
        <inertial pos="0 0 0" mass="{p.wheel_mass}" diaginertia="{diameter} {axle} {diameter}"/>
      </body>"""


def _rock(rock, j: int) -> str:
    x, y, z, xy, xz, yz = rock.inertia
    return f"""
    <body name="rock{j}">
      <freejoint/>
      <inertial pos="{_text(rock.center)}" mass="{rock.mass}" fullinertia="{_text((x, y, z, xy, xz, yz))}"/>
    </body>"""


def _text(numbers) -> str:
    return " ".join(map(str, numbers))
