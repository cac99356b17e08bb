/** Signing in, members and invitations. */

import { bodyOf, client } from "./http.ts";
import { readAll } from "./reads.ts";
import { change, create, post, remove } from "./writes.ts";
import type { Role } from "./types.ts";
import type { Me } from "./schema.ts";

export const signIn = (link: string) => post("/v1/sign-in", {}, { link });

export const signOut = () => post("/v1/sign-out", {});

export const me = (): Promise<Me> => bodyOf(client.GET("/v1/me"));

export const members = (fleetId: string) => readAll("/v1/fleets/{id}/members", { id: fleetId });

/** Invites somebody; with `person_id`, makes a new link for somebody who is a member already. */
export const invite = (id: string, name: string, role: Role, person_id?: string) =>
  create("/v1/fleets/{id}/invitations", { id }, { name, role, ...(person_id ? { person_id } : {}) });

/** Gives a member another role; a higher one ends what let them in. */
export const changeRole = (id: string, person_id: string, role: Role) =>
  change("patch", "/v1/fleets/{id}/members/{person_id}", { id, person_id }, { role });

export const removeMember = (id: string, person_id: string) =>
  remove("/v1/fleets/{id}/members/{person_id}", { id, person_id });
