"""Reading the soil's surface from the slave that holds it."""

from types import SimpleNamespace

import numpy as np
import pytest

from cdl_fmu.scm import tiles
from orchestrator.soil_map import soil_of


def system_of(**models):
    components = {name: SimpleNamespace(model_description=SimpleNamespace(modelName=model)) for name, model in models.items()}
    return SimpleNamespace(components=components)


def master_of(**states):
    return SimpleNamespace(slaves=[SimpleNamespace(name=name, to_bytes=lambda s=state: s) for name, state in states.items()])


@pytest.fixture(autouse=True)
def heights(monkeypatch):
    """States here are texts; only that of soil has heights."""
    z = np.arange(6.0).reshape(2, 3)
    found = {b"soil": SimpleNamespace(origin=(-0.02, 0.01), spacing=0.01, z=z)}
    monkeypatch.setattr(tiles, "heights_of", found.get, raising=False)


def test_the_surface_of_the_scm_among_the_slaves_lies_at_its_world_coordinates():
    soil = soil_of(system_of(rover="cdl_rover_w2", bcm="cdl_bcm_w1p1", ground="cdl_scm_w1p1"))
    z = soil(master_of(rover=b"rover", bcm=b"", ground=b"soil"))
    assert z.dims == ("x", "y")
    assert z.x.values == pytest.approx([-0.02, -0.01]) and z.y.values == pytest.approx([0.01, 0.02, 0.03])
    assert np.array_equal(z, np.arange(6.0).reshape(2, 3))


def test_soil_that_nothing_touched_has_no_surface_yet():
    assert soil_of(system_of(scm="cdl_scm_w2"))(master_of(scm=b"untouched")) is None


def test_a_system_without_scm_has_no_soil():
    assert soil_of(system_of(rover="cdl_rover_w2", bcm="cdl_bcm_w2")) is None
