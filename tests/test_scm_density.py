"""Soil that gets denser and stronger where it is compacted again."""

import math

import numpy as np
import pytest
from bodies import Bodies, plate
from soil import ALONG_Y, LOAD, Carriage, excess, fields, on_soil, scm

from cdl_fmu.scm.density import bearing_gain, densification, density_of, friction
from cdl_fmu.scm.tiles import COMPACTED, QUANTUM, SINKAGE
from cdl_fmu.slave.kernel import MOST_THREADS
from cdl_fmu.slave.model import ModelError
from cdl_fmu.terramechanics import flow_value

#: Loose sand of quartz.
LOOSE = dict(rho=1500.0, e_min=0.4, compressible="on")


def test_friction_is_caquots_and_kerisels():
    p = scm(**LOOSE).p
    law, tan_phi, depth = density_of(p), math.tan(p.phi), 2.0 * p.b_w
    e_0 = p.rho_s / p.rho - 1.0
    for compacted in (0.0, 0.01, 0.02):
        rho = p.rho * densification(law, compacted)
        assert rho == pytest.approx(p.rho * depth / (depth - compacted))
        assert (p.rho_s / rho - 1.0) * friction(law, compacted, 0.0) == pytest.approx(e_0 * tan_phi)
    densest = p.rho * densification(law, law.most)
    assert p.rho_s / densest - 1.0 == pytest.approx(0.4)
    assert law.most == round(law.most / QUANTUM) * QUANTUM


def test_tests_hold_the_compaction_that_they_make():
    p = scm(**LOOSE, plasticity=0.6).p
    law, tan_phi = density_of(p), math.tan(p.phi)
    assert friction(law, 0.4 * 0.03, 0.03) == pytest.approx(tan_phi) and bearing_gain(law, tan_phi) == 1.0
    denser = friction(law, 0.4 * 0.03, 0.0)
    assert denser > friction(law, 0.4 * 0.03, 0.01) > tan_phi
    N_q, N_q_0 = (flow_value(phi) * math.exp(math.pi * math.tan(phi)) for phi in (math.atan(denser), float(p.phi)))
    assert bearing_gain(law, denser) == pytest.approx(N_q / N_q_0, rel=1e-6)


def test_soil_keeps_its_strength_if_it_is_not_compressible():
    law = density_of(scm().p)
    assert friction(law, 0.02, 0.01) == law.tan_phi == math.tan(scm().p.phi)
    assert densification(law, 0.02) == bearing_gain(law, law.tan_phi) == 1.0
    assert law.most == math.inf


def test_the_chapters_soil_is_not_compressible():
    default, off = (on_soil(**parameters).move(0.3, forward=0.1, rate=1.2) for parameters in ({}, dict(compressible="off", e_min=5)))
    assert np.array_equal(default, off)


@pytest.mark.parametrize("compressible", ["off", "on"])
def test_the_cells_compaction_sums_to_the_total_to_the_last_bit(compressible):
    """Two wheels, one of which crosses the other's rut, and a body; landslides, transport and heave move no compaction."""
    instance = scm(2, compressible=compressible)
    first, second = Carriage(instance, 0, load=LOAD), Carriage(instance, 1, at=(0.15, -0.1), heading=ALONG_Y, load=LOAD)
    for k in range(800):
        for carriage in (first, second):
            carriage.set_inputs(forward=0.2, sideways=0.02, rate=1.8)
        instance.step(k * 1e-3, 1e-3)
        assert fields(instance, COMPACTED).sum() == instance.x.compacted
        for carriage in (first, second):
            carriage.move_on(1e-3)
    assert instance.x.compacted > 1.0


def test_soil_gets_no_denser_than_its_grains_allow():
    """A wheel rocks down through loose soil; what cannot be compacted flows out."""
    carriage = Carriage(scm(rho=1500.0, e_min=0.7, compressible="on"))
    carriage.move(0.8, h=2e-3, up=-0.1)
    carriage.move(0.5, h=2e-3, forward=0.05, rate=0.4)
    p, compacted = carriage.instance.p, fields(carriage.instance, COMPACTED)
    assert compacted.max() == density_of(p).most
    assert p.rho * densification(density_of(p), compacted.max()) <= p.rho_s / (1.0 + p.e_min)
    assert compacted.sum() == carriage.instance.x.compacted
    assert 0.4 * fields(carriage.instance, SINKAGE).sum() > 1.2 * compacted.sum()


