"""Inputs at random with which any model can be tried."""

import numpy as np
from slabs import place_of

from cdl_fmu.frames import axis_rotation


def some_inputs(model, rng) -> np.ndarray:
    """Values near the start values; wheels a little in the ground, turned, rolling and sliding; patches under them."""
    starts = model.inputs.starts()
    block = starts + rng.uniform(-0.5, 0.5, starts.size)
    u = block.view(model.inputs.dtype)[0]
    fields = u.dtype.names
    for wheel in u["wheel"] if "wheel" in fields and "r_0" in u["wheel"].dtype.names else ():
        wheel["r_0"][2] = rng.uniform(0.09, 0.12)
        if "T" in wheel.dtype.names:
            pitch, camber, yaw = rng.uniform([-3, -0.2, -3], [3, 0.2, 3])
            wheel["T"] = axis_rotation(2, pitch) @ axis_rotation(1, camber) @ axis_rotation(3, yaw)
    for patch, wheel in zip(u["patch"], u["wheel"]) if "patch" in fields else ():
        patch["spacing"] = spacing = 0.03
        patch["origin"] = spacing * np.round(wheel["r_0"][:2] / spacing - np.array(patch["z"].shape) // 2)
        patch["z"] = rng.uniform(-0.01, 0.01, patch["z"].shape)
    for j, body in enumerate(u["body"] if "body" in fields else ()):
        body["r_0"], body["T"] = np.array(place_of(j)) - (0.0, 0.0, 0.021), np.eye(3)  # as wheels lean, and no contact may be deep
    scalars = model.inputs.scalars()
    return block.clip([s.field.min for s in scalars], [s.field.max for s in scalars])
