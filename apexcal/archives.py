"""Read the files of a ZIP from the service, with the care that a stranger's ZIP needs."""

from __future__ import annotations

import io
import re
import zipfile
import zlib

# The service's names: plain steps, none hidden, none that climbs.
_PLAIN = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_.-]*(?:/[A-Za-z0-9_-][A-Za-z0-9_.-]*)*")
_MOST_BYTES = 64 * 2**20


def read_archive(content: bytes) -> dict[str, bytes]:
    """Return each file by its name. No name leads out of the folder that the archive is unpacked to.

    Raises ValueError, with what is wrong, for an archive that is damaged, empty, too large, or has other names.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            names, size = archive.namelist(), sum(entry.file_size for entry in archive.infolist())
            folders = {name[:end] for name in names for end in range(len(name)) if name[end] == "/"}
            odd = [name for name in names if not _PLAIN.fullmatch(name) or name in folders or names.count(name) > 1]
            if odd or not names:
                raise ValueError(f"holds {odd[0]!r}, which is no plain name of a file" if odd else "holds no file")
            if size > _MOST_BYTES:
                raise ValueError(f"holds {size} bytes, more than any calibration")
            return {name: archive.read(name) for name in names}
    except (zipfile.BadZipFile, zlib.error, RuntimeError, EOFError) as error:
        raise ValueError(f"is no whole archive ({error})") from None
