"""BCM on flat ground: closed forms, symmetries, identities."""

import pytest

from cdl_fmu import BCM, Instance, load_soil
from cdl_fmu.bcm import loads

TABLE_8_2 = load_soil("mss_d")


def smooth(**parameters) -> Instance:
    """A wheel of Table 8.2 without grousers and damping."""
    instance = Instance(BCM(), **(TABLE_8_2 | dict(n_g=0, c_d=0) | parameters))
    instance.initialise()
    return instance


def test_rim_loads_of_the_reference_vector():
    """Values computed independently with a converged quadrature; rim alone, without side faces."""
    bcm = smooth(eta=0.3, V_theta=0.01, V_j=0.01)
    p = bcm.arrays[0][0]
    k_eq = 2.2412e8
    tan_phi = 0.7453774
    out = loads.rim(p, k_eq, tan_phi, 0.125, 0.125 - 0.0288, 0.0, 1.0, 0.1, 0.01, 0.0, 0.0, 1.0, 0.0, 0.125, 0.2)
    fx, fa, fr, _, ma = out[:5]
    assert (fx, fa, fr, -ma) == pytest.approx((150.66545, -66.35109, 280.82908, 22.31559), rel=1e-5)
