/** Points and lines drawn by three.js into a canvas. Loaded only where points are shown: most of the pages' bytes. */

import {
  BufferAttribute,
  BufferGeometry,
  GLSL3,
  LineBasicMaterial,
  LineSegments,
  MOUSE,
  OrthographicCamera,
  PerspectiveCamera,
  Points,
  RawShaderMaterial,
  Scene,
  TOUCH,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import type { Cloud, Extent } from "./cloud.ts";
import { STOPS, type Colour } from "./colours.ts";
import type { Matrix } from "./picking.ts";
import { placeOf, type Place, type ViewName } from "./views.ts";

/** Lines to be drawn: pairs of ends, x, y, z each. */
export interface Lines {
  ends: number[];
  /** As CSS writes it in hexadecimal. */
  colour: string;
}

export interface Look {
  palette: Colour[];
  /** Of points that are cut. */
  pale: Colour;
}

export interface Seen {
  matrix: Matrix;
  width: number;
  height: number;
  /** Counts the pictures. */
  pictures: number;
}

const FIELD_OF_VIEW_DEG = 55;
const [NEAR_M, FAR_M] = [0.05, 2000];
// If this machine cannot draw all points 30 times a second, fewer are drawn while the picture moves.
const [QUICK_MS, SLOW_MS] = [20, 34];
const FEWEST_POINTS = 20_000;
const AT_REST_MS = 180;

const VERTICES = `
precision highp float;
uniform mat4 modelViewMatrix;
uniform mat4 projectionMatrix;
uniform vec3 palette[${STOPS}];
uniform vec3 pale;
uniform float pixels;
in vec3 position;
in float shade;
in float kept;
flat out vec3 colour;
void main() {
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
  float at = clamp(shade, 0.0, 1.0) * ${(STOPS - 1).toFixed(1)};
  int stop = min(int(at), ${STOPS - 2});
  colour = kept > 0.5 ? mix(palette[stop], palette[stop + 1], at - float(stop)) : pale;
  gl_Position.z += kept > 0.5 ? 0.0 : 0.00001 * gl_Position.w;
  gl_PointSize = pixels;
}`;

const FRAGMENTS = `
precision mediump float;
flat in vec3 colour;
out vec4 shown;
void main() { shown = vec4(colour, 1.0); }`;

export class PointScene {
  readonly #renderer: WebGLRenderer;
  readonly #scene = new Scene();
  readonly #perspective = new PerspectiveCamera(FIELD_OF_VIEW_DEG, 1, NEAR_M, FAR_M);
  readonly #flat = new OrthographicCamera(-1, 1, 1, -1, -FAR_M, FAR_M);
  readonly #material: RawShaderMaterial;
  readonly #lines = new Map<string, LineSegments<BufferGeometry, LineBasicMaterial>>();
  readonly #onpicture: (seen: Seen) => void;
  #camera: PerspectiveCamera | OrthographicCamera = this.#perspective;
  #controls: OrbitControls | null = null;
  #points: Points<BufferGeometry, RawShaderMaterial> | null = null;
  #view: ViewName = "orbit";
  #halfHeight = 1;
  #size = { width: 1, height: 1 };
  #asked = 0;
  #rest: ReturnType<typeof setTimeout> | undefined;
  #moving = false;
  #budget = Infinity;
  #askedAt = 0;
  #pictures = 0;

  /** Throws an Error where the browser has no WebGL 2. */
  constructor(canvas: HTMLCanvasElement, onpicture: (seen: Seen) => void) {
    this.#onpicture = onpicture;
    this.#renderer = new WebGLRenderer({ canvas, alpha: true, antialias: false, powerPreference: "high-performance" });
    this.#renderer.setClearAlpha(0);
    this.#perspective.up.set(0, 0, 1);
    this.#flat.up.set(0, 0, 1);
    this.#material = new RawShaderMaterial({
      vertexShader: VERTICES,
      fragmentShader: FRAGMENTS,
      glslVersion: GLSL3,
      uniforms: {
        palette: { value: Array.from({ length: STOPS }, () => new Vector3()) },
        pale: { value: new Vector3() },
        pixels: { value: 2 },
      },
    });
  }

  show(cloud: Cloud): void {
    this.#remove();
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(cloud.positions, 3));
    geometry.setAttribute("shade", new BufferAttribute(new Float32Array(cloud.count), 1));
    geometry.setAttribute("kept", new BufferAttribute(new Uint8Array(cloud.count).fill(1), 1));
    this.#points = new Points(geometry, this.#material);
    this.#points.frustumCulled = false;
    this.#scene.add(this.#points);
    this.#budget = cloud.count;
    this.draw();
  }

  shade(values: Float32Array): void {
    this.#put("shade", new BufferAttribute(values, 1));
  }

  /** 1 for each point that is kept, 0 for each that is cut; null: none is cut. */
  keep(kept: Uint8Array | null): void {
    const count = this.#points?.geometry.getAttribute("position").count ?? 0;
    this.#put("kept", new BufferAttribute(kept ?? new Uint8Array(count).fill(1), 1));
  }

  #put(name: string, attribute: BufferAttribute): void {
    if (attribute.count !== this.#points?.geometry.getAttribute("position").count) return;
    this.#points.geometry.setAttribute(name, attribute);
    this.draw();
  }

  look({ palette, pale }: Look): void {
    const { uniforms } = this.#material;
    if (uniforms.palette) uniforms.palette.value = palette.map((colour) => new Vector3(...colour));
    if (uniforms.pale) uniforms.pale.value = new Vector3(...pale);
    this.draw();
  }

  /** Draws lines under a name, in place of earlier ones of that name. */
  lines(name: string, lines: Lines | null): void {
    const before = this.#lines.get(name);
    if (before) {
      this.#scene.remove(before);
      before.geometry.dispose();
      before.material.dispose();
      this.#lines.delete(name);
    }
    if (lines) {
      const geometry = new BufferGeometry();
      geometry.setAttribute("position", new BufferAttribute(new Float32Array(lines.ends), 3));
      const drawn = new LineSegments(geometry, new LineBasicMaterial({ color: lines.colour }));
      drawn.frustumCulled = false;
      this.#lines.set(name, drawn);
      this.#scene.add(drawn);
    }
    this.draw();
  }

  view(name: ViewName, extent: Extent): void {
    this.#view = name;
    this.#go(placeOf(name, extent, this.#size.width / this.#size.height));
  }

  #go(place: Place): void {
    this.#camera = place.flat ? this.#flat : this.#perspective;
    this.#halfHeight = place.halfHeight;
    this.#camera.position.set(...place.position);
    this.#camera.zoom = 1;
    this.#fit();
    this.#controls?.dispose();
    const controls = new OrbitControls(this.#camera, this.#renderer.domElement);
    controls.target.set(...place.target);
    controls.enableRotate = !place.flat;
    controls.enableZoom = this.#view !== "sensor";
    controls.enablePan = this.#view !== "sensor";
    controls.zoomToCursor = place.flat;
    controls.maxDistance = FAR_M / 2;
    if (place.flat) {
      controls.mouseButtons = { LEFT: MOUSE.PAN, MIDDLE: MOUSE.DOLLY, RIGHT: MOUSE.PAN };
      controls.touches = { ONE: TOUCH.PAN, TWO: TOUCH.DOLLY_PAN };
    }
    if (this.#view === "sensor") controls.rotateSpeed = -0.35; // the picture follows the hand
    controls.addEventListener("change", () => this.#move());
    controls.update();
    this.#controls = controls;
    this.draw();
  }

  /** Turns by angles in radians; a flat view is moved by as much of its height. */
  turn(left: number, up: number): void {
    if (!this.#controls) return;
    if (this.#camera === this.#flat) {
      this.#controls.pan(-left * this.#size.height, up * this.#size.height);
    } else {
      const back = this.#view === "sensor" ? -0.5 : 1;
      this.#controls.rotateLeft(left * back);
      this.#controls.rotateUp(up * back);
    }
  }

  move(right: number, up: number): void {
    this.#controls?.pan(-right, up);
  }

  /** Shows things `factor` times as large. */
  zoom(factor: number): void {
    if (this.#view === "sensor") {
      this.#camera.zoom = Math.min(20, Math.max(0.5, this.#camera.zoom * factor));
      this.#camera.updateProjectionMatrix();
      this.#move();
    } else if (factor > 1) this.#controls?.dollyIn(1 / factor);
    else this.#controls?.dollyOut(factor);
  }

  resize(width: number, height: number): void {
    if (width < 1 || height < 1) return;
    this.#size = { width, height };
    const ratio = Math.min(2, devicePixelRatio);
    this.#renderer.setPixelRatio(ratio);
    this.#renderer.setSize(width, height, false);
    if (this.#material.uniforms.pixels) this.#material.uniforms.pixels.value = Math.round(2 * ratio);
    this.#fit();
    this.draw();
  }

  #fit(): void {
    const aspect = this.#size.width / this.#size.height;
    this.#perspective.aspect = aspect;
    this.#perspective.updateProjectionMatrix();
    const half = this.#halfHeight;
    Object.assign(this.#flat, { left: -half * aspect, right: half * aspect, top: half, bottom: -half });
    this.#flat.updateProjectionMatrix();
  }

  #move(): void {
    this.#moving = true;
    clearTimeout(this.#rest);
    this.#rest = setTimeout(() => {
      this.#moving = false;
      this.draw();
    }, AT_REST_MS);
    this.draw();
  }

  /** Asks for a picture. */
  draw(): void {
    if (this.#asked !== 0) return;
    this.#askedAt = performance.now();
    this.#asked = requestAnimationFrame(() => this.#picture());
  }

  #picture(): void {
    this.#asked = 0;
    this.#pace();
    const count = this.#points?.geometry.getAttribute("position").count ?? 0;
    this.#points?.geometry.setDrawRange(0, this.#moving ? Math.min(this.#budget, count) : count);
    this.#renderer.render(this.#scene, this.#camera);
    this.#pictures += 1;
    const matrix = this.#camera.projectionMatrix.clone().multiply(this.#camera.matrixWorldInverse).toArray();
    this.#onpicture({ matrix, ...this.#size, pictures: this.#pictures });
  }

  /** Draws fewer points if the browser was long busy with the last picture, and more if not. */
  #pace(): void {
    if (!this.#moving) return;
    const took = performance.now() - this.#askedAt;
    const count = this.#points?.geometry.getAttribute("position").count ?? 0;
    if (took > SLOW_MS) this.#budget = Math.max(FEWEST_POINTS, Math.min(this.#budget, count) * 0.7);
    else if (took < QUICK_MS) this.#budget = Math.min(count, this.#budget * 1.1);
    this.#budget = Math.round(this.#budget);
  }

  #remove(): void {
    if (!this.#points) return;
    this.#scene.remove(this.#points);
    this.#points.geometry.dispose();
    this.#points = null;
  }

  dispose(): void {
    cancelAnimationFrame(this.#asked);
    clearTimeout(this.#rest);
    this.#controls?.dispose();
    this.#remove();
    for (const name of [...this.#lines.keys()]) this.lines(name, null);
    cancelAnimationFrame(this.#asked);
    this.#material.dispose();
    this.#renderer.dispose();
  }
}
