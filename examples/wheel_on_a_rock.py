"""A rigid wheel on rock in process, without any FMU: VEM bears it where its rim meets a stone, beside the floor that it stands on."""

import tempfile
from pathlib import Path

import numpy as np
import trimesh

from cdl_fmu.mesh.rocks import rock
from cdl_fmu.slave.model import Instance
from cdl_fmu.vem import VEM

folder = Path(tempfile.mkdtemp())
floor = trimesh.creation.box((4.0, 1.0, 0.2))
floor.apply_translation((0.0, 0.0, -0.1))  # its upper face is z = 0
floor.export(folder / "floor.stl")
rock(seed=3, size=(0.2, 0.16, 0.12)).export(folder / "rock.stl")

meshes = {"body[1].mesh": folder / "floor.stl", "body[2].mesh": folder / "rock.stl"}
contact = Instance(VEM(n_wheels=1, n_bodies=2), n_g=0.0, **meshes, **{"body[1].fixed": "on", "body[2].fixed": "on"})
wheel, stone = contact.u.wheel[0], contact.u.body[1]
wheel["T"][:] = np.eye(3)
wheel.v_0[0], wheel.w_0[1] = 0.125, 1.0  # rolls [m/s], [rad/s]
stone.r_0[:] = 0.24, 0.0, 0.02
contact.initialise()
for k in range(800):
    wheel.r_0[:] = 0.125e-3 * k, 0.0, 0.125 - 1e-4  # 0.1 mm in the floor [m]
    contact.step(t=1e-3 * k, h=1e-3)
    if contact.y.body[1].f_0[2] < 0.0:
        break
print(f"the stone is met at x = {wheel.r_0[0]:.3f} m")
for pair in contact.y.pair:
    if pair.on:
        x, y, z = pair.point_0
        print(f"body {pair.against - 1:.0f} at ({x:.3f}, {y:6.3f}, {z:.3f}) m pushes with {pair.F[2]:6.1f} N along {pair.axes[2].round(2)}")
