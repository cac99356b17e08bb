"""The pages keep the points that a detection keeps: their mask beside the kernel's, on the same points."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np

from apexcal.documents.regions import OPERATORS, QUANTITIES
from tests.support.places import FRONTEND
from workers.vertices.region import Region

POLYGON = {"polygon": [[1, -2], [9, -7], [6, 0], [12, 5], [2, 4]], "z": [-1.2, 0.9]}
CROSSED = {"polygon": [[0, 0], [8, 8], [8, 0], [0, 8]]}
TURNED = {"box": {"min": [2, -3, -1], "max": [7, 4, 1.5], "yaw_deg": 33}}
STRAIGHT = {"box": {"min": [-4, -3, -1], "max": [7, 4, 1.5]}}
REGIONS = [
    {"all": [POLYGON]},
    {"all": [CROSSED]},
    {"all": [TURNED]},
    {"all": [STRAIGHT]},
    {"all": [STRAIGHT], "none": [TURNED]},
    {"all": [POLYGON, {"quantity": "z", "op": ">", "value": 0}], "none": [TURNED, CROSSED]},
    {"all": [{"quantity": "z", "divided_by": "x", "op": ">", "value": 0.2}]},
    {"all": [{"quantity": "y", "divided_by": "z", "op": "<=", "value": -1.5}]},
    {"all": [POLYGON], "none": [TURNED], "up": [0.1, 0.35, 0.9]},
    {"all": [{"quantity": "z", "op": ">", "value": 0.5}], "up": [0, 0, -2]},
    {"all": [STRAIGHT], "up": [0.95, 0.0, 0.2]},
    *({"all": [{"quantity": name, "op": "<", "value": 4.0}]} for name in QUANTITIES),
]


def drawn(rng):
    """Shapes and inequalities, some cut out."""
    parts = {"all": [drawn_part(rng) for _ in range(rng.integers(1, 4))]}
    cut = [drawn_part(rng) for _ in range(rng.integers(3))]
    return parts | {"none": cut} if cut else parts


def drawn_part(rng):
    """Limits of coordinates are whole, as some points are."""
    if rng.random() < 0.4:
        return (POLYGON, CROSSED, TURNED, STRAIGHT)[rng.integers(4)]
    names = [str(name) for name in rng.choice(QUANTITIES, 2)][: rng.integers(1, 3)]
    value = float(rng.integers(-5, 6)) + (0.37 if set(names) - {*"xyz"} else 0.0)
    leaf = dict(zip(("quantity", "divided_by"), names, strict=False))
    return leaf | {"op": str(rng.choice(OPERATORS)), "value": value}


def test_the_pages_keep_the_same_points(tmp_path):
    rng = np.random.default_rng(3)
    regions = REGIONS + [drawn(rng) for _ in range(60)]
    points = rng.uniform(-10, 14, (20_000, 3)).astype(np.float32)
    points[:200] = np.round(points[:200])  # on bounds, on axes, at the LiDAR itself
    points[0] = 0
    (tmp_path / "points").write_bytes(points.tobytes())
    (tmp_path / "regions").write_text(json.dumps(regions))
    script = f"""
        import {{ readFileSync }} from "node:fs";
        import {{ maskOf }} from "./src/lib/mask.ts";
        import {{ parseRegion }} from "./src/lib/region.ts";
        const read = (name) => readFileSync({json.dumps(str(tmp_path))} + "/" + name);
        const points = new Float32Array(new Uint8Array(read("points")).buffer);
        const regions = JSON.parse(read("regions").toString());
        console.log(JSON.stringify(regions.map((one) => maskOf(parseRegion(JSON.stringify(one)), points).join(""))));
    """
    node = Path(sys.executable).parent / "node"
    command = [node, "--input-type=module-typescript", "-e", script]
    said = subprocess.run(command, cwd=FRONTEND, capture_output=True, check=True)
    for region, mask in zip(regions, json.loads(said.stdout), strict=True):
        wanted = Region.from_document(region).mask(points)
        assert region not in REGIONS or 0 < wanted.sum() < len(points), region
        assert np.array_equal(np.array(list(mask)) == "1", wanted), region
