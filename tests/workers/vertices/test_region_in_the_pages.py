"""The pages keep the points that a detection keeps: their mask beside the kernel's, on the same points."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np

from apexcal.documents.regions import OPERATORS, QUANTITIES
from workers.vertices.region import Region

FRONTEND = Path(__file__).parents[3] / "frontend"
POLYGON = {"polygon": [[1, -2], [9, -7], [6, 0], [12, 5], [2, 4]], "z": [-1.2, 0.9]}
CROSSED = {"polygon": [[0, 0], [8, 8], [8, 0], [0, 8]]}
TURNED = {"box": {"min": [2, -3, -1], "max": [7, 4, 1.5], "yaw_deg": 33}}
STRAIGHT = {"box": {"min": [-4, -3, -1], "max": [7, 4, 1.5]}}
REGIONS = [
    POLYGON,
    CROSSED,
    TURNED,
    STRAIGHT,
    {"and": [STRAIGHT, {"not": TURNED}]},
    {"or": [{"and": [POLYGON, {"quantity": "z", "op": ">", "value": 0}]}, {"not": {"or": [TURNED, CROSSED]}}]},
    {"quantity": "z", "divided_by": "x", "op": ">", "value": 0.2},
    {"quantity": "y", "divided_by": "z", "op": "<=", "value": -1.5},
    {"level": {"and": [POLYGON, {"not": TURNED}]}, "up": [0.1, 0.35, 0.9]},
    {"level": {"quantity": "z", "op": ">", "value": 0.5}, "up": [0, 0, -2]},
    {"level": STRAIGHT, "up": [0.95, 0.0, 0.2]},
    *({"quantity": name, "op": "<", "value": 4.0} for name in QUANTITIES),
]


def drawn(rng, depth=4):
    """A tree of shapes and inequalities; limits of coordinates are whole, as some points are."""
    if depth and rng.random() < 0.8:
        kind = str(rng.choice(["and", "or", "not"]))
        nodes = [drawn(rng, depth - 1) for _ in range(1 if kind == "not" else rng.integers(1, 5))]
        return {kind: nodes[0] if kind == "not" else nodes}
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
