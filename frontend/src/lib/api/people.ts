/** Signing in, members and invitations. */

import { bodyOf, client, once } from "./http.ts";
import { readAll, type Read } from "./reads.ts";
import type { Role } from "./types.ts";
import type { ChangedMember, Invitation, Me, Member } from "./schema.ts";

export const signIn = (secret: string): Promise<Me> => bodyOf(client.POST("/v1/sign-in", { body: { link: secret } }));

export const signOut = (): Promise<unknown> => client.POST("/v1/sign-out");

export const me = (): Promise<Me> => bodyOf(client.GET("/v1/me"));

export const members = (fleetId: string): Read<Member[]> => readAll("/v1/fleets/{id}/members", { id: fleetId });

/** Invites somebody; with `person_id`, makes a new link for somebody who is a member already. */
export const invite = (fleetId: string, name: string, role: Role, person_id?: string): Promise<Invitation> =>
  bodyOf(
    client.POST("/v1/fleets/{id}/invitations", {
      params: { path: { id: fleetId } },
      body: { name, role, ...(person_id ? { person_id } : {}) },
      ...once(),
    }),
  );

/** Gives a member another role; a higher one ends what let them in. */
export const changeRole = (id: string, person_id: string, role: Role): Promise<ChangedMember> =>
  bodyOf(client.PATCH("/v1/fleets/{id}/members/{person_id}", { params: { path: { id, person_id } }, body: { role } }));

export const removeMember = (id: string, person_id: string): Promise<unknown> =>
  client.DELETE("/v1/fleets/{id}/members/{person_id}", { params: { path: { id, person_id } } });
