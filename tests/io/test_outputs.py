"""Names of outputs: their endings."""

from pathlib import Path

import pytest

from contourfair_jax.io import InputError
from contourfair_jax.io._outputs import known_suffix


def test_the_ending_decides_whatever_its_case():
    assert known_suffix("a/b.GeoJSON", (".json", ".geojson")) == ".geojson"
    assert known_suffix(Path("fine.zarr"), {".zarr": 1}) == ".zarr"


@pytest.mark.parametrize("name", ["lines", "lines.dxf", "lines.json.bak", ".json"])
def test_other_endings_are_refused(name):
    with pytest.raises(InputError, match=rf"^{name}: the name must end in \.json, \.csv$"):
        known_suffix(name, iter((".json", ".csv")))