def passes(n, **parameters):
    """Mean pull [N] and sinkage [m] of a smooth wheel in each of n passes through its rut."""
    carriage = on_soil(n_g=0, **parameters)
    found = []
    for _ in range(n):
        readings = carriage.move(1.5, h=2e-3, forward=0.2, rate=2.0)[300:]
        found.append((readings[:, 0].mean(), readings[:, -1].mean()))
        load, carriage.load = carriage.load, None
        carriage.move(0.1, h=2e-3, up=1.0)
        carriage.r[:2] = 0.0
        for _ in range(20):  # nothing slides any more
            carriage.move(0.01, h=2e-3)
        assert excess(carriage.instance)[0] < 0.05
        carriage.r[2], carriage.load, carriage.v_z = 0.125 - found[-1][1], load, 0.0
        carriage.put_down()
    return np.array(found)


def test_later_passes_in_a_rut_pull_more_in_compressible_soil():
    off, on = passes(3), passes(3, compressible="on")
    assert on[0] == pytest.approx(off[0], rel=0.02)
    assert on[1, 0] > off[1, 0] + 0.02 * LOAD and on[2, 0] > off[2, 0] + 0.04 * LOAD
    assert on[2, 0] > on[1, 0]
    assert on[2, 1] - on[0, 1] < 0.7 * (off[2, 1] - off[0, 1])


def test_bodies_feel_what_compaction_left(tmp_path):
    """A plate that is pressed again where soil slid into its print meets more pressure."""
    found = {}
    for compressible in ("off", "on"):
        bodies = Bodies(plate(tmp_path / "plate.stl", 0.1), compressible=compressible)
        bodies.place(0, 0.0, 0.0, 0.0)
        found[compressible] = []
        for _ in range(3):
            found[compressible].append(bodies.move(0.3, (0.0, 0.0, -0.1), h=2e-3)[-1, 2])
            bodies.move(0.3, (0.0, 0.0, 0.1), h=2e-3)
    assert found["on"][0] == pytest.approx(found["off"][0], rel=0.03)
    assert found["on"][2] > 1.05 * found["off"][2]


def crossing(**parameters):
    """Two wheels that go back and forth in ruts that cross: the instance, the forces on them, and what the pool saves."""
    instance = scm(2, compressible="on", **parameters)
    carriages = [Carriage(instance, i, at=(0.15 * i, -0.1 * i), heading=((1.0, 0.0), ALONG_Y)[i], load=LOAD) for i in range(2)]
    return instance, [drive_on(instance, carriages, 800), instance.pool.to_bytes(instance.save().pool)]


def drive_on(instance, carriages, n):
    forces = []
    for k in range(n):
        for carriage in carriages:
            forward = 0.2 if k % 400 < 200 else -0.2
            carriage.set_inputs(forward=forward, rate=9.0 * forward)
        instance.step(k * 1e-3, 1e-3)
        forces.append(instance.y.wheel.copy())
        for carriage in carriages:
            carriage.move_on(1e-3)
    return np.array(forces)


@pytest.mark.skipif(MOST_THREADS < 2, reason="this machine has one core")
def test_no_bit_of_density_depends_on_the_number_of_threads():
    (_, one), (_, two) = crossing(), crossing(threads=2)
    assert np.array_equal(one[0], two[0]) and one[1] == two[1]


def test_density_goes_with_the_state():
    instance, _ = crossing()
    saved, compacted = instance.save(), fields(instance, COMPACTED).copy()
    carriage = Carriage(instance, 0, load=LOAD)
    carriage.move(0.1, forward=0.2, rate=1.8)
    assert fields(instance, COMPACTED)[: len(compacted)].sum() > compacted.sum()
    instance.restore(saved)
    assert np.array_equal(fields(instance, COMPACTED), compacted)


def test_soil_that_is_as_dense_as_can_be_is_refused():
    text = (
        r"e_min = 0.4: not below the void ratio rho_s/rho - 1 = 0.3977 of undisturbed soil, rho = 1896 kg/m3; use at most 1893 kg/m3 for "
        r"rho, a smaller e_min, or as rho_s, 2650 kg/m3, the density of the grains that this soil has"
    )
    with pytest.raises(ModelError) as error:
        scm(compressible="on", e_min=0.4)
    assert text in str(error.value)
