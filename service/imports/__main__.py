"""Calibration files read without a service: ``python -m service.imports RECORDING FILE...``.

It prints one line of JSON: ``read``, as ``POST /v1/calibration-files/reading`` answers, or ``error``. The recording's
files choose the records of a dataset's tables. A lens without an image size has 0 x 0 pixels.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from pydantic import ValidationError

from apexcal.documents.base import first_fault
from apexcal.documents.imports import CalibrationFiles
from service.imports.formats import files_view
from service.imports.nuscenes import of_recording
from service.platform.http.problems import Problem


def main(recording: str, *paths: str) -> int:
    """Print what the files hold."""
    texts = {Path(path).name: Path(path).read_text("utf-8", "replace") for path in paths}
    try:
        sent = CalibrationFiles(files=of_recording(texts, Path(recording)))
        print(json.dumps({"read": files_view(sent, needs_size=False).model_dump(mode="json")}))
    except ValidationError as error:
        what = f"{' and '.join(texts)}: {first_fault(error)[1]}."
        print(json.dumps({"error": {"message": what, "hint": "Name one to four calibration files of text."}}))
        return 1
    except Problem as problem:
        print(json.dumps({"error": {"message": problem.detail, "hint": problem.hint}}))
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
