"""Reference systems as text: their codes and names."""

import pytest
from rasterio.crs import CRS

from contourfair_jax._grid.reference import crs_title, epsg_code, is_crs84


@pytest.mark.parametrize(
    ("crs", "code"),
    [
        ("EPSG:32633", "32633"),
        ("urn:ogc:def:crs:EPSG::4326", "4326"),
        ("urn:ogc:def:crs:EPSG:9.9:4326", "4326"),
        ("http://www.opengis.net/def/crs/EPSG/0/3857", "3857"),
        (CRS.from_epsg(32725).to_wkt(), "32725"),
        (CRS.from_epsg(32725).to_wkt(version="WKT2_2019"), "32725"),
        ('LOCAL_CS["a mine"]', None),
        ("OGC:CRS84", None),
    ],
)
def test_epsg_code(crs, code):
    assert epsg_code(crs) == code


def test_longitude_first():
    assert is_crs84("OGC:CRS84")
    assert is_crs84("urn:ogc:def:crs:OGC:1.3:CRS84")
    assert not is_crs84("EPSG:4326")
    assert not is_crs84("CRS84h")


def test_title():
    assert crs_title(CRS.from_epsg(32633).to_wkt()) == "WGS 84 / UTM zone 33N"
    assert crs_title("EPSG:32633") == "EPSG:32633"
