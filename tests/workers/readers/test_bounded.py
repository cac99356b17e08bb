import lz4.frame
import pytest
import zstandard

from workers.readers.bounded import ExpandsError, decompress_lz4, decompress_zstd

ZEROS = bytes(50_000_000)


@pytest.mark.parametrize(
    ("pack", "unpack"), [(zstandard.compress, decompress_zstd), (lz4.frame.compress, decompress_lz4)]
)
def test_no_more_comes_out_than_is_allowed(pack, unpack):
    packed = pack(ZEROS)
    assert len(packed) < 300_000
    with pytest.raises(ExpandsError, match="more than 1000 bytes"):
        unpack(packed, 1000)
    assert unpack(pack(b"just this"), 9) == b"just this"


def test_several_frames_are_bounded_together():
    packed = zstandard.compress(bytes(600)) * 2
    assert decompress_zstd(packed, 1200) == bytes(1200)
    with pytest.raises(ExpandsError):
        decompress_zstd(packed, 1199)
