/**
 * What a person's own marks predict: a camera is fitted to them, beginning at the rig's nominal mount, and predicts the
 * pixel of another vertex with its deviation. Other people's marks are not used.
 */

import type { Mount } from "../overlay/projection.ts";
import type { Pixel, Size } from "../pixels.ts";
import { cameraOf, PARAMETERS, type Place, type Sees } from "./camera.ts";
import { dot, inverseOf } from "./linear.ts";

/** A vertex at the time of the frame in which its person marked it. */
export interface OwnPair extends Place, Pixel {}

export interface Doubt {
  /** Between the mark and the expected place, pixels. */
  distance: number;
  /** Good marks are farther off once in a thousand, pixels. */
  usual: number;
}

export interface Expectation {
  /** Null if the mark is no farther off than good ones are, or if nothing can be expected of it. */
  doubts: (place: Place, mark: Pixel) => Doubt | null;
}

const ASKED_IN_VAIN = 1e-3;
/** No one's marks are assumed to be better. */
const LEAST_SIGMA_PX = 1;
/** Cauchy's weights with this constant lose 5 % on Gaussian errors (Holland and Welsch 1977). */
const CAUCHY = 2.385;
/** The median length of errors of which both coordinates have deviation 1. */
const MEDIAN_LENGTH = Math.sqrt(2 * Math.log(2));
/** The newest are enough, and are fitted within milliseconds. */
const MOST_PAIRS = 100;
const MOST_STEPS = 50;
/** Of parameters, in deviations of their priors. */
const STEP = 1e-5;
const SETTLED = 1e-4;
const MOST_DAMPING = 1e8;

/** What the pairs let one expect; null if they determine too little. */
export function expectationOf(pairs: readonly OwnPair[], nominal: Mount, size: Size): Expectation | null {
  const fit = new Fit(pairs.slice(-MOST_PAIRS), nominal, size);
  const covariance = fit.run() && inverseOf(fit.normal);
  if (!covariance) return null;
  // So many of the eleven parameters are determined by the pairs and not by their priors.
  const determined = covariance.reduce((sum, row, i) => sum + 1 - (row[i] ?? 0), 0);
  const freedom = 2 * fit.pairs.length - determined;
  if (freedom <= 0) return null;
  const variance = (fit.sigma ** 2 * 2 * fit.pairs.length) / freedom;
  // Twice the quantile of the F distribution with 2 and `freedom` degrees of freedom.
  const limit = freedom * (ASKED_IN_VAIN ** (-2 / freedom) - 1);
  return {
    doubts: (place, mark) => {
      const seen = fit.sees(place);
      const slopes = seen && fit.slopes(place, seen);
      if (!slopes) return null;
      const [along, down] = slopes;
      const spread = (a: Float64Array, b: Float64Array): number =>
        dot(
          a,
          Float64Array.from(covariance, (row) => dot(row, b)),
        );
      const [uu, uv, vv] = [variance + spread(along, along), spread(along, down), variance + spread(down, down)];
      const [du, dv] = [mark.u - seen.u, mark.v - seen.v];
      const squares = (vv * du * du - 2 * uv * du * dv + uu * dv * dv) / (uu * vv - uv * uv);
      const distance = Math.hypot(du, dv);
      return squares > limit ? { distance, usual: distance * Math.sqrt(limit / squares) } : null;
    },
  };
}

/** Robust least squares by Levenberg and Marquardt, with weights and scale from the residuals of each step. */
class Fit {
  readonly pairs: readonly OwnPair[];
  /** The information of pairs and priors on the parameters. */
  normal: Float64Array[] = [];
  sigma = LEAST_SIGMA_PX;
  private at = new Float64Array(PARAMETERS);
  private beside: Sees[] = [];
  private readonly camera: (at: Float64Array) => Sees;
  /** The residual of a pair that the camera does not see. */
  private readonly far: number;

