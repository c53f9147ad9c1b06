"""Virtual tests of a bed of particles: direct shear, angle of repose, and plates pressed into it."""
