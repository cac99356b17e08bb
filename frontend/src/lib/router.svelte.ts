/** Addresses of the pages. Links are plain <a href>; clicks on them are taken here instead of loading anew. */

export type Route =
  | { page: "home"; fleet: string | null }
  | { page: "sign-in" }
  | { page: "vehicle"; id: string }
  | { page: "recording"; id: string }
  | { page: "marking"; detection: string; camera: string }
  | { page: "calibration"; id: string; show: string | null }
  | { page: "fleet-requests"; fleet: string }
  | { page: "fleet-request"; id: string; state: string | null }
  | { page: "unknown" };

export function routeOf(url: URL): Route {
  const [first, second, third, ...rest] = url.pathname.split("/").filter(Boolean).map(decodeURIComponent);
  if (rest.length > 0) return { page: "unknown" };
  if (first === undefined) return { page: "home", fleet: null };
  if (first === "sign-in" && !second) return { page: "sign-in" };
  if (!second) return { page: "unknown" };
  if (first === "detections" && third === "mark") {
    return { page: "marking", detection: second, camera: url.searchParams.get("camera") ?? "" };
  }
  if (first === "fleets" && third === "requests") return { page: "fleet-requests", fleet: second };
  if (third) return { page: "unknown" };
  if (first === "fleets") return { page: "home", fleet: second };
  if (first === "vehicles") return { page: "vehicle", id: second };
  if (first === "recordings") return { page: "recording", id: second };
  if (first === "calibrations") return { page: "calibration", id: second, show: url.searchParams.get("show") };
  if (first === "fleet-requests") return { page: "fleet-request", id: second, state: url.searchParams.get("state") };
  return { page: "unknown" };
}

class Router {
  route = $state.raw<Route>({ page: "home", fleet: null });

  start(): void {
    this.route = routeOf(new URL(location.href));
    addEventListener("popstate", () => {
      this.route = routeOf(new URL(location.href));
    });
    document.addEventListener("click", (event) => {
      const href = internalTarget(event);
      if (href === null) return;
      event.preventDefault();
      this.go(href);
    });
  }

  go(path: string, replace = false): void {
    if (replace) history.replaceState(null, "", path);
    else history.pushState(null, "", path);
    this.route = routeOf(new URL(location.href));
    scrollTo(0, 0);
  }
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

export const markingPath = (detection: string, camera: string): string =>
  `/detections/${detection}/mark?camera=${encodeURIComponent(camera)}`;

/** What a calibration's page shows where it is no camera: no camera has a name with a slash. */
export const RIG = "/rig";

export const calibrationPath = (id: string, show: string): string =>
  `/calibrations/${id}?show=${encodeURIComponent(show)}`;
