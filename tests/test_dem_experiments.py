"""Experiments with wheels on particles, short and coarse: they run end to end with every tier behind."""

import beds
import numpy as np
import pytest

import orchestrator
from orchestrator.experiment import ExperimentError
from orchestrator.results import open_result

#: A light rover with small smooth wheels, on the small bed.
ROVER = {
    **{f"wheel.{name}": beds.VALUES[name] for name in ("r_w", "b_w", "n_g")},
    **{f"dem.{name}": beds.VALUES[name] for name in ("d", "depth", "box_length", "box_width")},
    "dem.fine_depth": 0.0,
    "dem.threads": 1,
    "rover.mass": 1.5,
    "rover.wheel_mass": 0.2,
}
WEIGHT = (1.5 + 2 * 0.2) * 9.81


def drive(out, tiers, **options):
    overrides = {**ROVER, "dem.bed": str(beds.bed_file()), **options.pop("overrides", {})}
    return orchestrator.simulate("two_wheel", out, tiers=tiers, overrides=overrides, picture=False, **options)


@pytest.mark.parametrize("rear", ("BCM", "VEM", "DEM"))
def test_a_rover_stands_on_particles_in_front_and_on_any_tier_behind(rear, tmp_path):
    outcome = drive(tmp_path, ("DEM", rear), stop_time=0.2)
    result = open_result(outcome.result).cdl
    wheels = [f"dem.diagnostics[{i}]" for i in (1, 2)] if rear == "DEM" else ["dem.diagnostics[1]", f"{rear.lower()}.diagnostics[1]"]
    loads = np.array([result[f"{wheel}.normal_load"].values for wheel in wheels])
    assert np.isfinite(loads).all() and loads.min() >= 0.0
    # It comes down on the particles from their highest grain, which takes longer than on ground that is known.
    assert loads[:, -50:].sum(axis=0).mean() == pytest.approx(WEIGHT, rel=0.3)
    assert np.abs(np.diff(result["rover.wheel[1].r_0[3]"].values)).max() < 5e-4
    if rear == "BCM":
        assert result["dem.patch[1].revision"].values[-1] >= 1.0 if "dem.patch[1].revision" in result else True


def test_a_run_goes_on_from_its_checkpoint_to_the_same_bits(tmp_path):
    whole = drive(tmp_path / "whole", ("DEM", "BCM"), stop_time=0.09)
    drive(tmp_path / "parts", ("DEM", "BCM"), stop_time=0.06, checkpoint_every=0.06)
    (checkpoint,) = (tmp_path / "parts").glob("checkpoint_*.npz")
    rest = drive(tmp_path / "rest", ("DEM", "BCM"), stop_time=0.09, resume=checkpoint)
    a, b = (open_result(outcome.result).cdl for outcome in (whole, rest))
    for name in ("dem.wheel[1].f_0[3]", "rover.wheel[1].r_0[3]", "rover.wheel[2].r_0[3]"):
        assert a[name].values[-30:].tobytes() == b[name].values[-30:].tobytes()


def test_warnings_of_particles_reach_whoever_runs_it(tmp_path):
    warned = drive(tmp_path, ("DEM", "BCM"), stop_time=0.002, overrides={"dem.porosity": 0.44}).warnings
    assert [text for text in warned if "porosity = 0.44: the bed has 0.42" in text]
    with pytest.raises(ExperimentError, match=r"two_wheel.toml: d = 0.005 m: the bed has 0.01 m; give it that value, or another bed"):
        drive(tmp_path, ("DEM", "BCM"), stop_time=0.002, overrides={"dem.d": 0.005})
