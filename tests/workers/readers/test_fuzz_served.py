"""Damaged files over HTTP, one after the other, while another fleet asks for calibrations: it waits for none of them.

The short form of this is in tests/apexcal/test_serve.py, with one file that takes long.
"""

import os
import threading
import time

import pytest
from fuzz_seeds import make_whole
from test_fuzz import damaged

from apexcal.client import Client
from tests.apexcal.conftest import start, stop
from tests.faults.jobs import LEVEL_RIG, ask, new_rig

QUICK = {"slots": 4, "population": 400, "generations": 20, "max_iterations": 4}
UPLOADS = int(os.environ.get("UPLOADS", "300"))
LONGEST_WAIT_S = 10.0


@pytest.mark.slow
@pytest.mark.faults
@pytest.mark.timeout(7200)
def test_no_other_fleet_waits_while_damaged_files_are_read(tmp_path):
    seeds = make_whole(tmp_path)
    served = start(tmp_path / "data")
    try:
        with Client(served.url, served.token) as owner:
            assert owner.wait(ask(owner, "Warm", schedule=QUICK), timeout_s=90).state == "done"
            vehicle, rig = new_rig(owner, LEVEL_RIG, "Hostile")
            uploaded = []

            def upload_all() -> None:
                with Client(served.url, served.token) as hostile:
                    for number in range(UPLOADS):
                        _, data = damaged(seeds, number)
                        (tmp_path / "upload").write_bytes(data)
                        name = f"damaged {number}"
                        path = tmp_path / "upload"
                        uploaded.append(hostile.recordings.upload(path, vehicle.id, rig.id, name=name).id)

            uploading = threading.Thread(target=upload_all)
            uploading.start()
            waits, ended = [], {}
            while uploading.is_alive() or len(ended) < UPLOADS:
                began = time.monotonic()
                assert owner.wait(ask(owner, f"Other {len(waits)}", schedule=QUICK), timeout_s=60).state == "done"
                waits.append(time.monotonic() - began)
                for one in [one for one in uploaded if one not in ended]:
                    found = owner.recordings.get(one)
                    if found.state in ("ready", "failed"):
                        ended[one] = found
            uploading.join()
    finally:
        stop(served)
    print(f"{UPLOADS} uploads, {len(waits)} calibrations beside them, the longest in {max(waits):.2f} s")
    assert len(ended) == UPLOADS
    assert max(waits) < LONGEST_WAIT_S
    for found in ended.values():
        assert found.state == "ready" or (found.problem.code and found.problem.hint), found
