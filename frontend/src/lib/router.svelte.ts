/** Addresses of the pages. Links are plain <a href>; clicks on them are taken here instead of loading anew. */

import { tick } from "svelte";

export type Route =
  | { page: "home"; fleet: string | null; cameras: CameraFilter }
  | { page: "sign-in" }
  | { page: "reference" }
  | { page: "vehicle"; id: string }
  | { page: "recording"; id: string; step: string | null; detection: string | null }
  | { page: "marking"; detection: string; camera: string; vertex: string | null; crops: number; result: string | null }
  | { page: "crops"; detection: string; camera: string }
  | { page: "calibration"; id: string; show: string | null }
  | { page: "fleet-requests"; fleet: string }
  | { page: "fleet-request"; id: string; state: string | null }
  | { page: "unknown" };

/** Which cameras the fleet's page shows, and in which order; empty texts are the usual. */
export interface CameraFilter {
  name: string;
  state: string;
  work: string;
  order: string;
}

export function healthPath(fleet: string, filter: CameraFilter): string {
  const texts = Object.entries<string>({ ...filter }).filter(([, text]) => text !== "");
  const query = texts.map(([name, text]) => `${name}=${encodeURIComponent(text)}`).join("&");
  return `/fleets/${fleet}${query && `?${query}`}`;
}

function filterOf({ searchParams }: URL): CameraFilter {
  const text = (key: string): string => searchParams.get(key) ?? "";
  return { name: text("name"), state: text("state"), work: text("work"), order: text("order") };
}

export function routeOf(url: URL): Route {
  const [first, second, third, ...rest] = url.pathname.split("/").filter(Boolean).map(decodeURIComponent);
  if (rest.length > 0) return { page: "unknown" };
  if (first === undefined) return { page: "home", fleet: null, cameras: filterOf(url) };
  if ((first === "sign-in" || first === "reference") && !second) return { page: first };
  if (!second) return { page: "unknown" };
  const camera = url.searchParams.get("camera") ?? "";
  if (first === "detections" && third === "mark") {
    const [vertex, result] = [url.searchParams.get("vertex"), url.searchParams.get("result")];
    const crops = Number(url.searchParams.get("crops")) || 0;
    return { page: "marking", detection: second, camera, vertex, crops, result };
  }
  if (first === "detections" && third === "crops") return { page: "crops", detection: second, camera };
  if (first === "fleets" && third === "requests") return { page: "fleet-requests", fleet: second };
  if (third) return { page: "unknown" };
  if (first === "fleets") return { page: "home", fleet: second, cameras: filterOf(url) };
  if (first === "vehicles") return { page: "vehicle", id: second };
  if (first === "recordings") {
    const [step, detection] = [url.searchParams.get("step"), url.searchParams.get("detection")];
    return { page: "recording", id: second, step, detection };
  }
  if (first === "calibrations") return { page: "calibration", id: second, show: url.searchParams.get("show") };
  if (first === "fleet-requests") return { page: "fleet-request", id: second, state: url.searchParams.get("state") };
  return { page: "unknown" };
}

/** Where a page was left, which the browser's history keeps. */
interface Left {
  scroll?: number;
}

/** How long a page that is gone back to may take to be as high as it was. */
const RETURN_MS = 3000;

class Router {
  route = $state.raw<Route>({ page: "unknown" });

  start(): void {
    history.scrollRestoration = "manual";
    this.route = routeOf(new URL(location.href));
    void scrollBack((history.state as Left | null)?.scroll ?? 0);
    addEventListener("popstate", ({ state }) => {
      this.route = routeOf(new URL(location.href));
      void scrollBack((state as Left | null)?.scroll ?? 0);
    });
    document.addEventListener("click", (event) => {
      const href = internalTarget(event);
      if (href === null) return;
      event.preventDefault();
      this.go(href);
    });
    addEventListener("scrollend", () => history.replaceState({ scroll: scrollY } satisfies Left, ""));
  }

  /** Shows another page, from its top and with the focus before its content. A step of the same page leaves both. */
  go(path: string, replace = false): void {
    const before = location.pathname;
    if (replace) history.replaceState(null, "", path);
    else {
      history.replaceState({ scroll: scrollY } satisfies Left, "");
      history.pushState(null, "", path);
    }
    this.route = routeOf(new URL(location.href));
    if (location.pathname === before) return;
    scrollTo(0, 0);
    void tick().then(() => document.getElementById("main")?.focus({ preventScroll: true }));
  }
}

/** Scrolls to where a page was left, once it is high enough: what it shows comes from the service. */
async function scrollBack(scroll: number): Promise<void> {
  const until = performance.now() + RETURN_MS;
  const page = location.href;
  await tick();
  while (performance.now() < until && location.href === page) {
    if (document.documentElement.scrollHeight >= scroll + innerHeight) break;
    await new Promise(requestAnimationFrame);
  }
  if (location.href === page) scrollTo(0, scroll);
}

/** The path of a plain click on a link to another page of ours, else null. */
function internalTarget(event: MouseEvent): string | null {
  if (event.defaultPrevented || event.button !== 0) return null;
  if (event.metaKey || event.ctrlKey || event.shiftKey || event.altKey) return null;
  const link = event.target instanceof Element ? event.target.closest("a") : null;
  if (!link || link.target || link.hasAttribute("download") || link.origin !== location.origin) return null;
  if (link.pathname.startsWith("/v1/") || (link.hash && link.pathname === location.pathname)) return null;
  return link.pathname + link.search + link.hash;
}

export const router = new Router();

const DOCUMENTS: Partial<Record<Route["page"], string>> = {
  vehicle: "rigs",
  recording: "detecting",
  marking: "annotators",
  crops: "annotators",
  calibration: "judging",
};

/** The document of a page, as the service has it. */
export const documentPath = (page: Route["page"]): string => `/docs/${DOCUMENTS[page] ?? "operators"}.html`;

/**
 * `vertex` comes first. After `crops` answers the page leads to the crops; with `result` after one back to this
 * calibration.
 */
export function markingPath(
  detection: string,
  camera: string,
  { vertex, crops, result }: { vertex?: string | null; crops?: number; result?: string } = {},
): string {
  const wishes = (vertex ? `&vertex=${vertex}` : "") + (crops ? `&crops=${crops}` : "");
  return `/detections/${detection}/mark?camera=${encodeURIComponent(camera)}${wishes}${result ? `&result=${result}` : ""}`;
}

export const cropsPath = (detection: string, camera: string): string =>
  `/detections/${detection}/crops?camera=${encodeURIComponent(camera)}`;

/** `step`: the drawer of a recording's page that is open. */
export function recordingPath(id: string, step?: "facts" | "region" | "calibration", detection?: string): string {
  const query = (step ? `?step=${step}` : "") + (detection ? `?detection=${detection}` : "");
  return `/recordings/${id}${query}`;
}

/** What a calibration's page shows where it is no camera: no camera has a name with a slash. */
export const RIG = "/rig";

export const calibrationPath = (id: string, show: string): string =>
  `/calibrations/${id}?show=${encodeURIComponent(show)}`;
