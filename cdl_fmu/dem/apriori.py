"""Stub."""
def grains_of(phi, c, rho, porosity, linear=False):
    raise NotImplementedError
