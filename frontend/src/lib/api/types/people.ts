/** People and what they may do. */

export type Role = "viewer" | "annotator" | "reviewer" | "engineer" | "admin";
export const ROLES: readonly Role[] = ["viewer", "annotator", "reviewer", "engineer", "admin"];

export interface Me {
  id: string;
  name: string;
  is_owner: boolean;
  fleets: { id: string; name: string; role: Role }[];
}

export interface Member {
  person_id: string;
  name: string;
  role: Role;
}

/** `ended` counts what let somebody in until they were raised. */
export interface ChangedMember extends Member {
  ended: { sessions: number; links: number; tokens: number } | null;
}

export interface Invitation {
  person_id: string;
  name: string;
  role: Role;
  link: string;
  expires_at: string;
}
