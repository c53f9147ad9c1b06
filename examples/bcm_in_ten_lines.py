"""A Bekker based contact model in ten lines, without any FMU: drawbar pull of the reference wheel over slip."""

from cdl_fmu import BCM, Instance, load_soil

contact = Instance(BCM(), **load_soil("mss_d"))
contact.initialise()
wheel = contact.u.wheel[0]
wheel.r_0[2] = 0.125 - 0.025  # wheel centre [m]: 25 mm sinkage of a wheel with a radius of 125 mm
wheel.w_0[1] = 1.0  # [rad/s]
for slip in (0.0, 0.1, 0.2, 0.4, 0.8):
    wheel.v_0[0] = (1 - slip) * 0.125  # [m/s]
    contact.step(t=0.0, h=1e-3)
    print(f"slip {slip:3.0%}  F_x {contact.y.wheel[0].f_0[0]:6.1f} N  F_z {contact.y.wheel[0].f_0[2]:6.1f} N")
