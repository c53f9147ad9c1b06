"""A lander's footpad on deforming soil: a body from an STL file is pressed in, in process, without any FMU."""

import tempfile
from pathlib import Path

import trimesh

from cdl_fmu import SCM, Instance, load_soil

# A dish, 0.2 m across below and 0.3 m above, whose origin is the middle of its lower face; in metres.
dish = trimesh.creation.revolve([(0.0, 0.0), (0.1, 0.0), (0.15, 0.06), (0.0, 0.06)], sections=64)
mesh = Path(tempfile.mkdtemp(), "footpad.stl")
dish.export(mesh)

soil = Instance(SCM(n_wheels=1, n_bodies=1), **{"body[1].mesh": mesh}, **load_soil("mss_d"))
soil.u.wheel[0].active = 0.0  # no wheel here
soil.initialise()
footpad = soil.u.body[0]
footpad.v_0[2] = -0.05  # [m/s]
for k in range(800):
    footpad.r_0[2] -= 0.05e-3
    soil.step(t=1e-3 * k, h=1e-3)
    if k % 200 == 199:
        print(f"sinkage {-1e3 * footpad.r_0[2]:4.0f} mm  force {soil.y.body[0].f_0[2]:7.1f} N")
