"""Checks of the library against independent computations and measurements."""
