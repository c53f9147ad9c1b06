"""Foreign packages: archives and XML that would do harm are refused before anything is written."""

import struct
from zipfile import ZIP_BZIP2, ZIP_DEFLATED, ZipFile, ZipInfo

import pytest
from ssp_fmus import PLANT, binding, describe, message, one, parameter_set, reader, structure, write_fmu

from orchestrator.ssp import SspError, archive, unpack, xml


@pytest.fixture
def plant(tmp_path):
    return write_fmu(tmp_path / "plant.fmu", PLANT)


@pytest.fixture
def read(tmp_path, plant):
    return reader(tmp_path, plant)


def archive_of(tmp_path, *entries):
    path = tmp_path / "evil.fmu"
    with ZipFile(path, "w", ZIP_DEFLATED) as package:
        for entry, content in entries:
            package.writestr(entry, content)
    return path


def refused(tmp_path, path):
    with pytest.raises(SspError) as caught:
        unpack(path, tmp_path / "cache")
    assert not list((tmp_path / "cache").glob("*")), "nothing is left behind"
    assert not (tmp_path / "outside").exists()
    return str(caught.value)


@pytest.mark.parametrize("name", ["../outside", "a/../../outside", "/tmp/outside", "..\\outside", "C:/outside"])
def test_path_out_of_the_archive(tmp_path, name):
    assert f"evil.fmu: entry {name!r} points outside the package" in refused(tmp_path, archive_of(tmp_path, (name, "x")))


def test_links(tmp_path):
    link = ZipInfo("link")
    link.create_system, link.external_attr = 3, 0o120777 << 16
    assert "entry 'link' is a link or a special file" in refused(tmp_path, archive_of(tmp_path, (link, "/etc/passwd")))


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize("names", [("a", "a"), ("a", "A"), ("a", "./a"), ("a", "a/b")])
def test_doubled_names(tmp_path, names):
    assert "occurs twice" in refused(tmp_path, archive_of(tmp_path, *((name, "x") for name in names)))


def test_zip_bombs(tmp_path, monkeypatch):
    zeros = bytes(20 * 2**20)
    assert "20971520, more than 200 times as many (a ZIP bomb)" in refused(tmp_path, archive_of(tmp_path, ("zeros", zeros)))
    monkeypatch.setattr(archive, "MAX_BYTES", 1000)
    assert "unpacks to 1001 bytes, more than 1000" in refused(tmp_path, archive_of(tmp_path, ("data", bytes(1001))))
    monkeypatch.setattr(archive, "MAX_ENTRIES", 2)
    assert "3 entries, more than 2" in refused(tmp_path, archive_of(tmp_path, *((str(i), "") for i in range(3))))


def test_declared_size_is_a_lie(tmp_path):
    path = archive_of(tmp_path, ("data", bytes(5000)))
    content = path.read_bytes()
    path.write_bytes(content.replace(struct.pack("<L", 5000), struct.pack("<L", 10)))
    assert "no readable ZIP archive" in refused(tmp_path, path)


def test_other_compression(tmp_path):
    path = tmp_path / "evil.fmu"
    with ZipFile(path, "w", ZIP_BZIP2) as package:
        package.writestr("data", "x")
    assert "entry 'data' has compression method 12; pack it with deflate" in refused(tmp_path, path)


def test_no_archive(tmp_path):
    path = tmp_path / "text.fmu"
    path.write_text("hello")
    assert "text.fmu: no readable ZIP archive" in refused(tmp_path, path)


BOMB = '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>'


def test_xml_entities(read, tmp_path):
    text = message(read, BOMB + one())
    assert "SystemStructure.ssd, line 1: a document type declaration (DTD, entities) is not allowed; remove it" in text
    bomb = write_fmu(tmp_path / "bomb.fmu", describe(prolog=BOMB))
    assert "plant.fmu (a): modelDescription.xml, line 1: a document type declaration" in message(read, one(), {"plant": bomb})
    external = '<!DOCTYPE x SYSTEM "file:///etc/passwd">' + parameter_set()
    assert "p.ssv, line 1: a document type declaration" in message(read, one(bindings=binding(source="p.ssv")), **{"p.ssv": external})


def test_xml_too_deep_too_large_or_malformed(read, monkeypatch):
    assert "elements nested deeper than 64" in message(read, structure("<a>" * 100 + "</a>" * 100))
    for text in ("<ssd:System>", '<?xml version="1.0" encoding="klingon"?><a/>'):
        assert "SystemStructure.ssd: malformed XML" in message(read, text)
    monkeypatch.setattr(xml, "MAX_BYTES", 100)
    assert "bytes of XML, more than 100" in message(read, one())


@pytest.mark.parametrize(
    "source",
    ["../plant.fmu", "file:///etc/passwd", "http://x/plant.fmu", "/etc/passwd", "%2e%2e/plant.fmu", "#other", "a%00b", "http://[x"],
)
def test_source_outside_the_package(read, source):
    assert f"source = '{source}' is no file of the package" in message(read, one().replace("resources/plant.fmu", source))


def test_unpacked_once(tmp_path, plant):
    folder = unpack(plant, tmp_path / "cache")
    (folder / "mark").touch()
    copy = tmp_path / "copy.fmu"
    copy.write_bytes(plant.read_bytes())
    assert unpack(copy, tmp_path / "cache") == folder
    assert (folder / "mark").exists()
