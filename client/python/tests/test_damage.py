"""Damaged bytes are refused with Error, whatever is wrong, and never believed."""

import random
from dataclasses import replace

import pytest
from conftest import VECTORS

from cellmap import Error, open_archive, read_cell, read_changes, read_coded_cell, read_pose_graph, read_scan
from cellmap.coded_cell import _decoded, _read_head

FILES = [("street.cell", read_cell), ("room-10mm.ccod", read_coded_cell), ("room-10mm-2.ccod", read_coded_cell),
         ("room-packed.ccod", read_coded_cell), ("bands-50mm.ccod", read_coded_cell)]
WITHOUT_HASH = [("judged-loops.cpgr", read_pose_graph), ("extremes.cchg", read_changes), ("with-nan.cscn", read_scan)]


@pytest.mark.parametrize("name, reader", FILES)
def test_any_flipped_bit_of_a_hashed_file_is_noticed(name, reader) -> None:
    data = (VECTORS / name).read_bytes()
    dice = random.Random(7)
    for _ in range(60):
        at = dice.randrange(len(data))
        broken = bytearray(data)
        broken[at] ^= 1 << dice.randrange(8)
        with pytest.raises(Error) as caught:
            reader(bytes(broken))
        assert caught.value.code in ("corrupt-data", "unsupported")


@pytest.mark.parametrize("name, reader", FILES + WITHOUT_HASH)
def test_a_file_that_was_cut_off_is_refused(name, reader) -> None:
    data = (VECTORS / name).read_bytes()
    for size in list(range(0, 64)) + list(range(64, len(data) - 8, max(1, len(data) // 50))):
        with pytest.raises(Error):
            reader(data[:size])


@pytest.mark.parametrize("name, reader", WITHOUT_HASH)
def test_other_files_never_raise_anything_but_error(name, reader) -> None:
    data = (VECTORS / name).read_bytes()
    dice = random.Random(8)
    for _ in range(500):
        broken = bytearray(data)
        for _ in range(dice.randrange(1, 4)):
            broken[dice.randrange(len(data))] = dice.randrange(256)
        try:
            reader(bytes(broken))
        except Error as error:
            assert error.code in ("corrupt-data", "unsupported")


def test_decoding_with_a_sound_hash_but_odd_content_stays_within_error() -> None:
    """Behind the hashes: the decoder alone against noise in place of its layers."""
    for name in ("room-10mm.ccod", "room-10mm-2.ccod", "room-packed.ccod"):
        head = _read_head((VECTORS / name).read_bytes())
        dice = random.Random(9)
        for _ in range(40):
            layers = tuple(dice.randbytes(len(layer)) for layer in head.layers)
            broken = bytearray(head.layers[0])
            broken[dice.randrange(4, len(broken))] ^= 0xFF
            for candidate in (layers, (bytes(broken), head.layers[1])):
                try:  # some flips change no plane: the last bytes of a stream say little
                    _decoded(replace(head, layers=candidate), 2)
                except Error as error:
                    assert error.code == "corrupt-data"


def test_an_archive_with_any_flipped_byte_gives_no_wrong_cell(tmp_path) -> None:
    data = (VECTORS / "three-cells.cellmap").read_bytes()
    with open_archive(VECTORS / "three-cells.cellmap") as whole:
        hashes = {entry.id: entry.hash for entry in whole.cells}
        stamps = [scans.stamps_ns.tolist() for scans in whole.scans]
    dice = random.Random(10)
    path = tmp_path / "broken.cellmap"
    noticed = 0
    for at in [*range(0, 64), *(dice.randrange(16384, len(data)) for _ in range(150))]:
        broken = bytearray(data)
        broken[at] ^= 0x10
        path.write_bytes(broken)
        try:
            with open_archive(path) as archive:
                assert {entry.id: entry.hash for entry in archive.cells} == hashes
                assert all(archive.cell(cell).hash == name for cell, name in hashes.items())
                assert [scans.stamps_ns.tolist() for scans in archive.scans] == stamps
        except Error as error:
            assert error.code in ("corrupt-data", "unsupported")
            noticed += 1
    assert noticed > 140  # the rest lies in padding
    path.write_bytes(data[:-1])
    with pytest.raises(Error, match="cut off"):
        open_archive(path)
