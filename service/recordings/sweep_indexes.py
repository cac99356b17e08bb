"""The indexes of LiDARs' files, read from the store in blocks: where each sweep stands, and its stamp."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from typing import Final

from apexcal.documents.sensor_files import SWEEP_ENTRY, SweepEntry
from service.platform.storage.store import Store

# Sweeps of seven minutes at 10 Hz; 98 kB. A file never changes, so a block is right for ever.
_BLOCK: Final = 4096
_MOST_BLOCKS: Final = 64


@dataclass(frozen=True, slots=True)
class SweepsFile:
    """The file of a LiDAR, where its index begins, and how many sweeps it has."""

    key: str
    offset: int
    count: int


class SweepIndexes:
    """Indexes of the recordings used last stay in memory, 6 MB at most."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._blocks: OrderedDict[tuple[str, int], bytes] = OrderedDict()

    async def entry(self, file: SweepsFile, index: int) -> SweepEntry:
        """Return the place of sweep ``index``. Raises as :class:`Store` does."""
        number, within = divmod(index, _BLOCK)
        return SweepEntry(*SWEEP_ENTRY.unpack_from(await self._block(file, number), SWEEP_ENTRY.size * within))

    async def at_or_after(self, file: SweepsFile, stamp_ns: int) -> int:
        """The number of the first sweep with this stamp or a later one; their count if there is none."""
        low, high = 0, file.count
        while low < high:
            middle = (low + high) // 2
            if (await self.entry(file, middle)).stamp_ns < stamp_ns:
                low = middle + 1
            else:
                high = middle
        return low

    async def _block(self, file: SweepsFile, number: int) -> bytes:
        block = self._blocks.get((file.key, number))
        if block is None:
            first = number * _BLOCK
            length = SWEEP_ENTRY.size * min(_BLOCK, file.count - first)
            start = file.offset + SWEEP_ENTRY.size * first
            block = b"".join([piece async for piece in self._store.read_all(file.key, start, length)])
            self._blocks[file.key, number] = block
            while len(self._blocks) > _MOST_BLOCKS:
                self._blocks.popitem(last=False)
        return block
