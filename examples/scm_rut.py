"""Deforming soil in process, without any FMU: a wheel rolls a metre, then a height patch shows the rut that it left."""

from cdl_fmu import SCM, Instance, load_soil

soil = Instance(SCM(n_wheels=1, n_patches=1), n_g=0.0, **load_soil("mss_d"))
soil.initialise()
wheel, trailing = soil.u.wheel[0], soil.u.trailing[0]
wheel.v_0[0], wheel.w_0[1] = 0.125, 1.0  # [m/s], [rad/s]
trailing.r_0[:] = 0.6, 0.0, 0.1  # where the heights are wanted [m]
for k in range(8000):
    wheel.r_0[:] = 0.125e-3 * k, 0.0, 0.125 - min(0.03, 2e-5 * k)  # lowered to 30 mm sinkage [m]
    soil.step(t=1e-3 * k, h=1e-3)
force, patch = soil.y.wheel[0].f_0, soil.y.patch[0]
print(f"F_x {force[0]:6.1f} N  F_z {force[2]:6.1f} N")
for j, z in enumerate(patch.z[6]):
    y = patch.origin[1] + j * patch.spacing
    print(f"y {1e3 * y:5.0f} mm  z {1e3 * z:6.1f} mm")
