import assert from "node:assert/strict";
import { test } from "node:test";
import { eulerZyx, matrixOf } from "./transforms.ts";

function near(actual: readonly number[], expected: readonly number[]): void {
  actual.forEach((value, i) =>
    assert.ok(Math.abs(value - (expected[i] ?? NaN)) < 1e-9, `${actual.join()} is not ${expected.join()}`),
  );
}

test("the centre of Table I's box turns LiDAR axes into optical axes", () => {
  const matrix = matrixOf({ euler_order: "zyx", angles_deg: [90, -90, 0] });
  near(matrix.flat(), [0, -1, 0, 0, 0, -1, 1, 0, 0]);
});

test("angles come back from their matrix", () => {
  const matrix = matrixOf({ euler_order: "zyx", angles_deg: [20, -30, 40] });
  near(eulerZyx({ matrix }), [20, -30, 40]);
});

test("at the singular point the matrix is kept, whatever the angles", () => {
  const matrix = matrixOf({ euler_order: "zyx", angles_deg: [70, -90, 15] });
  near(matrixOf({ euler_order: "zyx", angles_deg: eulerZyx({ matrix }) }).flat(), matrix.flat());
});

test("the two orders differ, and a quaternion is read x y z w", () => {
  const eq2 = matrixOf({ euler_order: "xyz_eq2", angles_deg: [20, -30, 40] });
  assert.ok(Math.abs(eq2[0][0] - Math.cos(-Math.PI / 6) * Math.cos((40 * Math.PI) / 180)) < 1e-12);
  const half = Math.SQRT1_2;
  near(matrixOf({ quaternion_xyzw: [0, 0, half, half] }).flat(), [0, -1, 0, 1, 0, 0, 0, 0, 1]);
});