  constructor(pairs: readonly OwnPair[], nominal: Mount, size: Size) {
    this.pairs = pairs;
    this.camera = (at) => cameraOf(at, nominal, size);
    this.far = size.width;
  }

  sees(place: Place): Pixel | null {
    return this.camera(this.at)(place);
  }

  /** Returns whether it ended well. */
  run(): boolean {
    let damping = 1e-2;
    let lengths = this.lengths(this.at);
    for (let step = 0; step < MOST_STEPS && damping < MOST_DAMPING; step += 1) {
      this.sigma = Math.max(LEAST_SIGMA_PX, medianOf(lengths) / MEDIAN_LENGTH);
      const weights = lengths.map((one) => 1 / (1 + (one / (CAUCHY * this.sigma)) ** 2) / this.sigma ** 2);
      const gradient = this.linearise(weights);
      const damped = this.normal.map((row, i) => row.map((one, j) => (i === j ? one * (1 + damping) : one)));
      const inverse = inverseOf(damped);
      if (!inverse) return false;
      const change = Float64Array.from(inverse, (row) => -dot(row, gradient));
      const next = this.at.map((one, i) => one + (change[i] ?? 0));
      const there = this.lengths(next);
      if (costOf(next, there, weights) < costOf(this.at, lengths, weights)) {
        [this.at, lengths] = [next, there];
        damping /= 10;
      } else damping *= 10;
      if (Math.sqrt(dot(change, change)) < SETTLED) break;
    }
    return true;
  }

  /** How u and v of a place change with each parameter; null where the camera stops seeing it. */
  slopes(place: Place, seen: Pixel): [Float64Array, Float64Array] | null {
    const [along, down] = [new Float64Array(PARAMETERS), new Float64Array(PARAMETERS)];
    for (const [i, sees] of this.beside.entries()) {
      const there = sees(place);
      if (!there) return null;
      along[i] = (there.u - seen.u) / STEP;
      down[i] = (there.v - seen.v) / STEP;
    }
    return [along, down];
  }

  /** Distances of the marks from where a camera sees their vertices. */
  private lengths(at: Float64Array): number[] {
    const sees = this.camera(at);
    return this.pairs.map((pair) => {
      const seen = sees(pair);
      return seen ? Math.hypot(seen.u - pair.u, seen.v - pair.v) : this.far;
    });
  }

  /** Sets the normal matrix about the parameters, and returns half the gradient of the cost. */
  private linearise(weights: readonly number[]): Float64Array {
    const sees = this.camera(this.at);
    this.beside = Array.from(this.at, (_, i) => this.camera(this.at.map((one, j) => (i === j ? one + STEP : one))));
    this.normal = Array.from(this.at, (_, i) => Float64Array.from(this.at, (__, j) => (i === j ? 1 : 0)));
    const gradient = this.at.slice();
    for (const [place, pair] of this.pairs.entries()) {
      const seen = sees(pair);
      const slopes = seen && this.slopes(pair, seen);
      if (!slopes) continue;
      const weight = weights[place] ?? 0;
      const apart = [seen.u - pair.u, seen.v - pair.v];
      for (const [axis, slope] of slopes.entries()) {
        for (const [i, one] of slope.entries()) {
          gradient[i] = (gradient[i] ?? 0) + weight * one * (apart[axis] ?? 0);
          const row = this.normal[i];
          slope.forEach((other, j) => row && (row[j] = (row[j] ?? 0) + weight * one * other));
        }
      }
    }
    return gradient;
  }
}

/** Weighted squares of the residuals, and of the parameters in deviations of their priors. */
function costOf(at: Float64Array, lengths: readonly number[], weights: readonly number[]): number {
  return lengths.reduce((sum, one, i) => sum + (weights[i] ?? 0) * one * one, dot(at, at));
}

function medianOf(values: readonly number[]): number {
  return [...values].sort((a, b) => a - b)[Math.floor(values.length / 2)] ?? 0;
}
