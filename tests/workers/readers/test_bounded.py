import lz4.frame
import pytest
import zstandard

from workers.readers.bounded import ExpandsError, decompress_lz4, decompress_zstd


@pytest.mark.parametrize(
    ("packed", "unpack", "size"),
    [
        (zstandard.compress(bytes(50_000_000)), decompress_zstd, 50_000_000),
        (lz4.frame.compress(bytes(50_000_000)), decompress_lz4, 50_000_000),
        (zstandard.compress(bytes(600)) * 2, decompress_zstd, 1200),  # several frames are bounded together
    ],
)
def test_no_more_comes_out_than_is_allowed(packed, unpack, size):
    assert len(packed) < 300_000 and unpack(packed, size) == bytes(size)
    for most in (1000, size - 1):
        with pytest.raises(ExpandsError, match=f"more than {most} bytes"):
            unpack(packed, most)
