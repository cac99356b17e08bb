/** Who is signed in, and what they may do where. */

import { ApiProblem, asProblem, onSignedOut } from "./api/http.ts";
import * as people from "./api/people.ts";
import { cache } from "./cache.svelte.ts";
import { ROLES, type Role } from "./api/types.ts";
import type { Me } from "./api/schema.ts";

class Session {
  me = $state.raw<Me | null>(null);
  state = $state<"loading" | "in" | "out" | "unreachable">("loading");
  problem = $state.raw<ApiProblem | null>(null);

  private readonly tabs = new BroadcastChannel("apexcal-session");

  constructor() {
    onSignedOut(() => {
      this.end();
    });
    this.tabs.addEventListener("message", () => {
      if (this.state === "out") void this.load();
    });
  }

  async load(): Promise<void> {
    try {
      this.enter(await people.me());
    } catch (error) {
      this.problem = asProblem(error);
      if (this.problem.status !== 401) this.state = "unreachable";
    }
  }

  enter(me: Me): void {
    // Somebody else may see other things.
    if (this.me && this.me.id !== me.id) void cache.resetQueries();
    // Tabs that say "not signed in" look again.
    if (this.me?.id !== me.id) this.tabs.postMessage("entered");
    this.me = me;
    this.state = "in";
    this.problem = null;
  }

  async leave(): Promise<void> {
    await people.signOut();
    this.end();
  }

  private end(): void {
    this.me = null;
    this.state = "out";
    cache.clear();
  }

  role(fleetId: string | undefined): Role | null {
    if (!this.me || !fleetId) return null;
    if (this.me.is_owner) return "admin";
    return this.me.fleets.find((fleet) => fleet.id === fleetId)?.role ?? null;
  }

  /** Whether the person has at least `role` in the fleet. The service decides; this only hides what it would refuse. */
  may(role: Role, fleetId: string | undefined): boolean {
    const own = this.role(fleetId);
    return own !== null && ROLES.indexOf(own) >= ROLES.indexOf(role);
  }

  fleetName(fleetId: string | undefined): string {
    return this.me?.fleets.find((fleet) => fleet.id === fleetId)?.name ?? "";
  }
}

export const session = new Session();
