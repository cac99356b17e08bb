/** Signing in, members and invitations. */

import { create, get, post, request, type Page } from "./http.ts";
import type { ChangedMember, Invitation, Me, Member, Role } from "./types/people.ts";

export const signIn = (secret: string): Promise<Me> => post<Me>("/sign-in", { link: secret });

export const signOut = (): Promise<unknown> => post("/sign-out");

export const me = (): Promise<Me> => get<Me>("/me");

export const members = (fleetId: string): Promise<Page<Member>> => get<Page<Member>>(`/fleets/${fleetId}/members`);

/** Invites somebody; with `personId`, makes a new link for somebody who is a member already. */
export const invite = (fleetId: string, name: string, role: Role, personId?: string): Promise<Invitation> =>
  create<Invitation>(`/fleets/${fleetId}/invitations`, personId ? { name, role, person_id: personId } : { name, role });

/** Gives a member another role; a higher one ends what let them in. */
export const changeRole = async (fleetId: string, personId: string, role: Role): Promise<ChangedMember> =>
  (await request<ChangedMember>("PATCH", `/fleets/${fleetId}/members/${personId}`, { body: { role } })).data;

export const removeMember = (fleetId: string, personId: string): Promise<unknown> =>
  request("DELETE", `/fleets/${fleetId}/members/${personId}`);
