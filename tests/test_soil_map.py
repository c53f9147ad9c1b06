"""Reading the soil's surface from the slave that holds it."""

from types import SimpleNamespace

import numpy as np
import pytest

from cdl_fmu import SCM, Instance
from cdl_fmu.scm.pool import SoilPool
from cdl_fmu.scm.tiles import BASE, SINKAGE, TILE, TILE_I, TILE_J
from cdl_fmu.slave.state import State
from orchestrator.soil_map import soil_of

GUID, CELL = "a-guid", 0.02


def system_of(**models):
    return SimpleNamespace(components={name: component(name, model) for name, model in models.items()})


def component(name, model):
    description = SimpleNamespace(modelName=model, guid=GUID, modelVariables=[SimpleNamespace(name="cell", start="0.01")])
    return SimpleNamespace(name=name, model_description=description, parameters={"cell": CELL})


def state(tiles):
    """What a slave gives whose soil has these tiles {(i, j): sinkage [m]} at a height of 1 m."""
    model = SCM()
    pool = model.make_pool(Instance(model, cell=CELL).p, {})
    rows, marks, head = pool.arrays[:3]
    for row, ((i, j), sinkage) in enumerate(tiles.items()):
        rows[row, BASE], rows[row, SINKAGE] = 1.0, sinkage
        marks[row, 0], marks[row, TILE_I], marks[row, TILE_J] = 1, i, j
    head[0] = len(tiles)
    return GUID.encode() + State(np.arange(5.0), {}, pool.save()).to_bytes(SoilPool)


def master_of(**states):
    return SimpleNamespace(slaves=[SimpleNamespace(name=name, to_bytes=lambda s=state: s) for name, state in states.items()])


def test_the_surface_of_the_scm_among_the_slaves_lies_at_its_place_and_the_rest_of_its_rectangle_is_not_known():
    soil = soil_of(system_of(rover="cdl_rover_w2", bcm="cdl_bcm_w1p1", ground="cdl_scm_w1p1"))
    origin, spacing, z = soil(master_of(rover=b"rover", bcm=b"", ground=state({(-1, 0): 0.25, (1, 0): 0.0})))
    assert origin == pytest.approx((-TILE * CELL, 0.0)) and spacing == CELL
    assert z.shape == (3 * TILE, TILE)
    assert (z[:TILE] == 0.75).all() and np.isnan(z[TILE : 2 * TILE]).all() and (z[2 * TILE :] == 1.0).all()


def test_soil_that_nothing_touched_has_no_surface_yet():
    assert soil_of(system_of(scm="cdl_scm_w2"))(master_of(scm=state({}))) is None


def test_a_system_without_scm_has_no_soil():
    assert soil_of(system_of(rover="cdl_rover_w2", bcm="cdl_bcm_w2")) is None
